r"""Extended model: the fixed numbers of a fit as parameters of its equations, and the derivatives of the response.

Apart from the numbers of the robot, its geometry and the gains of its channels these are:

- angle_2@c1: offset of the angle of axis 2 in configuration c1; zero_2: in all configurations.
- torsion_arm_x: compliance 1 / k of an elastic rotation about x before the body arm.  gear_2: of a rigid gear.
- base_x: compliance of the base about the x axis of the first body at zero angle.

A rigid coordinate is a stiff spring with dK/dc = -k^2 dK/dk, c = 1 / k.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, values_by_name
from elastid.base.errors import ElastidError
from elastid.fit.diagnosis.refit import EvaluatedResponse
from elastid.fit.frf_problem import Assembly
from elastid.fit.problem.frf_residuals import FrfResiduals, at_measured_places, map_chunks, places_of
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import LinearModel, Slope
from elastid.linear.linearise import Linearisation
from elastid.linear.presliding import element_names
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.parameters import DELAY, Parameters
from elastid.robot import Body, Joint, Robot, Spring, channel_name


@dataclass(frozen=True, eq=False)
class ExtendedModel:
    """Equations of the fitted robot with geometry, gains and stiff springs as parameters.

    rigid: name of the compliance by the stiffness of each stiff spring (k_arm_x: torsion_arm_x).
    loads: static torque of each driven joint, N m, by configuration.
    """

    linearisation: Linearisation
    rigid: dict[str, str]
    loads: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, assembly: Assembly, model: LinearModel) -> ExtendedModel:
        """Build the extended equations for the model of one configuration; without torsions if these fail."""
        robot = assembly.robot
        roles = ("u",) if model.controller is None else ("kp", "kd")
        channels = [channel_name("gain", role, location) for role in roles for location in robot.motor_locations]
        outputs = {location for response in assembly.responses for location in response.outputs}
        channels += [channel_name("gain", "y", location) for location in sorted(outputs) if location in robot.locations]
        channels += [name for name in assembly.parameters.names if name in set(robot.channel_numbers) - set(channels)]
        for flexible, rigid in (_with_torsions(robot), (robot, {})):
            with suppress(ElastidError, ValueError):
                plain = Linearisation.of_robot(flexible, assembly.model, (*robot.geometry, *channels))
                extended = cls(replace(plain, presliding=assembly.linearisation.presliding), rigid)
                theta = extended.theta(assembly.parameters, assembly.parameters.x, model.configuration.name)
                extended.linearisation.at(model.configuration, theta[:-1], places_of(model), model.quantity)
                return replace(extended, loads=_loads(assembly))
        free_names = (*assembly.parameters.names, *channels)
        return cls(Linearisation.of_robot(robot, assembly.model, free_names), {}, _loads(assembly))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta: parameters of the equations, and the delay."""
        return (*self.linearisation.parameters, DELAY)

    def theta(self, parameters: Parameters, x: FloatArray, configuration: str) -> FloatArray:
        """Return the numbers (n,) in SI for the estimate x (n_x,)."""
        model = self.linearisation.model
        estimates = values_by_name(parameters.names, parameters.expand(x, configuration))
        nominal = values_by_name(model.parameters, model.theta)
        return np.array([estimates.get(name, nominal.get(name, 0.0)) for name in self.parameters])

    def at(self, parameters: Parameters, measured: LinearModel, x: FloatArray) -> tuple[LinearModel, FloatArray]:
        """Return the linear model of a configuration with slopes to all of `parameters`, and theta (n,).

        measured: model of the configuration in the fit, with the measured inputs and outputs.
        """
        theta = self.theta(parameters, x, measured.configuration.name)
        model = self.linearisation.at(measured.configuration, theta[:-1], places_of(measured), measured.quantity)
        model = at_measured_places(model, measured)
        slopes = dict(model.slopes)
        for name in self.rigid:
            k = model.number(theta, name)
            stiff = {letter: getattr(slopes[name], letter) for letter in "MDKCTB"}
            slopes[name] = Slope(
                **{letter: None if matrix is None else -(k**2) * matrix for letter, matrix in stiff.items()}
            )
        return replace(model, slopes=slopes), theta


def _loads(assembly: Assembly) -> dict[str, dict[str, float]]:
    model, configurations = assembly.linearisation.model, [G.configuration for G in assembly.responses]
    equilibrium_of = partial(equilibrium, model, assembly.parameters.theta[: len(model.parameters)])
    points, joints = map_chunks(equilibrium_of, configurations, assembly.home), model.robot.driven_names
    return {point.configuration.name: values_by_name(joints, point.u) for point in points}


def _with_torsions(robot: Robot) -> tuple[Robot, dict[str, str]]:
    """Add stiff springs to rigid gears and about free axes of bodies outside loops; returns robot and parameters."""
    springs = [joint.spring.stiffness for joint in robot.joints if joint.spring is not None]
    stiff = Spring(1e5 * max(springs, default=10.0))  # N*m/rad; springs in N/m are taken at a lever of 1 m
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
            # The compliance of the base is before the first joint, fixed in space.
            joints.insert(0 if is_root else len(joints), Joint(name, axis, stiff))  # type: ignore[arg-type]
            names[f"k_{name}"] = name if is_root else f"torsion_{name}"
        bodies.append(replace(body, joints=tuple(joints)))
    return replace(robot, bodies=tuple(bodies)), names


@dataclass(frozen=True, eq=False)
class ModelResponse:
    """Modelled response G (F, n_y, n_u) of one configuration, the argument of `Hypothesis.columns`.

    slopes: derivative of G by parameter of `model`.  theta (n,): their values, SI.  loads: see `ExtendedModel`.
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
        return self.model.number(self.theta, name, absent=0.0)


def evaluate_extended(
    extended: ExtendedModel, parameters: Parameters, x: FloatArray,
    columns: Sequence[Callable[[ModelResponse], Mapping[str, ComplexArray]]], frf: FrfResiduals,
) -> EvaluatedResponse:  # fmt: skip
    """Evaluate one configuration at x (n_x,), with derivatives to fixed numbers.  columns: see `Hypothesis`."""
    model, theta = extended.at(parameters, frf.kernel.model, x)
    varied = {DELAY, *model.channel_numbers, *(element.name for element in model.chain), *model.slopes}
    kernel = Kernel(model, frf.kernel.freq_hz, tuple(name for name in model.parameters if name in varied))
    G, dG = Columns(kernel).evaluate(theta)
    by_name = dict(zip(kernel.parameters, dG, strict=True))
    chain, numbers = parameters.jacobian(x, frf.configuration), dict(by_name)
    free = np.zeros((chain.shape[1], *G.shape), complex)
    # An entry of an inertia that follows a common factor can also have an error of its own.
    followers = {p.name for p in parameters if p.tie is not None and parameters[p.tie.to].is_nuisance}
    for name, row in zip(parameters.names, chain, strict=True):
        if name in by_name and np.any(row):
            if name not in followers:
                del numbers[name]
            for k in np.flatnonzero(row):
                free[k] += row[k] * by_name[name]
    for name in element_names(extended.linearisation.presliding):
        numbers.pop(name, None)
    for name in extended.rigid:  # the added stiff springs have no damping and no friction
        numbers.pop(name.replace("k_", "d_", 1), None)
        numbers.pop(name.replace("k_", "f_", 1), None)
    response = ModelResponse(
        extended.linearisation.model.robot, model, theta, kernel.freq_hz, G, by_name, extended.loads
    )
    for further in columns:
        numbers |= further(response)
    return EvaluatedResponse(frf, frf.mixing, G, free, numbers)
