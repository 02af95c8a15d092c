r"""Residuals at the optimum and their derivatives to everything that the fit held.

`ExtendedModel` has the numbers that the fit held as parameters of its equations.  Apart from the robot's own numbers,
its geometry and the gains of its channels these are:

- angle_2@c1: an offset of the angle at which axis 2 stood in configuration c1; zero_2 is one in all of them.
- torsion_arm_x: the compliance 1 / k of an elastic rotation about x before the body arm, gear_2: of a rigid gear.
- base_x: that of what the robot stands on, about x of its first body before it turns.

A stiff spring stands in for a rigid coordinate: dK = -k^2 dc (...).

Of numbers that need no model of their own, the `columns` of hypotheses, derivatives follow from the response itself:

.. math:: \text{delay of an output or input}: \; -j \omega G \text{ in its row or column}

.. math:: \text{ratio of motor } i: \quad \dot S G + G \dot S^T
          + 2 \Big( J_m \frac{\partial G}{\partial J_m} + f_m \frac{\partial G}{\partial f_m} + \ldots \Big),
          \qquad \dot S = E^{-1} e_i e_i^T E

since torque and angle were referred to the link side by the wrong ratio.

A reading changes the responses of the model, data and weights stay: V of every reading after one Gauss-Newton step
follows from one evaluation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import permutations
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, named
from elastid.base.errors import ElastidError
from elastid.base.execution import HERE
from elastid.fit.frf_problem import Assembly
from elastid.fit.problem.frf_residuals import ElasticFit, Part, at_measured_places, each_at_home, places_of
from elastid.fit.problem.least_squares import Evaluation, LeastSquares, as_real
from elastid.fit.solve.solvers import ROUGH, trust_region
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import DELAY, LinearModel, Slope
from elastid.linear.linearise import Linearisation
from elastid.linear.presliding import element_names
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.parameters import Parameters
from elastid.robot import Body, Joint, Robot, Spring, channel_name


@dataclass(frozen=True, eq=False)
class ExtendedModel:
    """linearisation: robot with geometry, gains and stiff springs as parameters.

    rigid: the parameters of the stiff springs, k_arm_x, and the name of the compliance that each stands for.
    loads: the torque at rest of each driven joint, N m, by configuration.
    """

    linearisation: Linearisation
    rigid: dict[str, str]
    loads: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, assembly: Assembly, fitted: LinearModel) -> ExtendedModel:
        """The extended equations, without torsions or geometry where impossible; fitted: one of the fit."""
        robot = assembly.linearisation.model.robot
        roles = ("u",) if fitted.controller is None else ("kp", "kd")
        channels = [channel_name("gain", role, place) for role in roles for place in robot.motor_locations]
        outputs = {place for response in assembly.responses for place in response.outputs}
        channels += [channel_name("gain", "y", place) for place in sorted(outputs) if place in robot.locations]
        channels += [name for name in assembly.parameters.names if name in set(robot.channel_numbers) - set(channels)]
        for extended, rigid in (_with_torsions(robot), (robot, {})):
            with suppress(ElastidError, ValueError):
                plain = Linearisation.of_robot(extended, assembly.model, (*robot.geometry, *channels))
                held = cls(replace(plain, presliding=assembly.linearisation.presliding), rigid)
                theta = held.theta(assembly.parameters, assembly.parameters.x, fitted.configuration.name)
                held.linearisation.at(fitted.configuration, theta[:-1], places_of(fitted), fitted.quantity)
                return replace(held, loads=_loads(assembly))
        free_names = (*assembly.parameters.names, *channels)
        return cls(Linearisation.of_robot(robot, assembly.model, free_names), {}, _loads(assembly))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta: parameters of the equations, and the delay."""
        return (*self.linearisation.parameters, DELAY)

    def theta(self, fitted: Parameters, x: FloatArray, configuration: str) -> FloatArray:
        """The numbers (n,) in SI where x (n_x,) is the estimate."""
        model = self.linearisation.model
        estimates = named(fitted.names, fitted.expand(x, configuration))
        nominal = named(model.parameters, model.theta)
        return np.array([estimates.get(name, nominal.get(name, 0.0)) for name in self.parameters])

    def at(self, fitted: Parameters, measured: LinearModel, x: FloatArray) -> tuple[LinearModel, FloatArray]:
        """The linear model of a configuration with slopes to all of `parameters`, and theta (n,).

        measured: its model in the fit, whose inputs and outputs are those measured.
        """
        theta = self.theta(fitted, x, measured.configuration.name)
        model = self.linearisation.at(measured.configuration, theta[:-1], places_of(measured), measured.quantity)
        model = at_measured_places(model, measured)
        slopes = dict(model.slopes)
        for name in self.rigid:
            k = model.number(theta, name)
            stiff = {letter: getattr(slopes[name], letter) for letter in "MDKCTB"}
            slopes[name] = Slope(**{letter: None if part is None else -(k**2) * part for letter, part in stiff.items()})
        return replace(model, slopes=slopes), theta


