r"""Moves of the driven joints from rest to rest as splines, limits of their motion, and sampled references.

.. math:: q_a(t) = q_a(\sigma(t / T)), \qquad \sigma(s) = 126 s^5 - 420 s^6 + 540 s^7 - 315 s^8 + 70 s^9

for postures without times, with sigma along the length of the path. Postures with times are interpolated by a spline of
degree 5 that starts and ends at rest. A path of poses is interpolated as poses, so that the tool follows it between
them. The robot has no deflection.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.spatial.transform import Rotation

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import DataError
from elastid.robot import Robot
from elastid.use.path_table import Table, read_numbers
from elastid.use.postures import beyond_limits, follow_path

KINDS = {"velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3", "torque": "N*m"}


@frozen_value
class MotionLimits:
    """Limits of the driven joints, link side, infinite if not given: angle (n_u, 2), the others (n_u,)."""

    angle: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    torque: FloatArray

    @classmethod
    def of(cls, robot: Robot) -> "MotionLimits":
        """Return the limits of a robot model."""
        limits = [joint.limits for joint in robot.driven]
        angle = np.array([limit.angle for limit in limits], float)
        return cls(angle, *(np.array([getattr(limit, kind) for limit in limits], float) for kind in KINDS))

    @property
    def range(self) -> tuple[FloatArray, FloatArray]:
        """Middle and half width (n_u,) of the angles; 0 and infinite if an end has no limit."""
        finite = np.asarray(np.isfinite(self.angle).all(axis=1))
        low, high = np.where(finite[:, None], self.angle, 0.0).T
        return (low + high) / 2, np.where(finite, (high - low) / 2, np.inf)

    def narrowed(self, factors: dict[str, FloatArray]) -> "MotionLimits":
        """Return the limits with each named kind multiplied by factors (n_u,)."""
        return replace(self, **{kind: getattr(self, kind) * factor for kind, factor in factors.items()})


@frozen_value(eq=False)
class References:
    """References of the motors at even times (N,), link side, each (N, n_u), with the feedforward torque."""

    time_s: FloatArray = labelled("time from the start of the move", "s")
    position: FloatArray = labelled("reference of each motor", "rad", "time_s joints")
    velocity: FloatArray = labelled("its velocity", "rad/s", "time_s joints")
    acceleration: FloatArray = labelled("its acceleration", "rad/s^2", "time_s joints")
    jerk: FloatArray = labelled("its jerk", "rad/s^3", "time_s joints")
    torque: FloatArray = labelled("feedforward, held to the next sample", "N*m", "time_s joints")

    @property
    def rate_hz(self) -> float:
        """Sampling rate."""
        return float((len(self.time_s) - 1) / (self.time_s[-1] - self.time_s[0]))

    def use(self, limits: MotionLimits) -> dict[str, FloatArray]:
        """Return the used fraction (N, n_u) of each limit, 0 without a limit."""
        fractions = {kind: np.abs(getattr(self, kind)) / getattr(limits, kind) for kind in KINDS}
        middle, half_width = limits.range
        return {"angle": np.abs(self.position - middle) / half_width, **fractions}


def evaluate_spline(spline: BSpline, t: FloatArray, order: int) -> FloatArray:
    """Return a spline (N, n), or its derivative of this order, at t (N,); it is constant outside its ends."""
    low, high = spline.t[[0, -1]]
    values = np.asarray(spline(np.clip(t, low, high), order))
    if order:
        values[(t < low) | (t > high)] = 0.0
    return values


TIMES = ("t", "time")
LONGEST_S = 60.0  # longest move: a plan takes 40 MB for each second
_SAMPLES = 200  # inverse kinematics on a path of poses
_TIMING = (0.0, 0.0, 0.0, 0.0, 0.0, 126.0, -420.0, 540.0, -315.0, 70.0)


@dataclass(frozen=True, eq=False)
class Move:
    """Angles of the driven joints by a spline over the fraction of the duration, s; at rest before and after it."""

    spline: BSpline
    duration: float

    def at(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Return angles (N, n_u) at times (N,), or their derivatives of this order, in rad (m) and s."""
        return evaluate_spline(self.spline, t / self.duration, order) / self.duration**order

    @property
    def ends(self) -> FloatArray:
        """Angles (2, n_u) at the start and at the end."""
        return np.asarray(self.spline(np.array([0.0, 1.0])))

    def in_time(self, duration: float) -> "Move":
        """Return the move on the same path with another duration."""
        return replace(self, duration=duration)


