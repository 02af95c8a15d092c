"""Fitted robot in any posture: its equations, linearised there, and their ports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError, did_you_mean, index_of
from elastid.base.section import section
from elastid.linear.equilibrium import equilibrium, rigid_posture
from elastid.linear.fitted_model import Axes, EstimatedTheta, FittedModel, ModelErrorFactor
from elastid.linear.linearise import Linearisation
from elastid.linear.ports import Ports, between_ports, port_motion
from elastid.model.elastic import ElasticModel
from elastid.model.kinematics import frame_poses
from elastid.model.spec import ModelSpec
from elastid.parameters import DELAY, Parameters
from elastid.record import Configuration, JointLoop, Motion, Motors
from elastid.robot import FRAME_AXES, TOOL, Frame, Payload, Robot
from elastid.robot.robot import split_location, with_frames
from elastid.simulation.controller import gains_of
from elastid.simulation.spec import ControllerSpec

Posture: TypeAlias = str | Configuration | Sequence[float] | Mapping[str, float] | FloatArray


@section
class PredictionPorts:
    """Ports, motors and payload of a prediction (`Result.at`).

    payload: None for the payload of the fitted robot, False for no payload, or another payload.
    """

    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    motors: Motors = "locked"
    payload: Payload | Literal[False] | None = None
    frame: Frame | str | None = None
    axes: Axes = "own"
    quantity: Motion | None = None
    controller: Any = None

    def __post_init__(self) -> None:
        if self.motors == "controlled" and self.controller is None:
            raise ValueError(
                "motors are controlled, but by what? Give controller=study.experiment.simulated.controller, "
                "ControllerSpec(bandwidth_hz=...), or JointLoop(kp, kd, ki) of the drives"
            )


@dataclass(frozen=True, eq=False)
class Family:
    """A fitted robot with its ports in any posture; its equations are built once.

    robot: with the requested frames and payload.  places: outputs of the linear models, from which `outputs` follow.
    """

    linearisation: Linearisation
    robot: Robot
    request: PredictionPorts
    estimated: EstimatedTheta
    places: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    frame: str

    @classmethod
    def of(
        cls, robot: Robot, spec: ModelSpec, parameters: Parameters, x: FloatArray, covariance: FloatArray,
        request: PredictionPorts, group: str = "", model_error_factors: tuple[ModelErrorFactor, ...] = (),
    ) -> "Family":  # fmt: skip
        """Return the family; StudyError for unknown locations.  group: configuration whose group parameters apply."""
        robot, frame = _with_frames(robot, request)
        loaded = replace(robot, payload=request.payload) if isinstance(request.payload, Payload) else robot
        members = (name for factor in model_error_factors for name in factor.members)
        linearisation = Linearisation.of_robot(loaded, spec, (*parameters.names, *members))
        names, base = (*linearisation.model.parameters, DELAY), np.append(linearisation.model.theta, 0.0)
        carried = loaded.payload.numbers if isinstance(request.payload, Payload) and loaded.payload else ()
        estimated = EstimatedTheta.of(
            parameters, x, covariance, names, base, group, model_error_factors, (*carried, DELAY)
        )
        inputs = request.inputs or tuple(f"force {frame} {axis}" for axis in "xyz")
        outputs = request.outputs or tuple(f"frame {frame} {axis}" for axis in "xyz")
        frames = dict.fromkeys([frame, *(_frame_of(place) for place in (*inputs, *outputs) if _frame_of(place))])
        locations = (
            *(f"frame {name} {axis}" for name in frames for axis in FRAME_AXES),
            *(f"accelerometer {name} {axis}" for name in _accelerometers(outputs) for axis in "xyz"),
            *(place for place in outputs if not place.startswith(("frame ", "accelerometer "))),
        )
        _check_ports(loaded, inputs, outputs, request.motors)
        return cls(linearisation, loaded, request, estimated, tuple(dict.fromkeys(locations)), inputs, outputs, frame)

    @property
    def model(self) -> ElasticModel:
        """The equations."""
        return self.linearisation.model

    @cached_property
    def theta(self) -> FloatArray:
        """theta (n_theta,) of the equations at the estimate, SI."""
        return self.estimated.theta(self.estimated.x)[:-1]

    @cached_property
    def _dependent(self) -> tuple[str, ...]:
        return tuple(self.estimated.names[row] for row in self.estimated.dependent)

    @property
    def quantity(self) -> Motion:
        """Quantity of all outputs: acceleration with an accelerometer, else as requested, by default position."""
        if not _accelerometers(self.outputs):
            return self.request.quantity or "position"
        if self.request.quantity not in (None, "acceleration"):
            raise StudyError(
                "fit/posture", f"an accelerometer reads acceleration, not {self.request.quantity}; leave quantity out"
            )
        return "acceleration"

    def at(self, configuration: Configuration) -> FittedModel:
        """Return the model about the equilibrium of a posture; raise StudyError without an equilibrium."""
        if self.request.payload is False:
            configuration = replace(configuration, has_payload=False)
        linear = self.linearisation.at(configuration, self.theta, self.places, self.quantity)
        slopes = {name: linear.slopes[name] for name in self._dependent if name in linear.slopes}
        loop = self._loop(configuration) if self.request.motors == "controlled" else None
        model = between_ports(replace(linear, slopes=slopes), self._ports(configuration), self.request.motors, loop)
        if not model.n:
            raise StudyError(
                "fit/posture",
                f"robot {self.robot.name} has no spring behind its motors, so that nothing moves if they are locked; "
                "ask with motors='free' or motors='controlled'",
            )
        locations = (*model.inputs, *model.outputs)
        slides = tuple(place for place in locations if place.startswith("force ") or place in linear.sliding)
        model = replace(model, channel_numbers=(), sliding=slides)
        return FittedModel(model, self.estimated, self.model.coordinates, self.frame, self.request.axes)

    def _ports(self, configuration: Configuration) -> Ports:
        model, theta = self.model, self.theta
        rows, rotations = {place: i for i, place in enumerate(self.places)}, {}
        if self.request.axes == "world":
            q = equilibrium(model, theta, configuration).q[None, : self.robot.n_l]
            names = dict.fromkeys(filter(None, map(_frame_of, self.places)))
            rotations = {name: frame_poses(model.robot_at(theta), q, name).rotation[0] for name in names}

        def row(place: str) -> FloatArray:
            """Return the row (n,) of a location, as a sum of `places`."""
            weights = np.zeros(len(rows) + model.n_u)
            kind, name, axis = split_location(place)
            if kind in ("motor", "joint", "body") or self.request.axes == "own":
                weights[rows[place]] = 1.0
                return weights
            for along, cosine in zip("xyz", rotations[name]["xyz".index(axis[-1])], strict=True):
                weights[rows[f"{kind} {name} {axis[:-1]}{along}"]] = cosine
            return weights

        torques = dict(zip(model.inputs, np.eye(model.n_u, len(rows) + model.n_u, len(rows)), strict=True))
        # The row of a force or torque is the row of the motion on which it does work.
        act = np.array([torques[place] if place in torques else row(port_motion(place)) for place in self.inputs])
        outputs = (*self.outputs, *(f"frame {self.frame} {axis}" for axis in FRAME_AXES))
        return Ports(self.inputs, outputs, act, np.array([row(place)[: len(rows)] for place in outputs]))

    def _loop(self, configuration: Configuration) -> JointLoop:
        controller = self.request.controller
        if isinstance(controller, ControllerSpec):
            if controller.delay_samples or (
                controller.gains is not None and (controller.gains.notches or controller.gains.low_pass_hz)
            ):
                raise StudyError(
                    "fit/posture",
                    "the controller has filters or a delay, which these equations leave out; give JointLoop(kp, kd, "
                    "ki) without them, or take `elastid loops`",
                )
            controller = gains_of(self.model, rigid_posture(self.model, configuration, self.theta), controller)
        n_u = self.model.n_u
        return JointLoop.gain_derivatives(controller, lambda gain: np.broadcast_to(np.asarray(gain, float), n_u))


def as_configuration(posture: Posture, robot: Robot, configurations: Sequence[Configuration]) -> Configuration:
    """Return a posture (numbers, mapping from joints, or name of a fitted configuration) as a configuration."""
    if isinstance(posture, Configuration):
        return posture
    if isinstance(posture, str):
        return configurations[index_of(posture, [posture.name for posture in configurations], "fitted configuration")]
    names = robot.driven_names
    if isinstance(posture, Mapping):
        for name in posture:
            if str(name) not in names:
                raise StudyError("fit/posture", f"no driven joint {name}; {did_you_mean(str(name), names)}", "posture")
        if missing := [name for name in names if name not in posture]:
            raise StudyError(
                "fit/posture",
                f"no angle of joint {', '.join(missing)}; give one for each of {', '.join(names)}",
                "posture",
            )
        posture = [float(posture[name]) for name in names]
    angles = np.atleast_1d(np.asarray(posture, float))
    if refusal := robot.count_refusal(angles.size):
        raise StudyError("fit/posture", refusal, "posture")
    return Configuration("posture", angles)


def default_frame(robot: Robot) -> str:
    """Return the frame `tool`, else the last frame; for a robot without frames, the frame added to it."""
    names = [frame.name for frame in robot.frames]
    return TOOL if TOOL in names or not names else names[-1]


def _frame_of(location: str) -> str:
    kind, name, _ = split_location(location)
    return name if kind in ("frame", "accelerometer", "force", "torque") else ""


def _accelerometers(outputs: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(_frame_of(location) for location in outputs if location.startswith("accelerometer ")))


def _with_frames(robot: Robot, request: PredictionPorts) -> tuple[Robot, str]:
    """Add a frame of the requested name, and a frame for each body that is used as a frame."""
    frame = request.frame or default_frame(robot)
    if isinstance(frame, Frame):
        others = tuple(f for f in robot.frames if f.name != frame.name)
        robot, frame = replace(robot, frames=(*others, frame)), frame.name
    return with_frames(robot, filter(None, [frame, *map(_frame_of, (*request.inputs, *request.outputs))])), frame


def _check_ports(robot: Robot, inputs: Sequence[str], outputs: Sequence[str], motors: Motors) -> None:
    for location in outputs:
        robot.check_location(location)
    for location in inputs:
        if location not in robot.load_locations and location not in robot.motor_locations:
            locations = ", ".join((*robot.motor_locations, *robot.load_locations))
            raise StudyError("fit/posture", f"'{location}' is no input of robot {robot.name}; there are {locations}")
        if location in robot.motor_locations and motors == "locked":
            raise StudyError(
                "fit/posture",
                f"the torque of {location} moves nothing while the motors are locked; ask with motors='free' or "
                "motors='controlled'",
            )