def _loads(assembly: Assembly) -> dict[str, dict[str, float]]:
    model, configurations = assembly.linearisation.model, [G.configuration for G in assembly.responses]
    at_rest = partial(equilibrium, model, assembly.parameters.theta[: len(model.parameters)])
    points, joints = each_at_home(at_rest, configurations, assembly.home), model.robot.driven_names
    return {point.configuration.name: named(joints, point.u) for point in points}


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
            if axis in axes or tuple(np.eye(3)["xyz".index(axis)].tolist()) in axes:
                continue
            name = f"base_{axis}" if is_root else f"{body.name}_{axis}"
            # What the robot stands on is in series before its first joint, wherever that is turned.
            joints.insert(0 if is_root else len(joints), Joint(name, axis, stiff))  # type: ignore[arg-type]
            names[f"k_{name}"] = name if is_root else f"torsion_{name}"
        bodies.append(replace(body, joints=tuple(joints)))
    return replace(robot, bodies=tuple(bodies)), names


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

    def whitened(self, slopes: ComplexArray) -> FloatArray:
        """-dr (n, N) of changes of G (n, F, n_y, n_u), N real numbers: those that count and zeros."""
        return as_real(-self.part.slopes(self.G, slopes, self.mixing).reshape(len(slopes), -1))

    @property
    def residual(self) -> FloatArray:
        """r (N,)."""
        return as_real(self.part.residual(self.G, self.mixing).ravel())


@dataclass(frozen=True, eq=False)
class ModelResponse:
    """G (F, n_y, n_u) of the model in one configuration, as the `columns` of a hypothesis get it.

    slopes: dG by name of the parameters of `model`.  theta (n,): their values, SI.  loads: of `ExtendedModel`.
    """

    robot: Robot
    model: LinearModel
    theta: FloatArray
    freq_hz: FloatArray
    G: ComplexArray
    slopes: Mapping[str, ComplexArray]
    loads: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def value(self, name: str) -> float:
        """Return the value of a parameter of the equations; 0 if absent."""
        return float(self.theta[self.model.parameters.index(name)]) if name in self.model.parameters else 0.0


def evaluate_extended(
    held: ExtendedModel,
    fitted: Parameters,
    x: FloatArray,
    columns: Sequence[Callable[[ModelResponse], Mapping[str, ComplexArray]]],
    part: Part,
) -> Evaluated:
    """One configuration of a fit at x (n_x,), on its lines; columns: hypotheses."""
    model, theta = held.at(fitted, part.kernel.model, x)
    known = {DELAY, *model.channel_numbers, *(element.name for element in model.chain), *model.slopes}
    kernel = Kernel(model, part.kernel.freq_hz, tuple(name for name in model.parameters if name in known))
    G, dG = Columns(kernel).evaluate(theta)
    by_name = dict(zip(kernel.wanted, dG, strict=True))
    chain, numbers = fitted.jacobian(x, part.configuration), dict(by_name)
    free = np.zeros((chain.shape[1], *G.shape), complex)
    # An entry of an inertia moves with all others by their common factor, and may be off alone, too.
    tied = {p.name for p in fitted if p.tie is not None and fitted[p.tie.to].is_nuisance}
    for name, row in zip(fitted.names, chain, strict=True):
        if name in by_name and np.any(row):
            if name not in tied:
                del numbers[name]
            for k in np.flatnonzero(row):
                free[k] += row[k] * by_name[name]
    for name in element_names(held.linearisation.presliding):
        numbers.pop(name, None)
    for name in held.rigid:  # springs that the robot does not have are free of friction
        numbers.pop(name.replace("k_", "d_", 1), None)
        numbers.pop(name.replace("k_", "f_", 1), None)
    response = ModelResponse(held.linearisation.model.robot, model, theta, kernel.freq_hz, G, by_name, held.loads)
    for further in columns:
        numbers |= further(response)
    return Evaluated(part, part.mixing, G, free, numbers)


