"""A step of each motor's reference on the nonlinear twin under a controller, posture by posture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import DataError, StudyError
from elastid.experiment.simulated.plant import exact_plant
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.model.formulation import EXACT
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.closed_loop import Commands, simulate
from elastid.simulation.controller import gains_of

STEP = {"rad": np.radians(0.05), "m": 1e-4}  # of a reference
_WITHIN = 0.05  # of a step, in which it has settled
_PERIODS, _LONGEST_S = 4.0, 10.0  # of the slowest bandwidth, and at most, as long as a step is simulated


@frozen_value
class Steps:
    """Responses (Q, n_u, n) of each motor to a step of its own reference, over the step, others held.

    overshoot, settled_s, end (Q, n_u): largest beyond 1, time of the last leave of 5 % about the end, and the end
    itself; friction keeps it from 1.
    """

    judge: str
    postures: tuple[str, ...]
    axes: tuple[str, ...]
    time_s: FloatArray = labelled("time", "s")
    response: FloatArray = labelled("angle over the step of its reference", "", "postures axes time_s")

    @property
    def overshoot(self) -> FloatArray:
        """(Q, n_u)."""
        return np.asarray(np.maximum(self.response.max(axis=2) - 1, 0.0))

    @property
    def end(self) -> FloatArray:
        """(Q, n_u), mean of the last tenth."""
        return np.asarray(self.response[:, :, -max(1, len(self.time_s) // 10) :].mean(axis=2))

    @property
    def settled_s(self) -> FloatArray:
        """(Q, n_u), the last time where it does not settle."""
        away = np.abs(self.response - self.end[:, :, None]) > _WITHIN
        last = len(self.time_s) - 1 - np.argmax(away[:, :, ::-1], axis=2)
        return np.asarray(np.where(away.any(axis=2), self.time_s[last], 0.0))


def steps(
    robot: Robot, judge: str, postures: Sequence[Configuration], controller: ControllerSpec, rate_hz: float,
    slowest_hz: float,
) -> Steps:  # fmt: skip
    """Of a robot with its friction; slowest_hz: bandwidth of its slowest axis.  DataError where a motor is lost."""
    n = int(np.ceil(min(_PERIODS / slowest_hz, _LONGEST_S) * rate_hz))
    rows = [list(_of_posture(robot, posture, controller, rate_hz, n)) for posture in postures]
    axes = tuple(joint.name for joint in robot.driven)
    return Steps(judge, tuple(each.name for each in postures), axes, np.arange(n) / rate_hz, np.array(rows))


def _of_posture(
    robot: Robot, posture: Configuration, controller: ControllerSpec, rate_hz: float, n: int
) -> Iterator[FloatArray]:
    plant, point = exact_plant(robot, EXACT, rate_hz, posture, controller=controller)
    model = plant.model
    gains = gains_of(model, point.q, controller)
    rest = model.B.T @ point.q
    for i, joint in enumerate(robot.driven):
        position, none = np.tile(rest, (n, 1)), np.zeros((n, model.n_u))
        size = STEP[joint.unit]
        position[1:, i] += size
        torque = np.tile(point.u, (n, 1))
        try:
            run = simulate(plant.loop, gains, Commands(position, none, torque, none, none), point.q)
        except DataError as error:
            raise StudyError(f"posture {posture.name}, a step of axis {joint.name}: {error}") from error
        yield ((run.q @ model.B)[:, i] - rest[i]) / size
