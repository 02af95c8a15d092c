r"""Postures of a path, of a grid over the workspace, or random ones; inverse kinematics by damped least squares.

.. math:: \delta q = (J^T J + \mu I)^{-1} J^T e, \qquad e = [p - p(q);\, \log (R R(q)^T)]

within the limits of the joints, for all poses at once, each from the best of some postures (Nakamura and Hanafusa,
J. Dyn. Sys. Meas. Control 108 (1986), 163).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.base.large_arrays import empty_in_file, release
from elastid.base.tables import name_and_unit, read_table
from elastid.base.units import si_factor
from elastid.model.closed_posture import are_closed, follow_angles, rates
from elastid.model.kinematics import frame_jacobians, frame_poses
from elastid.robot import Robot

_REACHED = 1e-6  # m, or rad, from a pose
_POSITION, _ROTATION = dict.fromkeys(("x", "y", "z"), "m"), dict.fromkeys(("rx", "ry", "rz"), "rad")


def limits_of(robot: Robot) -> FloatArray:
    """Return lower and upper angle (n_u, 2) of driven joints; without a limit a full turn, 0 for sliding joints."""
    low, high = np.array([joint.limits.angle for joint in robot.driven], float).T
    turn = np.array([0.0 if joint.slides else 2 * np.pi for joint in robot.driven])
    low = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high - turn, -turn / 2))
    return np.stack([low, np.where(np.isfinite(high), high, low + turn)], axis=1)


def beyond_limits(robot: Robot, angles: FloatArray) -> BoolArray:
    """Return True (Q, n_u) for angles beyond the limits of their joints, where these have some."""
    low, high = np.array([joint.limits.angle for joint in robot.driven], float).T
    return np.asarray((angles < low - 1e-9) | (angles > high + 1e-9))


def random_postures(robot: Robot, count: int, seed: int = 0) -> FloatArray:
    """Draw angles (count, n_u), uniform within the limits, at which the loops close; large arrays are in a file."""
    (low, high), rng, n = limits_of(robot).T, np.random.default_rng(seed), 0
    tries, piece = count * (5 if robot.loops else 1), 10_000
    angles = (np.empty if count <= piece else empty_in_file)((count, len(low)))
    for first in range(0, tries, piece):
        drawn = low + rng.random((min(piece, tries - first), len(low))) * (high - low)
        drawn = drawn[are_closed(robot, follow_angles(robot, drawn))][: count - n]
        angles[n : (n := n + len(drawn))] = drawn
        release(angles)
        if n == count:
            break
    if not n:
        raise StudyError(
            "robot/loops", "its loops close in no posture within the limits of its joints", f"robot {robot.name}"
        )
    return angles[:n]


def _seeds(robot: Robot, seed: int) -> FloatArray:
    """Draw postures as starts of the search for each pose; fewer for a linkage, which takes longer."""
    return random_postures(robot, 200 if robot.loops else 2000, seed)


def grid_postures(robot: Robot, frame: str, points: int = 12, seed: int = 0) -> FloatArray:
    """Return angles (Q, n_u) of a frame on a cubic grid over its workspace, `points` along the longest side."""
    points_reached = frame_poses(robot, follow_angles(robot, _seeds(robot, seed)), frame).position
    low, high = points_reached.min(axis=0), points_reached.max(axis=0)
    spacing = max(float((high - low).max()) / max(points - 1, 1), _REACHED)
    sides = [np.arange(a, b + spacing / 2, spacing) for a, b in zip(low, high, strict=True)]
    targets = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    angles, is_reached = inverse_kinematics(robot, frame, targets, seed=seed)
    if not is_reached.any():
        raise StudyError(
            "options/invalid",
            f"no point of a grid of {1e3 * spacing:.3g} mm is reached by frame {frame} of robot {robot.name}, which "
            "moves on a surface only; take --random, or a frame behind the last joint",
        )
    return angles[is_reached]


def inverse_kinematics(
    robot: Robot, frame: str, position: FloatArray, rotation: FloatArray | None = None, seed: int = 0
) -> tuple[FloatArray, BoolArray]:
    """Find angles (Q, n_u) within the limits that bring a frame to positions (Q, 3) and optional rotations (Q, 3, 3).

    Second value (Q,): whether it is reached.
    """
    seeds = _seeds(robot, seed)
    there = frame_poses(robot, follow_angles(robot, seeds), frame)
    best, error = np.zeros((len(position), seeds.shape[1])), np.full(len(position), np.inf)
    starts, poses = [there.position], [position]
    if rotation is not None:  # half a turn, a difference with a norm of sqrt(8), is as far as the workspace is long
        size = np.ptp(there.position, axis=0).max() / 8**0.5
        starts, poses = [*starts, size * there.rotation.reshape(-1, 9)], [*poses, size * rotation.reshape(-1, 9)]
    near = KDTree(np.hstack(starts)).query(np.hstack(poses), k=3)[1]
    for start in near.T:
        q, distance = _descend(robot, frame, position, rotation, seeds[start])
        better = distance < error
        best[better], error[better] = q[better], distance[better]
    return best, error < _REACHED


def follow_path(
    robot: Robot, frame: str, position: FloatArray, rotation: FloatArray | None, seed: int = 0
) -> tuple[FloatArray, BoolArray]:
    """Find postures (n, n_u) and flags (n,) if reached for positions (n, 3), m; each search starts at the last pose."""
    angles, is_reached = inverse_kinematics(robot, frame, position, rotation, seed)
    for i in range(1, len(position)):
        if not is_reached[i - 1]:
            continue
        turn = rotation if rotation is None else rotation[i : i + 1]
        q, distance = _descend(robot, frame, position[i : i + 1], turn, angles[i - 1 : i])
        if distance[0] < _REACHED:
            angles[i], is_reached[i] = q[0], True
    return angles, is_reached


def _descend(
    robot: Robot, frame: str, position: FloatArray, rotation: FloatArray | None, q: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return angles (Q, n_u), and how far (Q,) they are from the poses, m or rad."""
    distance, (low, high) = np.full(len(q), np.inf), limits_of(robot).T
    for _ in range(60):
        joints = follow_angles(robot, q)
        pose = frame_poses(robot, joints, frame)
        e = position - pose.position
        J = frame_jacobians(robot, joints, frame) @ rates(robot, joints)
        if rotation is None:
            J = J[:, :3]
        else:
            e = np.hstack([e, Rotation.from_matrix(rotation @ pose.rotation.transpose(0, 2, 1)).as_rotvec()])
        distance = np.abs(e).max(axis=1)
        if np.all(distance < _REACHED / 10):
            break
        normal = J.transpose(0, 2, 1) @ J
        size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        # Less damping where the pose is near: the last steps are Newton's.
        damping = np.minimum(1e-3, distance**2)[:, None, None] + 1e-12
        pull = J.transpose(0, 2, 1) @ e[:, :, None]
        step = np.linalg.solve(normal + damping * size * np.eye(len(low)), pull)[:, :, 0]
        step *= np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        q = np.clip(q + step, low, high)
    return q, distance