# Of the smallest torque that a gear carries to the largest, above which no stiffness is seen to rise with it.
LOAD_RATIO = 0.97
NO_LOAD = 0.01  # of the largest torque, below which a gear carries none


def channel_delays(response: ModelResponse) -> dict[str, ComplexArray]:
    """Derivatives to the delay of each output and input in s; a single one is the delay of all."""
    s, model, columns = 2j * np.pi * response.freq_hz[:, None, None], response.model, dict[str, ComplexArray]()
    for role, places, axis in (("y", model.outputs, 1), (model.input_role, model.driven, 2)):
        for i, place in enumerate(places if len(places) > 1 else ()):
            mask = np.zeros((1, len(model.outputs), len(model.inputs)))
            mask[(slice(None),) * axis + (i,)] = 1.0
            columns[channel_name("delay", role, place)] = (s if role == "u" else -s) * mask * response.G
    return columns if model.controller is None else columns | {channel_name("delay", "r"): -s * response.G}


def gear_ratios(response: ModelResponse) -> dict[str, ComplexArray]:
    """Derivatives to the logarithm of each gear ratio."""
    robot, model, G, slopes = response.robot, response.model, response.G, response.slopes
    values = named(model.parameters, response.theta)
    inverse, columns = np.linalg.inv(robot.mixing), {}
    for i, joint in enumerate(robot.driven):
        turn = np.outer(inverse[:, i], robot.mixing[i])
        left, right = (_between(turn, robot, places) for places in (model.outputs, model.inputs))
        scaled = [f"{letters}_{joint.name}" for letters in ("Jm", "fm", "km", "dm")]
        moved = sum((2 * values[name] * slopes[name] for name in scaled if name in slopes), np.zeros_like(G))
        columns[f"ratio_{joint.name}"] = left @ G + G @ right.T + moved
    return columns


def posture_angles(response: ModelResponse) -> dict[str, ComplexArray]:
    """Derivatives to the angle of each axis in this configuration alone, rad."""
    name = response.model.configuration.name
    zeros = {joint.name: f"zero_{joint.name}" for joint in response.robot.driven}
    return {f"angle_{joint}@{name}": response.slopes[zero] for joint, zero in zeros.items() if zero in response.slopes}


def of_one_posture(response: ModelResponse) -> dict[str, ComplexArray]:
    """Return derivatives with respect to values of this configuration only.

    delay@c1 of all its channels, s; torques@c1: ln of the torques that are read per torque; spring_1@c1: ln k_1;
    m_fore@c1 ...: the numbers of the last body, which carries a load.  None of a single configuration.
    """
    name, robot, last = response.model.configuration.name, response.robot, response.robot.bodies[-1]
    if len(response.loads) < 2:
        return {}
    columns = {f"{DELAY}@{name}": -2j * np.pi * response.freq_hz[:, None, None] * response.G}
    columns[f"torques@{name}"] = -response.G
    for joint in robot.driven:
        if (spring := f"k_{joint.name}") in response.slopes:
            columns[f"spring_{joint.name}@{name}"] = response.value(spring) * response.slopes[spring]
    carried = {number: response.slopes[number] for number in inertial(last) if number in response.slopes}
    return columns | {f"{number}@{name}": column for number, column in carried.items()}


def inertial(body: Body) -> list[str]:
    """Names of the mass, the centre of mass and the inertia of a body."""
    entries = (f"I_{body.name}{suffix}" for suffix in body.inertia_entries)
    return [f"m_{body.name}", *(f"c_{body.name}_{axis}" for axis in "xyz"), *entries]