def read_move(path: Path, robot: Robot, frame: str, duration: float | None = None) -> Move:
    """Read a move from a CSV file of joint angles or poses (`read_path`), with a column `t` in s or a duration in s.

    duration: None for the times of the file, 0 for a duration to be determined later.
    DataError for cells without a number, times that do not rise, poses out of reach and angles beyond the limits.
    """
    table = read_numbers(path)
    if len(table.values) < 2:
        raise DataError("use/path", "there is one row. A move needs a row for its start and a row for its end", path)
    times = _times(table)
    if times is None and duration is None:
        raise DataError("use/path", "there is no column t. Give times in s, --time with a duration, or --fastest", path)
    angles = table.angles(robot)
    if angles is not None:
        path_parameters = _path_parameters(angles, times)
        _check_limits(table, angles, robot)
        spline = _through(path_parameters, angles, times is not None)
    else:
        spline = _through_poses(table, robot, frame, times)
    if duration is None:
        duration = float(times[-1] - times[0]) if times is not None else 0.0
    if duration > LONGEST_S:
        raise DataError(
            "use/move",
            f"the move takes {duration:g} s, a plan at most {LONGEST_S:g} s. Give times in s, or split the path",
            path,
        )
    return Move(spline, duration)


def _times(table: Table) -> FloatArray | None:
    name = next((word for word in TIMES if word in table.names), None)
    if name is None:
        return None
    times = table.in_si({name: "s"})[:, 0]
    if falling := np.flatnonzero(np.diff(times) <= 0).tolist():
        row = falling[0] + 1
        raise DataError(
            "use/path",
            f"column {name} is {times[row]:g} s after {times[row - 1]:g} s; times must rise from row to row",
            f"{table.path}:{table.lines[row]}",
        )
    return times


def _path_parameters(points: FloatArray, times: FloatArray | None) -> FloatArray:
    """Return the fractions (Q,) of the duration, or without times of the length, at points (Q, n) of a path."""
    if times is None:
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        times = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-9 * max(steps.sum(), 1e-9)))])
    return np.asarray((times - times[0]) / (times[-1] - times[0]))


def _through(path_parameters: FloatArray, points: FloatArray, is_timed: bool) -> BSpline:
    """Return a rest-to-rest spline over time fractions, through points (Q, n) at fractions (Q,) of time or path."""
    if is_timed:
        return _rest_to_rest_spline(path_parameters, points)
    path = make_interp_spline(path_parameters, points, k=min(3, len(points) - 1))
    s = np.linspace(0.0, 1.0, _SAMPLES + 1)
    return _rest_to_rest_spline(s, path(np.clip(np.polynomial.polynomial.polyval(s, _TIMING), 0.0, 1.0)))


def _rest_to_rest_spline(s: FloatArray, points: FloatArray) -> BSpline:
    """Return the spline of degree 5 through points (Q, n) at s (Q,), without velocity and acceleration at its ends."""
    zeros = np.zeros(points.shape[1])
    return make_interp_spline(s, points, k=5, bc_type=([(1, zeros), (2, zeros)], [(1, zeros), (2, zeros)]))


def _through_poses(table: Table, robot: Robot, frame: str, times: FloatArray | None) -> BSpline:
    position, rotation = table.poses(robot)
    path_parameters, s = _path_parameters(position, times), np.linspace(0.0, 1.0, _SAMPLES + 1)
    spline = _through(path_parameters, position, times is not None)
    rotations = None
    if rotation is not None:
        first = Rotation.from_matrix(rotation[0])
        vectors = (first.inv() * Rotation.from_matrix(rotation)).as_rotvec()
        rotation_spline = _through(path_parameters, vectors, times is not None)
        rotations = (first * Rotation.from_rotvec(rotation_spline(s))).as_matrix()
    angles, is_reached = follow_path(robot, frame, spline(s), rotations)
    if not is_reached.all():
        path_parameter = float(s[int(np.argmin(is_reached))])
        row = min(int(np.searchsorted(path_parameters, path_parameter)), len(path_parameters) - 1)
        point = ", ".join(f"{value:.4g}" for value in spline(path_parameter))
        raise DataError(
            "use/unreachable",
            f"on the path to this pose, at ({point}) m, frame {frame} is out of reach within the limits of the joints. "
            "Move the path, or widen robot.bodies.joints.limits.angle",
            f"{table.path}:{table.lines[row]}",
        )
    _check_limits(table, angles, robot)
    return _rest_to_rest_spline(s, angles)


def _check_limits(table: Table, angles: FloatArray, robot: Robot) -> None:
    """Raise DataError for the first row (of joint angles) or angle (of poses) beyond the limits of a driven joint."""
    for row, i in np.argwhere(beyond_limits(robot, angles)).tolist():
        line = table.lines[row] if len(angles) == len(table.lines) else table.lines[-1]
        joint = robot.driven[i]
        raise DataError(
            "use/unreachable",
            f"{joint.position_refusal(angles[row, i])}; move the path, or name a column of degrees `{joint.name} deg`",
            f"{table.path}:{line}",
        )


def point_to_point(start: FloatArray, end: FloatArray, duration: float) -> Move:
    """Return the move of the joints from start to end (n_u,)."""
    return Move(_through(np.array([0.0, 1.0]), np.stack([start, end]), False), duration)
