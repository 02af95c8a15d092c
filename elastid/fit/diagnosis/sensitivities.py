r"""Residuals at the optimum and their derivatives to everything that the fit held.

`HeldModel` has the numbers that the fit held as parameters of its equations.  Apart from the robot's own numbers, its
geometry and the gains of its channels these are:

- angle_2: an offset of the angle at which axis 2 stood, in all configurations; angle_2@c1: in one.
- torsion_arm_x: the compliance 1 / k of an elastic rotation about x before the body arm, gear_2: of a rigid gear.
- base_x: that of what the robot stands on, about x of its first body before it turns.
- rate: a sampling rate 1 + e of the stated one. Frequencies are then 1 + e of those read, and motions that were
  differentiated from positions (1 + e)^2:

.. math:: \omega \frac{\partial}{\partial \omega}: \quad dK = -2 K\, d\epsilon, \; dD = -D\, d\epsilon

A stiff spring stands in for a rigid coordinate: dK = -k^2 dc (...).

`elastid.fit.diagnosis.response_columns` has numbers whose derivative follows from the response itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import ElastidError
from elastid.fit.assembly import Assembly
from elastid.fit.problem.elastic import at_measured_places, places_of
from elastid.fit.problem.least_squares import RESIDUALS, as_real
from elastid.fit.problem.part import Part, mixed
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import DELAY, LinearModel, Slope
from elastid.linear.linearise import Linearisation
from elastid.linear.response.kernel import Kernel
from elastid.parameters import Parameters
from elastid.record import Configuration
from elastid.robot import Body, Joint, Robot, Spring, gain_name

RATE = "rate"
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class HeldModel:
    """linearisation: of the robot with its geometry, gains and stiff springs among the parameters.

    rigid: the parameters of the stiff springs, k_arm_x, and the name of the compliance that each stands for.
    loads: the torque at rest of each driven joint, N m, by configuration.
    """

    linearisation: Linearisation
    rigid: dict[str, str]
    loads: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, assembly: Assembly, fitted: LinearModel) -> HeldModel:
        """The extended equations, without torsions or geometry where impossible; fitted: one of the fit."""
        robot = assembly.linearisation.model.robot
        channels = [gain_name("u", place) for place in robot.motor_locations]
        outputs = {place for response in assembly.responses for place in response.outputs}
        channels += [gain_name("y", place) for place in sorted(outputs) if place in robot.locations]
        known = assembly.parameters.names  # zeros that are held are among the postures' angles
        places = tuple(name for name in robot.geometry if not name.startswith("zero_") or name in known)
        refused: ElastidError | ValueError | None = None
        for (extended, rigid), geometry in (
            (_with_torsions(robot), places),
            ((robot, {}), places),
            ((robot, {}), known),
        ):
            try:
                held = cls(Linearisation.of_robot(extended, assembly.model, (*geometry, *channels)), rigid)
                held.at(assembly.parameters, fitted, assembly.parameters.x)
            except (ElastidError, ValueError) as error:
                refused = error
            else:
                return replace(held, loads=_loads(assembly))
        raise refused or AssertionError

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta: those of the equations, the delay, offsets of the angles, the rate."""
        robot = self.linearisation.model.robot
        further = (f"angle_{joint.name}" for joint in robot.driven)
        return (*self.linearisation.model.parameters, DELAY, *further, RATE)

    def theta(self, fitted: Parameters, x: FloatArray, configuration: str) -> FloatArray:
        """The numbers (n,) in SI where x (n_x,) is the estimate."""
        model = self.linearisation.model
        estimates = dict(zip(fitted.names, fitted.expand(x, configuration).tolist(), strict=True))
        nominal = dict(zip(model.parameters, model.theta.tolist(), strict=True))
        return np.array([estimates.get(name, nominal.get(name, 0.0)) for name in self.parameters])

    def at(self, fitted: Parameters, measured: LinearModel, x: FloatArray) -> tuple[LinearModel, FloatArray]:
        """The linear model of a configuration with slopes to all of `parameters`, and theta (n,).

        measured: its model in the fit, whose inputs and outputs are those measured.
        """
        theta = self.theta(fitted, x, measured.configuration.name)
        own = theta[: len(self.linearisation.model.parameters)]

        def model_at(configuration: Configuration, linearisation: Linearisation) -> LinearModel:
            model = linearisation.at(configuration, own, places_of(measured), measured.quantity)
            return at_measured_places(model, measured)

        model = model_at(measured.configuration, self.linearisation)
        slopes = dict(model.slopes) | {RATE: Slope(D=-model.D, K=-2 * model.K)}
        for name in self.rigid:
            k = model.number(np.append(own, 0.0), name)
            stiff = {letter: getattr(slopes[name], letter) for letter in "MDKCTB"}
            slopes[name] = Slope(**{letter: None if part is None else -(k**2) * part for letter, part in stiff.items()})
        step = 1e-5  # rad, of finite differences
        for place, joint in enumerate(self.linearisation.model.robot.driven):
            angles = np.array(measured.configuration.angles)
            angles[place] += step
            moved = model_at(replace(measured.configuration, angles=angles), self.linearisation.without_slopes)
            slopes[f"angle_{joint.name}"] = _difference(model, moved, step)
        theta_ref = np.concatenate([own, np.zeros(len(self.parameters) - len(own))])
        return replace(model, parameters=self.parameters, theta_ref=theta_ref, slopes=slopes), theta