def stiffening(response: ModelResponse) -> dict[str, ComplexArray]:
    r"""Derivatives to the change of each gear's stiffness with the torque tau that it carries.

    load_2, of a gear that hardens, and play_2, of one with backlash, whose tangent is soft near no torque:

    .. math:: k\, (1 + e\, \tau^2 / \tau_{max}^2), \qquad k\, (1 - e\, \tau_{min}^4 / \tau^4)
    """
    columns = {}
    for joint in response.robot.driven_names:
        loads = {name: abs(torques[joint]) for name, torques in response.loads.items()}
        most, spring = max(loads.values(), default=0.0), f"k_{joint}"
        if most > 0 and min(loads.values()) < LOAD_RATIO * most and spring in response.slopes:
            load, least = loads[response.model.configuration.name], max(min(loads.values()), NO_LOAD * most)
            slope = response.value(spring) * response.slopes[spring]
            columns[f"load_{joint}"] = (load / most) ** 2 * slope
            columns[f"play_{joint}"] = -((least / max(load, least)) ** 4) * slope
    return columns


def gear_couplings(response: ModelResponse) -> dict[str, ComplexArray]:
    """Derivatives to the turns of motor i, link side, per turn of joint j, where the file couples them by no gear."""
    robot, model, G, s = response.robot, response.model, response.G, 2j * np.pi * response.freq_hz[:, None, None]
    driven, inverse, columns = robot.driven, np.linalg.inv(robot.mixing), dict[str, ComplexArray]()
    places = model.outputs
    if model.inputs != places or model.quantity != "acceleration" or not set(places) <= set(robot.motor_locations):
        return {}
    rotors = [(response.value(f"Jm_{j.name}"), response.value(f"fm_{j.name}")) for j in driven]
    squared = [abs(j.motor.ratio) ** 2 if j.motor is not None else 0.0 for j in driven]
    for i, j in permutations(range(len(driven)), 2):
        turn = inverse[:, [i]] * np.eye(len(driven))[j]
        rows, columns_of = (_between(turn, robot, p) for p in (places, places))
        rotor = squared[i] * (rotors[i][0] + rotors[i][1] / s)
        pair = np.outer(robot.mixing[i], np.eye(len(driven))[j])
        moved = _between(pair + pair.T, robot, places)
        columns[f"coupling_{driven[i].name}_{driven[j].name}"] = rows @ G + G @ columns_of.T - rotor * (G @ moved @ G)
    return columns


def _between(turn: FloatArray, robot: Robot, places: tuple[str, ...]) -> FloatArray:
    """The entries of a matrix over motors (n_u, n_u) between places, zero for other places."""
    index = [robot.motor_locations.index(place) if place in robot.motor_locations else -1 for place in places]
    return np.array([[turn[i, j] if min(i, j) >= 0 else 0.0 for j in index] for i in index])


Change: TypeAlias = Callable[[Evaluated, ComplexArray], ComplexArray]  # of arrays (..., F, n_y, n_u)

STEP_STD = 0.5  # of the prior of ln p that keeps a step near, and a stiffness near its start, at residuals of a misfit
STEPS = 12  # of the solver with a reading


@dataclass(frozen=True, eq=False)
class Reading:
    """A way to read the responses: name, in words, family, and the change of the model's response.

    order: the configuration whose model each measured response is of, where postures are exchanged.
    """

    name: str
    family: str
    change: Change
    order: tuple[int, ...] = ()


AS_READ = Reading("as read", "", lambda _, values: values)


# Configurations that a judgement of all together takes; of more, every so many.
CONFIGURATIONS = 32


def spread_out(count: int) -> slice:
    """So many of a number of configurations, spread over all of them."""
    return slice(None, None, max(1, math.ceil(count / CONFIGURATIONS)))


def thinned(fit: ElasticFit, residuals: int = 8_000) -> ElasticFit:
    """The fit on every so many lines of each configuration, about so many real residuals in total.

    Without static load tests, which say nothing about readings of the responses.
    """
    return replace(fit, parts=tuple(map(thinning(fit, residuals), fit.parts)), loads=None, home=HERE)


