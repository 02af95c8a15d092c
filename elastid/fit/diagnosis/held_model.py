r"""HeldModel: linear models of a fit with the numbers that it held as parameters, of robot, postures and logs.

Apart from the robot's own numbers, its geometry and the gains of its channels these are:

- angle_2: an offset of the angle at which axis 2 stood, in all configurations; angle_2@c1: in one.
- payload: a point mass at the tool, where the robot carries none.
- torsion_arm_x: the compliance 1 / k of an elastic rotation about x before the body arm, gear_2: of a rigid gear.
- loop_2: the square of the bandwidth omega_2 of a position loop of motor 2, which makes a spring of omega_2^2 M_22
  between it and the ground; where the torque that was logged is the loop's reference.
- rate: a sampling rate 1 + e of the stated one. Frequencies are then 1 + e of those read, and motions that were
  differentiated from positions (1 + e)^2 (`sensitivities`):

.. math:: \omega \frac{\partial}{\partial \omega}: \quad dK = -2 K\, d\epsilon, \; dD = -D\, d\epsilon

A stiff spring stands in for a rigid coordinate: dK = -k^2 dc (...).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError
from elastid.fit.problem.elastic import at_measured_places
from elastid.fit.setup.assembly import Assembly
from elastid.linear.linear_model import DELAY, LinearModel, Slope
from elastid.linear.linearise import Linearisation
from elastid.parameters import ParameterSet
from elastid.record import Configuration
from elastid.robot import Body, Joint, Payload, Robot, Spring, gain_name

# rad: the step of finite differences over angles.
ANGLE_STEP = 1e-5
# A spring that stands in for a rigid coordinate: times the stiffest of the robot, or N*m/rad where there is none.
STIFF_FACTOR = 1e5
STIFF_DEFAULT = 1e6
RATE = "rate"
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class HeldModel:
    """linearisation: of the robot with its geometry, gains, a payload and stiff springs among the parameters.

    rigid: the parameters of the stiff springs, k_arm_x, and the name of the compliance that each stands for.
    """

    linearisation: Linearisation
    rigid: dict[str, str]

    @classmethod
    def of(cls, assembly: Assembly, fitted: LinearModel) -> HeldModel:
        """Formulate the extended equations; without what they cannot have: torsions, a payload, geometry.

        fitted: the model of a configuration of the fit.
        """
        robot = assembly.linearisation.model.robot
        channels = [gain_name("u", at) for at in robot.motor_locations]
        outputs = {place for response in assembly.responses for place in response.outputs}
        channels += [gain_name("y", at) for at in sorted(outputs) if at in robot.locations]
        refused: ElastidError | ValueError | None = None
        for (extended, rigid), geometry in (
            (_with_torsions(_with_payload(robot)), tuple(robot.geometry)),
            ((_with_payload(robot), {}), tuple(robot.geometry)),
            ((_with_payload(robot), {}), assembly.parameters.names),
            ((robot, {}), assembly.parameters.names),
        ):
            try:
                held = cls(Linearisation.of_robot(extended, assembly.model, (*geometry, *channels)), rigid)
                held.at(assembly.parameters, fitted, assembly.parameters.x)
            except (ElastidError, ValueError) as error:
                refused = error
            else:
                return held
        raise refused or AssertionError

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta: those of the equations, the delay, offsets of the angles, the rate."""
        robot = self.linearisation.model.robot
        further = (f"{word}_{joint.name}" for word in ("angle", "loop") for joint in robot.driven)
        return (*self.linearisation.model.parameters, DELAY, *further, RATE)

    def theta(self, fitted: ParameterSet, x: FloatArray, configuration: str) -> FloatArray:
        """The numbers (n,) in SI where x (n_x,) is the estimate."""
        model = self.linearisation.model
        estimates = dict(zip(fitted.names, fitted.expand(x, configuration).tolist(), strict=True))
        nominal = dict(zip(model.parameters, model.theta.tolist(), strict=True))
        return np.array([estimates.get(name, nominal.get(name, 0.0)) for name in self.parameters])

    def at(self, fitted: ParameterSet, measured: LinearModel, x: FloatArray) -> tuple[LinearModel, FloatArray]:
        """The linear model of a configuration with slopes to all of `parameters`, and theta (n,).

        measured: its model in the fit, whose inputs and outputs are those measured.
        """
        theta = self.theta(fitted, x, measured.configuration.name)
        own = theta[: len(self.linearisation.model.parameters)]

        def model_at(configuration: Configuration, linearisation: Linearisation) -> LinearModel:
            places = linearisation.at(configuration, own, measured.outputs, measured.quantity)
            return at_measured_places(places, measured)

        model = model_at(measured.configuration, self.linearisation)
        slopes = dict(model.slopes) | {RATE: Slope(D=-model.D, K=-2 * model.K)}
        for name in self.rigid:
            k = model.number(np.append(own, 0.0), name)
            slopes[name] = _times(slopes[name], -(k**2))
        for place, joint in enumerate(self.linearisation.model.robot.driven):
            angles = np.array(measured.configuration.angles)
            angles[place] += ANGLE_STEP
            moved = model_at(replace(measured.configuration, angles=angles), self.linearisation.without_slopes)
            slopes[f"angle_{joint.name}"] = _difference(model, moved, ANGLE_STEP)
            slopes |= _position_loop(model, joint.name)
        theta_ref = np.concatenate([own, np.zeros(len(self.parameters) - len(own))])
        return replace(model, parameters=self.parameters, theta_ref=theta_ref, slopes=slopes), theta