def _loads(assembly: Assembly) -> dict[str, dict[str, float]]:
    model, loads = assembly.linearisation.model, dict[str, dict[str, float]]()
    for configuration in (G.configuration for G in assembly.responses):
        theta = assembly.parameters.theta[: len(model.parameters)]
        torques = equilibrium(model, theta, configuration).u
        loads[configuration.name] = {j.name: float(u) for j, u in zip(model.robot.driven, torques, strict=True)}
    return loads


def _with_torsions(robot: Robot) -> tuple[Robot, dict[str, str]]:
    """The robot with stiff springs in rigid gears and about the free axes of bodies outside loops; their parameters."""
    springs = [joint.spring.stiffness for joint in robot.joints if joint.spring is not None]
    stiff = Spring(1e5 * max(springs, default=10.0))  # N*m/rad; a spring in N/m counts at a lever of 1 m
    within = {robot.joints[i].name for i in robot.joints_in_loops}
    owners, names, bodies = {body.name for body in robot.bodies}, dict[str, str](), list[Body]()
    for body in robot.bodies:
        joints, axes = list(body.joints), [joint.axis for joint in body.joints]
        is_outside = not any(joint.name in within for joint in body.joints)
        for i, joint in enumerate(body.joints if is_outside else ()):
            if joint.motor is not None and not joint.is_flexible and not joint.slides:
                names[f"k_{joint.name}"] = f"gear_{joint.name}"
                joints[i] = replace(joint, spring=stiff)
        is_root = bool(axes) and body.parent not in owners and "k_base" not in {name[:6] for name in names}
        for axis in "xyz" if is_outside else "":
            if axis in axes or _AXES[axis] in axes:
                continue
            name = f"base_{axis}" if is_root else f"{body.name}_{axis}"
            # What the robot stands on is in series before its first joint, wherever that is turned.
            joints.insert(0 if is_root else len(joints), Joint(name, axis, stiff))  # type: ignore[arg-type]
            names[f"k_{name}"] = name if is_root else f"torsion_{name}"
        bodies.append(replace(body, joints=tuple(joints)))
    return replace(robot, bodies=tuple(bodies)), names


def _difference(model: LinearModel, moved: LinearModel, step: float) -> Slope:
    """d / d angle of two models, in coordinates of the second that turn with the first's and have its inputs."""
    Z, Z_moved = (np.eye(m.n) if m.Z is None else m.Z for m in (model, moved))
    W = np.linalg.lstsq(Z_moved, Z)[0]
    if model.is_delayed:  # B of motors stays; a force at a frame turns with it
        W += np.linalg.pinv(moved.B.T) @ (model.B.T - moved.B.T @ W)

    def slope(before: FloatArray, after: FloatArray) -> FloatArray | None:
        change = (after - before) / step
        return change if np.any(np.abs(change) > 1e-9 * max(np.abs(before).max(initial=0.0), 1e-300)) else None

    pairs = [(getattr(model, letter), W.T @ getattr(moved, letter) @ W) for letter in "MDK"]
    return Slope(
        *(
            slope(*pair)
            for pair in (*pairs, (model.C, moved.C @ W), (model.tilt, moved.tilt @ W), (model.B, W.T @ moved.B))
        )
    )