def thinning(fit: ElasticFit, residuals: int) -> Callable[[Part], Part]:
    """Function from a part to every so many of its lines, about so many real residuals in total.

    At least 20 lines each, 5 of very many configurations: V of one by itself is judged, too.
    """
    every, least = max(1, math.ceil(fit.n_residuals / residuals)), max(5, min(20, 1280 // max(1, len(fit.parts))))
    return partial(_thin, every, least)


def _thin(every: int, least: int, part: Part) -> Part:
    lines = slice(None, None, min(every, max(1, len(part.measured) // least)))
    kernel = replace(part.kernel, freq_hz=part.kernel.freq_hz[lines])
    whitening = part.whitening and part.whitening.lines(lines)
    return replace(
        part, columns=Columns(kernel), measured=part.measured[lines], gain=part.gain[lines], whitening=whitening
    )


def evaluate(fit: ElasticFit, x: FloatArray) -> list[Evaluated]:
    """Every configuration at x (n_x,), with derivatives to the free parameters alone."""
    evaluated = []
    for part in (part for part in fit.parts if part.n_residuals):
        G, slopes = part.columns.evaluate(part.theta(fit.parameters, x))
        chain = fit.parameters.jacobian(x, part.configuration)[part.kernel.places]
        evaluated.append(Evaluated(part, part.mixing, G, np.tensordot(chain.T, slopes, axes=1)))
    return evaluated


def start_distance(parameters: Parameters, x: FloatArray) -> float:
    """Return -2 ln of the prior density of the stiffnesses at x (n_x,), about their starting values in the study."""
    asked = (i for i, p in enumerate(parameters.free) if not p.is_nuisance and p.log and p.stands_for.startswith("k_"))
    return sum(2 * math.log1p(((x[i] - parameters.x[i]) / STEP_STD) ** 2) for i in asked)


def squares(evaluated: Sequence[Evaluated]) -> list[float]:
    """V of each configuration."""
    return [float(e.residual @ e.residual) for e in evaluated]


def predict(
    reading: Reading, evaluated: Sequence[Evaluated], prior: FloatArray, free: BoolArray
) -> tuple[float, FloatArray]:
    """V after one Gauss-Newton step (n_x,) of the free parameters, and that; prior (n_x,): 1 / s of theirs."""
    V, b, A = _normal_equations(reading, evaluated, prior, free)
    near = V / max(sum(e.part.n_residuals for e in evaluated), 1) / STEP_STD**2
    step = np.asarray(-np.linalg.solve(A + max(near, 1e-300) * np.eye(len(b)), b), dtype=float)
    return V + float(step @ (2 * b + A @ step)), step


def _normal_equations(
    reading: Reading, evaluated: Sequence[Evaluated], prior: FloatArray, free: BoolArray
) -> tuple[float, FloatArray, FloatArray]:
    """V, J^T r (n_x,) and J^T J (n_x, n_x) of a reading, its priors about where it stands."""
    V, b, A = 0.0, np.zeros(len(prior)), np.diag(prior**2)
    for i, measured in enumerate(evaluated):
        model = evaluated[reading.order[i]] if reading.order else measured
        changed = replace(measured, G=reading.change(measured, model.G))
        r, J = changed.residual, -changed.whitened(reading.change(measured, model.free)) * free[:, None]
        V, b, A = V + float(r @ r), b + J @ r, A + J @ J.T
    return V, b, A


def settle(reading: Reading, fit: ElasticFit, x: FloatArray, free: BoolArray) -> tuple[float, FloatArray]:
    """V and x (n_x,) of an optimum that the solver reaches from x, of the logarithms first."""

    def evaluation(problem: ElasticFit, x: FloatArray) -> Evaluation:
        V, b, A = _normal_equations(reading, evaluate(problem, x), fit.prior_slopes, free)
        return Evaluation(V, 2 * b, 2 * A)

    V = math.inf
    for problem in (replace(fit, parts=tuple(map(logarithmic, fit.parts))), fit):
        at = partial(evaluation, problem)
        end = trust_region(LeastSquares(fit.parameters, fit.n_residuals, at), x, at(x), ROUGH, STEPS, ~free)
        V, x = end.evaluation.cost, end.x
    return V, x


def logarithmic(part: Part) -> Part:
    """The part with the logarithmic criterion, element by element, no line with a weight above 10."""
    gain = np.minimum(part.gain * np.abs(part.measured), 10.0)
    return replace(part, criterion="log", gain=gain, whitening=None)