def _with_payload(robot: Robot) -> Robot:
    """The robot with a payload of no mass at its tool, or at its last body, where it carries none."""
    if robot.payload is not None:
        return robot
    tools = [frame.name for frame in robot.frames if frame.name == "tool"]
    return replace(robot, payload=Payload(0.0, at=(tools or [robot.bodies[-1].name])[0]))


def _with_torsions(robot: Robot) -> tuple[Robot, dict[str, str]]:
    """The robot with stiff springs in rigid gears and about the free axes of bodies outside loops; their parameters."""
    springs = [joint.spring.stiffness for joint in robot.joints if joint.spring is not None and not joint.slides]
    stiff = Spring(STIFF_FACTOR * max(springs, default=STIFF_DEFAULT / STIFF_FACTOR))
    within = {robot.joints[i].name for i in robot.joints_in_loops}
    names: dict[str, str] = {}

    def sprung(body: Body) -> Body:
        """The body with a stiff spring in each rigid gear and about each axis that its joints leave free."""
        if any(joint.name in within for joint in body.joints):
            return body
        joints = []
        for joint in body.joints:
            if joint.motor is not None and not joint.is_flexible and not joint.slides:
                names[f"k_{joint.name}"] = f"gear_{joint.name}"
                joint = replace(joint, spring=stiff)
            joints.append(joint)
        taken = [joint.axis for joint in body.joints]
        for axis in "xyz":
            if axis not in taken and _AXES[axis] not in taken:
                names[f"k_{body.name}_{axis}"] = f"torsion_{body.name}_{axis}"
                joints.append(Joint(f"{body.name}_{axis}", axis, stiff))  # type: ignore[arg-type]
        return replace(body, joints=tuple(joints))

    return replace(robot, bodies=tuple(sprung(body) for body in robot.bodies)), names


def _position_loop(model: LinearModel, joint: str) -> dict[str, Slope]:
    """The stiffness per squared bandwidth: the inertia that the motor moves where all springs are rigid."""
    if f"motor {joint}" not in model.inputs:
        return {}
    b = model.B[:, model.inputs.index(f"motor {joint}")]
    return {f"loop_{joint}": Slope(K=np.outer(b, b) / float(b @ np.linalg.solve(model.M, b)))}


def _times(slope: Slope, factor: float) -> Slope:
    parts = {letter: getattr(slope, letter) for letter in "MDKCT"}
    return Slope(**{letter: None if part is None else factor * part for letter, part in parts.items()})


def _difference(model: LinearModel, moved: LinearModel, step: float) -> Slope:
    """d / d angle of two models, in coordinates of the second that turn with the first's and have its inputs."""
    Z, Z_moved = (np.eye(m.n) if m.Z is None else m.Z for m in (model, moved))
    W = np.linalg.lstsq(Z_moved, Z)[0]
    W += np.linalg.pinv(moved.B.T) @ (model.B.T - moved.B.T @ W)

    def slope(before: FloatArray, after: FloatArray) -> FloatArray | None:
        change = (after - before) / step
        return change if np.any(np.abs(change) > 1e-9 * max(np.abs(before).max(initial=0.0), 1e-300)) else None

    pairs = [(getattr(model, letter), W.T @ getattr(moved, letter) @ W) for letter in "MDK"]
    return Slope(*(slope(*pair) for pair in (*pairs, (model.C, moved.C @ W), (model.tilt, moved.tilt @ W))))
