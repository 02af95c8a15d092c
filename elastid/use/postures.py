r"""Postures at random, on a grid over the workspace or along a path; inverse kinematics by damped least squares.

.. math:: \delta q = (J^T J + \mu I)^{-1} J^T e, \qquad e = [p - p(q);\, \log (R R(q)^T)]

within the limits of the joints, for all poses together, each from the nearest of some postures (Nakamura and Hanafusa,
J. Dyn. Sys. Meas. Control 108 (1986), 163).
"""

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import StudyError
from elastid.base.large_arrays import empty_in_file, release
from elastid.model.closed_posture import are_closed, follow_angles, rates
from elastid.model.kinematics import frame_jacobians, frame_poses
from elastid.robot import Robot

_TOLERANCE = 1e-6  # m, or rad, from a pose


def limits_of(robot: Robot) -> FloatArray:
    """Return the lower and upper angle (n_u, 2) of driven joints; without a limit a full turn, 0 for sliding joints."""
    low, high = np.array([joint.limits.angle for joint in robot.driven], float).T
    turn = np.array([0.0 if joint.slides else 2 * np.pi for joint in robot.driven])
    low = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high - turn, -turn / 2))
    return np.stack([low, np.where(np.isfinite(high), high, low + turn)], axis=1)


def beyond_limits(robot: Robot, angles: FloatArray) -> BoolArray:
    """Return flags (Q, n_u) of angles beyond the limits of their joints."""
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
    """Draw the starting postures of the search; fewer for a linkage, which takes longer."""
    return random_postures(robot, 200 if robot.loops else 2000, seed)


def grid_postures(robot: Robot, frame: str, points: int = 12, seed: int = 0) -> FloatArray:
    """Return the angles (Q, n_u) for a frame on a cubic grid over its workspace, `points` along the longest side."""
    points_reached = frame_poses(robot, follow_angles(robot, _seeds(robot, seed)), frame).position
    low, high = points_reached.min(axis=0), points_reached.max(axis=0)
    spacing = max(float((high - low).max()) / max(points - 1, 1), _TOLERANCE)
    sides = [np.arange(a, b + spacing / 2, spacing) for a, b in zip(low, high, strict=True)]
    targets = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    angles, is_reached = inverse_kinematics(robot, frame, targets, seed=seed)
    if not is_reached.any():
        raise StudyError(
            "options/invalid",
            f"frame {frame} of robot {robot.name} reaches no point of a grid of {1e3 * spacing:.3g} mm, because it "
            "moves on a surface only. Use --random, or a frame behind the last joint",
        )
    return angles[is_reached]


def inverse_kinematics(
    robot: Robot, frame: str, position: FloatArray, rotation: FloatArray | None = None, seed: int = 0
) -> tuple[FloatArray, BoolArray]:
    """Find angles (Q, n_u) within the limits that bring a frame to positions (Q, 3) and optional rotations (Q, 3, 3).

    Also returns flags (Q,) of the poses that are reached.
    """
    seeds = _seeds(robot, seed)
    seed_poses = frame_poses(robot, follow_angles(robot, seeds), frame)
    best, error = np.zeros((len(position), seeds.shape[1])), np.full(len(position), np.inf)
    starts, poses = [seed_poses.position], [position]
    if rotation is not None:  # half a turn (norm sqrt(8) of the difference) counts as the length of the workspace
        size = np.ptp(seed_poses.position, axis=0).max() / 8**0.5
        starts, poses = [*starts, size * seed_poses.rotation.reshape(-1, 9)], [*poses, size * rotation.reshape(-1, 9)]
    nearest = KDTree(np.hstack(starts)).query(np.hstack(poses), k=3)[1]
    for start in nearest.T:
        q, distance = _descend(robot, frame, position, rotation, seeds[start])
        better = distance < error
        best[better], error[better] = q[better], distance[better]
    return best, error < _TOLERANCE


def follow_path(
    robot: Robot, frame: str, position: FloatArray, rotation: FloatArray | None, seed: int = 0
) -> tuple[FloatArray, BoolArray]:
    """Find postures (n, n_u) and flags (n,) if reached for positions (n, 3), m; each search starts at the last pose."""
    angles, is_reached = inverse_kinematics(robot, frame, position, rotation, seed)
    for i in range(1, len(position)):
        if not is_reached[i - 1]:
            continue
        one_rotation = rotation if rotation is None else rotation[i : i + 1]
        q, distance = _descend(robot, frame, position[i : i + 1], one_rotation, angles[i - 1 : i])
        if distance[0] < _TOLERANCE:
            angles[i], is_reached[i] = q[0], True
    return angles, is_reached


def _descend(
    robot: Robot, frame: str, position: FloatArray, rotation: FloatArray | None, q: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return angles (Q, n_u) near the poses, starting at q (Q, n_u), and their distances (Q,), m or rad."""
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
        if np.all(distance < _TOLERANCE / 10):
            break
        normal = J.transpose(0, 2, 1) @ J
        size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        # Damping decreases near the pose, so that the last steps are Newton's.
        damping = np.minimum(1e-3, distance**2)[:, None, None] + 1e-12
        pull = J.transpose(0, 2, 1) @ e[:, :, None]
        step = np.linalg.solve(normal + damping * size * np.eye(len(low)), pull)[:, :, 0]
        step *= np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        q = np.clip(q + step, low, high)
    return q, distance