@dataclass(frozen=True, eq=False)
class Evaluated:
    """One configuration at x: G (F, n_y, n_u) of the model and its derivatives, to x and by name to ln p or p.

    mixing: `Part.mixing`, for all that is whitened.
    """

    part: Part
    mixing: ComplexArray | None
    G: ComplexArray
    free: ComplexArray
    held: dict[str, ComplexArray] = field(default_factory=dict)

    @cached_property
    def rows(self) -> FloatArray:
        """J (n_x, N) of the free parameters."""
        return -self.whitened(self.free)

    @cached_property
    def information(self) -> FloatArray:
        """J J^T (n_x, n_x)."""
        return self.rows @ self.rows.T

    def whitened(self, slopes: ComplexArray) -> FloatArray:
        """-dr (n, N) of changes of G (n, F, n_y, n_u), N real numbers: those that count and zeros."""
        part = self.part
        # A logarithm of an element that is left out because it is zero has no slope.
        slope = np.where(part.gain > 0, RESIDUALS[part.criterion](part.measured, self.G)[1], 0.0)
        return _flat(self.mixing, part.gain * slope * slopes)

    @property
    def residual(self) -> FloatArray:
        """r (N,)."""
        part = self.part
        e = RESIDUALS[part.criterion](part.measured, self.G)[0]
        r = np.where(part.gain > 0, part.gain * np.where(part.gain > 0, e, 0.0), 0.0)
        return np.asarray(_flat(self.mixing, r[None])[0])


@dataclass(frozen=True, eq=False)
class HeldResponse:
    """G (F, n_y, n_u) of the model in one configuration, as the `columns` of a hypothesis get it.

    slopes: dG by name of the parameters of `model`.  theta (n,): their values, SI.  loads: of `HeldModel`.
    """

    robot: Robot
    model: LinearModel
    theta: FloatArray
    freq_hz: FloatArray
    G: ComplexArray
    slopes: Mapping[str, ComplexArray]
    loads: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def value(self, name: str) -> float:
        """The value of a number of the equations, 0 where it has none."""
        return float(self.theta[self.model.parameters.index(name)]) if name in self.model.parameters else 0.0


def evaluate_held(
    held: HeldModel,
    fitted: Parameters,
    x: FloatArray,
    columns: Sequence[Callable[[HeldResponse], Mapping[str, ComplexArray]]],
    part: Part,
) -> Evaluated:
    """One configuration of a fit with these parameters, on its lines, at x (n_x,); columns: of the hypotheses."""
    model, theta = held.at(fitted, part.kernel.model, x)
    known = {DELAY, *model.gains, *(element.name for element in model.chain), *model.slopes}
    kernel = Kernel(model, part.kernel.freq_hz, tuple(name for name in model.parameters if name in known))
    G, dG = kernel.evaluate(theta)
    by_name = dict(zip(kernel.wanted, dG, strict=True))
    chain, numbers = fitted.jacobian(x, part.configuration), dict(by_name)
    free = np.zeros((chain.shape[1], *G.shape), complex)
    # An entry of an inertia moves with all others by their common factor, and may be off alone, too.
    tied = {p.name for p in fitted if p.tie is not None and fitted[p.tie.to].tolerated}
    for name, row in zip(fitted.names, chain, strict=True):
        if name in by_name and np.any(row):
            if name not in tied:
                del numbers[name]
            for k in np.flatnonzero(row):
                free[k] += row[k] * by_name[name]
    for name in held.rigid:  # springs that the robot does not have are free of friction
        numbers.pop(name.replace("k_", "d_", 1), None)
        numbers.pop(name.replace("k_", "f_", 1), None)
    response = HeldResponse(held.linearisation.model.robot, model, theta, kernel.freq_hz, G, by_name, held.loads)
    for further in columns:
        numbers |= further(response)
    return Evaluated(part, part.mixing, G, free, numbers)


def _flat(mixing: ComplexArray | None, values: ComplexArray) -> FloatArray:
    """Elements (n, F, n_y, n_u), mixed line by line, as real rows (n, N)."""
    return as_real((values if mixing is None else mixed(mixing, values)).reshape(len(values), -1))
