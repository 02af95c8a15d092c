"""A fitted robot in a posture that need not have been measured: the equations, linearised there, and their ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError, did_you_mean, index_of
from elastid.linear.equilibrium import equilibrium, rigid_posture
from elastid.linear.fitted_model import Axes
from elastid.linear.linear_model import DELAY
from elastid.linear.linearise import Linearisation
from elastid.linear.loaded import moved_by, with_held_motors
from elastid.linear.posture_model import Doubt, Estimated, Ports, PostureModel
from elastid.model.elastic import ElasticModel
from elastid.model.kinematics import frame_poses
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameters
from elastid.record import MOTION_ORDER, Configuration, JointLoop, Motion, Motors
from elastid.robot import FRAME_AXES, TOOL, Frame, Payload, Robot
from elastid.robot.robot import with_frames
from elastid.simulation.controller import gains_of

Posture: TypeAlias = str | Configuration | Sequence[float] | Mapping[str, float] | FloatArray
_CHOICES = {"motors": ("held", "free", "controlled"), "axes": ("own", "world")}


@dataclass(frozen=True)
class Asked:
    """Ports, motors and payload of a prediction (`Result.at`).

    payload: None for that of the fitted robot, False for none, or another one.
    """

    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    motors: Motors = "held"
    payload: Payload | Literal[False] | None = None
    frame: Frame | str | None = None
    axes: Axes = "own"
    quantity: Motion | None = None
    controller: Any = None

    def __post_init__(self) -> None:
        for key, words in _CHOICES.items():
            if getattr(self, key) not in words:
                raise ValueError(f"{key} is '{getattr(self, key)}'; give one of {', '.join(words)}")
        if self.motors == "controlled" and self.controller is None:
            raise ValueError(
                "motors are controlled, but by what? Give controller=study.experiment.simulated.controller, "
                "ControllerSpec(bandwidth_hz=...), or JointLoop(kp, kd, ki) of the drives"
            )


@dataclass(frozen=True, eq=False)
class Family:
    """A fitted robot with its ports, in any posture: equations built once.

    robot: with the frames and the payload that were asked for.  places: outputs of the linear models.
    """

    linearisation: Linearisation
    robot: Robot
    asked: Asked
    estimated: Estimated
    places: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    frame: str

    @classmethod
    def of(
        cls, robot: Robot, spec: ModelSpec, parameters: Parameters, x: FloatArray, covariance: FloatArray,
        asked: Asked, where: str = "", doubts: tuple[Doubt, ...] = (),
    ) -> Family:  # fmt: skip
        """Family of a fit; StudyError for places that the robot lacks.  where: configuration whose parameters count."""
        robot, frame = _with_frames(robot, asked)
        held = replace(robot, payload=asked.payload) if isinstance(asked.payload, Payload) else robot
        members = (name for doubt in doubts for name in doubt.members)
        linearisation = Linearisation.of_robot(held, spec, (*parameters.names, *members))
        names = (*linearisation.model.parameters, DELAY)
        carried = set(held.payload.numbers) if isinstance(asked.payload, Payload) and held.payload else set()
        known = [name in parameters.names and name not in carried for name in names]
        rows = np.flatnonzero(known)
        places_of = np.array([parameters.names.index(names[row]) for row in rows], np.int64)
        base = np.append(linearisation.model.theta, 0.0)
        estimated = Estimated(parameters, x, covariance, names, base, rows, places_of, where, doubts)
        inputs = asked.inputs or tuple(f"force {frame} {axis}" for axis in "xyz")
        outputs = asked.outputs or tuple(f"frame {frame} {axis}" for axis in "xyz")
        frames = dict.fromkeys([frame, *(_frame_of(place) for place in (*inputs, *outputs) if _frame_of(place))])
        places = (
            *(f"frame {name} {axis}" for name in frames for axis in FRAME_AXES),
            *(f"accelerometer {name} {axis}" for name in _accelerometers(outputs) for axis in "xyz"),
            *(place for place in outputs if not place.startswith(("frame ", "accelerometer "))),
        )
        _check_ports(held, inputs, outputs, asked.motors)
        return cls(linearisation, held, asked, estimated, tuple(dict.fromkeys(places)), inputs, outputs, frame)

    @property
    def model(self) -> ElasticModel:
        """The equations."""
        return self.linearisation.model

    @property
    def theta(self) -> FloatArray:
        """theta (n_theta,) of the equations at the estimate, SI."""
        return self.estimated.theta(self.estimated.x)[:-1]

    @property
    def quantity(self) -> Motion:
        """Quantity of all outputs: accelerations with an accelerometer among them, else positions unless asked."""
        if not _accelerometers(self.outputs):
            return self.asked.quantity or "position"
        if self.asked.quantity not in (None, "acceleration"):
            raise StudyError(
                "fit/posture", f"an accelerometer reads acceleration, not {self.asked.quantity}; leave quantity out"
            )
        return "acceleration"

    def at(self, configuration: Configuration) -> PostureModel:
        """The model about the equilibrium of a posture; StudyError where there is none."""
        index_of(self.quantity, tuple(MOTION_ORDER), "quantity")
        if self.asked.payload is False:
            configuration = replace(configuration, carries=False)
        linear = self.linearisation.at(configuration, self.theta, self.places, self.quantity)
        ports = self._ports(configuration)
        moving = np.eye(linear.n) if self.asked.motors != "held" else with_held_motors(linear.B)
        if not moving.size:
            raise StudyError(
                "fit/posture",
                f"robot {self.robot.name} has no spring behind its motors, so that nothing moves while they are held; "
                "ask with motors='free' or motors='controlled'",
            )
        loop = self._loop(configuration) if self.asked.motors == "controlled" else None
        return PostureModel(linear, self.estimated, ports, moving, self.asked.motors, self.model.coordinates, loop)

    def _ports(self, configuration: Configuration) -> Ports:
        model, theta = self.model, self.theta
        q = equilibrium(model, theta, configuration).q[None, : len(self.robot.joints)]
        turned = model.robot_at(theta)
        rows = {place: i for i, place in enumerate(self.places)}
        motors = [place for place in self.inputs if place.startswith("motor ")]

        def row(place: str) -> FloatArray:
            """Row of a place, as a sum of `places`."""
            weights = np.zeros(len(rows))
            kind, _, rest = place.partition(" ")
            if kind in ("motor", "joint", "body") or self.asked.axes == "own":
                weights[rows[place]] = 1.0
                return weights
            name, _, axis = rest.rpartition(" ")
            R = frame_poses(turned, q, name).rotation[0]
            for own, share in zip("xyz", R["xyz".index(axis[-1])], strict=True):
                weights[rows[f"{kind} {name} {axis[:-1]}{own}"]] = share
            return weights

        # A torque about an axis turns the frame about it.
        acting = [moved_by(place) for place in self.inputs]
        act = np.array([np.zeros(len(rows)) if place in motors else row(place) for place in acting])
        by_motor = np.array([[float(place == motor) for motor in model.inputs] for place in self.inputs])
        read = np.array([row(place) for place in self.outputs])
        at_frame = np.array([row(f"frame {self.frame} {axis}") for axis in FRAME_AXES])
        slides = [*(place for place in self.inputs if place.startswith("force "))]
        sliding = (*slides, *self.robot.sliding((*self.outputs, *motors)))
        return Ports(self.inputs, self.outputs, act, by_motor, read, at_frame, self.frame, self.asked.axes, sliding)

    def _loop(self, configuration: Configuration) -> JointLoop:
        given = self.asked.controller
        if hasattr(given, "bandwidth_hz"):
            if given.delay_samples or (given.gains is not None and (given.gains.notches or given.gains.low_pass_hz)):
                raise StudyError(
                    "fit/posture",
                    "the controller has filters or a delay, which these equations leave out; give JointLoop(kp, kd, "
                    "ki) without them, or take `elastid loops`",
                )
            q = rigid_posture(self.model, configuration, self.theta)
            given = gains_of(self.model, q, given)
        n_u = self.model.n_u
        kp, kd, ki = (np.broadcast_to(np.asarray(part, float), n_u) for part in (given.kp, given.kd, given.ki))
        return JointLoop(kp, kd, ki)


def as_configuration(posture: Posture, robot: Robot, known: Sequence[Configuration]) -> Configuration:
    """A posture as angles of the driven joints: numbers, a mapping from joints, or the name of one that was fitted."""
    if isinstance(posture, Configuration):
        return posture
    if isinstance(posture, str):
        return known[index_of(posture, [each.name for each in known], "fitted configuration")]
    names = [joint.name for joint in robot.driven]
    if isinstance(posture, Mapping):
        for name in posture:
            if str(name) not in names:
                raise StudyError("fit/posture", f"no driven joint {name}; {did_you_mean(str(name), names)}", "posture")
        lacking = [name for name in names if name not in posture]
        if lacking:
            raise StudyError(
                "fit/posture",
                f"no angle of joint {', '.join(lacking)}; give one for each of {', '.join(names)}",
                "posture",
            )
        posture = [float(posture[name]) for name in names]
    angles = np.atleast_1d(np.asarray(posture, float))
    if refused := robot.count_refusal(angles.size):
        raise StudyError("fit/posture", refused, "posture")
    return Configuration("posture", angles)


def default_frame(robot: Robot) -> str:
    """The frame `tool`, else the last frame; of a robot without frames the one that is made for it."""
    names = [frame.name for frame in robot.frames]
    return TOOL if TOOL in names or not names else names[-1]


def _frame_of(place: str) -> str:
    kind, _, rest = place.partition(" ")
    return rest.rpartition(" ")[0] if kind in ("frame", "accelerometer", "force", "torque") else ""


def _accelerometers(outputs: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(_frame_of(place) for place in outputs if place.startswith("accelerometer ")))


def _with_frames(robot: Robot, asked: Asked) -> tuple[Robot, str]:
    """The robot with a frame for the one that was asked for, and for each body that is named like one."""
    frame = asked.frame or default_frame(robot)
    if isinstance(frame, Frame):
        others = tuple(each for each in robot.frames if each.name != frame.name)
        robot, frame = replace(robot, frames=(*others, frame)), frame.name
    return with_frames(robot, filter(None, [frame, *map(_frame_of, (*asked.inputs, *asked.outputs))])), frame


def _check_ports(robot: Robot, inputs: Sequence[str], outputs: Sequence[str], motors: Motors) -> None:
    for place in outputs:
        robot.check_location(place)
    for place in inputs:
        if place not in robot.load_locations and place not in robot.motor_locations:
            there = ", ".join((*robot.motor_locations, *robot.load_locations))
            raise StudyError("fit/posture", f"'{place}' is no input of robot {robot.name}; there are {there}")
        if place in robot.motor_locations and motors == "held":
            raise StudyError(
                "fit/posture",
                f"the torque of {place} moves nothing while the motors are held; ask with motors='free' or "
                "motors='controlled'",
            )