@dataclass(frozen=True)
class Table:
    """Numbers (Q, n) of a CSV file with headings (n,). lines (Q,): row numbers in the file, from 1."""

    path: Path
    heads: tuple[str, ...]
    values: FloatArray
    lines: tuple[int, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The headings without units."""
        return tuple(name_and_unit(head)[0] for head in self.heads)

    def angles(self, robot: Robot) -> FloatArray | None:
        """Return angles (Q, n_u) of the driven joints in rad, or m; None if the table lacks one."""
        if not set(robot.driven_names) <= set(self.names):
            return None
        return self.in_si({joint.name: "m" if joint.slides else "rad" for joint in robot.driven})

    def poses(self, robot: Robot) -> tuple[FloatArray, FloatArray | None]:
        """Return positions (Q, 3) and rotations (Q, 3, 3) or None; DataError where there are no poses either."""
        turns = _ROTATION.keys() & {*self.names}
        if not _POSITION.keys() <= {*self.names} or (turns and turns != _ROTATION.keys()):
            joints = robot.driven_names
            raise DataError(
                "use/path",
                f"its columns are {', '.join(self.heads)}. Give a column per driven joint "
                f"({', '.join(joints)}; rad, or `{joints[0]} (deg)`), or poses of the frame: x, y, z in m, and all or "
                "none of rx, ry, rz in rad",
                self.path,
            )
        return self.in_si(_POSITION), Rotation.from_rotvec(self.in_si(_ROTATION)).as_matrix() if turns else None

    def in_si(self, dimensions: dict[str, str]) -> FloatArray:
        """Return columns (Q, n) of the names in `dimensions` in SI units; DataError for a unit of another dimension."""
        columns = [self.names.index(name) for name in dimensions]
        units = [name_and_unit(self.heads[column])[1] for column in columns]
        try:
            scale = [si_factor(unit or si, si) for unit, si in zip(units, dimensions.values(), strict=True)]
        except ValueError as error:
            raise DataError("use/path", str(error), self.path) from None
        return self.values[:, columns] * scale


def read_path(path: Path, robot: Robot, frame: str) -> tuple[FloatArray, tuple[str, ...]]:
    """Read a CSV file with a column for each driven joint, in rad (or deg: `1 deg`), or with poses of the frame.

    Poses: columns x, y, z in m, and rx, ry, rz, the rotation vector in rad, where the orientation counts.
    Angles (Q, n_u), and sentences on rows out of reach, which are left out, and beyond the limits of the joints, which
    are kept: some robots' files are stricter than the robots.
    DataError for other columns and for cells that are no numbers.
    """
    table = read_numbers(path)
    angles = table.angles(robot)
    if angles is not None:
        beyond = np.asarray(beyond_limits(robot, angles).any(axis=1))
        return angles, _remark(beyond, "are beyond the limits of the joints, and kept")
    angles, is_reached = follow_path(robot, frame, *table.poses(robot))
    if not is_reached.any():
        raise DataError(
            "use/unreachable",
            f"no pose is within reach of frame {frame} and the limits of the joints. x, y, z are from the robot's "
            "base, in m unless the heading has another unit. Correct them or the limits",
            path,
        )
    words = "are out of reach of the frame within the limits of the joints, and left out"
    return angles[is_reached], _remark(~is_reached, words)


def _remark(where: BoolArray, words: str) -> tuple[str, ...]:
    """Return a sentence on rows (Q,), counted from 1; empty without rows."""
    rows = [str(row + 1) for row in np.flatnonzero(where)]
    more = ", ..." * (len(rows) > 5)
    return (f"{len(rows)} of the path's postures (row {', '.join(rows[:5])}{more}) {words}",) if rows else ()


def read_numbers(path: Path) -> Table:
    """Read the numbers of a CSV file; raise DataError with the row of a cell without a number."""
    values, lines, heads = [], [], tuple[str, ...]()
    for line, cells in read_table(path):
        try:
            numbers = [float(cell.removesuffix(name_and_unit(head)[1])) for head, cell in cells.items()]
        except ValueError:
            numbers = [np.nan]
        if not np.isfinite(numbers).all():
            text = f"{', '.join(cells.values())}: each cell must be a finite number"
            raise DataError("use/path", text, f"{path}:{line}")
        values.append(numbers)
        lines.append(line)
        heads = tuple(cells)
    return Table(path, heads, np.array(values), tuple(lines))
