r"""Kinematics of many postures: positions of joints, centres of mass and points of bodies, frames, their Jacobians.

.. math:: [v;\, \omega] = J(q)\, \dot q, \qquad \tau = J(q)^T\, [F;\, N]

Niglis & Oberg (2015), eqs. (2.1), (2.3), (2.4), (2.6); their J is the analytic Jacobian, this one the geometric one.
In NumPy. Where driven joints alone are given, elastic joints that are not driven stand at 0. All
in the axes of the base, SI. `ElasticModel.frame_velocity` is the same Jacobian in CasADi, in the frame's own axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import StudyError
from elastid.model.frame_tree import Attachment, Tree, tree
from elastid.model.parallel_linkage.closed_posture import followed, rates
from elastid.model.skeleton import Knot, knots
from elastid.robot import TOOL, Robot


@dataclass(frozen=True)
class Skeleton:
    """Points of a robot in Q postures and the straight links between them.

    points (Q, n, 3).  names: of each point, in words.  links: pairs of points.  moves (n,): whether any joint moves it.
    tool: the point that is the last centre of mass.
    """

    points: FloatArray
    names: tuple[str, ...]
    links: tuple[tuple[int, int], ...]
    moves: BoolArray
    tool: int


@dataclass(frozen=True)
class Poses:
    """A frame in Q postures: position (Q, 3) of its origin in m, rotation (Q, 3, 3) with its axes as columns."""

    position: FloatArray
    rotation: FloatArray


def frame_poses(robot: Robot, q: FloatArray, frame: str) -> Poses:
    """Forward kinematics of a named frame or body at positions q (Q, n_l) of all joints; StudyError without such."""
    layout = tree(robot)
    seat = _seat(robot, layout, frame)
    R, p = frames(layout, np.asarray(q, dtype=float))
    turned = R[seat.frame] if seat.frame >= 0 else np.broadcast_to(np.eye(3), (len(q), 3, 3))
    return Poses(placed(R, p, seat.frame, seat.p, len(q)), turned @ seat.R)


def frame_jacobians(robot: Robot, q: FloatArray, frame: str) -> FloatArray:
    """Geometric Jacobian J (Q, 6, n_l) of a named frame or body at q (Q, n_l), as in the equation above.

    Rows: velocity of the frame's origin, then angular velocity, both in the axes of the base.
    """
    layout = tree(robot)
    seat = _seat(robot, layout, frame)
    R, p = frames(layout, np.asarray(q, dtype=float))
    return point_jacobians(layout, R, p, seat.frame, placed(R, p, seat.frame, seat.p, len(q)))


def _seat(robot: Robot, layout: Tree, name: str) -> Attachment:
    named = dict(zip((frame.name for frame in robot.frames), layout.named, strict=True))
    bodies = dict(zip((body.name for body in robot.all_bodies), layout.attachments, strict=True))
    seats = bodies | named
    if name not in seats:
        raise StudyError(f"robot {robot.name} has no frame and no body {name}; there are {', '.join(seats)}")
    return seats[name]


def point_jacobians(
    layout: Tree, R: list[FloatArray], p: list[FloatArray], carrier: int, point: FloatArray
) -> FloatArray:
    """J (Q, 6, n_l) of a point (Q, 3) to each joint below the frame that carries it (-1: the base)."""
    J = np.zeros((len(point), 6, len(layout.frames)))
    for i in _chain(layout, carrier):
        axis = R[i][:, :, layout.frames[i].axis]
        if layout.frames[i].slides:
            J[:, :3, i] = axis
        else:
            J[:, :3, i], J[:, 3:, i] = np.cross(axis, point - p[i]), axis
    return J


def skeleton(
    robot: Robot, angles: FloatArray, further: Mapping[str, Sequence[Sequence[float]]] | None = None
) -> Skeleton:
    """The skeleton at the driven joints' angles (Q, n_u): base, joints, centres of mass, frames, further points.

    further: body name to points in the body's own axes.
    """
    layout = tree(robot)
    R, p = frames(layout, link_angles(robot, angles))
    found = knots(robot, layout, further or {})
    return Skeleton(
        np.stack([placed(R, p, knot.frame, knot.local, len(angles)) for knot in found], axis=1),
        tuple(knot.name for knot in found),
        tuple((knot.behind, i) for i, knot in enumerate(found) if knot.behind >= 0),
        np.array([_moves(layout, knot) for knot in found]),
        max(i for i, knot in enumerate(found) if knot.kind == "center of mass"),
    )


def _moves(layout: Tree, knot: Knot) -> bool:
    """Whether any joint moves it; a joint's own turning does not move its origin."""
    if knot.kind == "joint":
        return layout.frames[knot.frame].parent >= 0 or layout.frames[knot.frame].slides
    return knot.frame >= 0


def tool_jacobian(robot: Robot, angles: FloatArray) -> FloatArray:
    """J (Q, 6, n_u): velocity (m/s) of the tool and its angular velocity per driven joint's.

    The tool: the origin of the frame called `tool`, or, where there is none, the last body's centre of mass.
    """
    q = link_angles(robot, angles)
    if any(frame.name == TOOL for frame in robot.frames):
        return frame_jacobians(robot, q, TOOL) @ rates(robot, q)
    layout = tree(robot)
    R, p = frames(layout, q)
    seat = layout.attachments[len(robot.bodies) - 1]
    local = seat.p + seat.R @ np.array(robot.bodies[-1].center_of_mass)
    return point_jacobians(layout, R, p, seat.frame, placed(R, p, seat.frame, local, len(q))) @ rates(robot, q)


def link_angles(robot: Robot, angles: FloatArray) -> FloatArray:
    """Angles (Q, n_l) of all joints from those of the driven ones (Q, n_u), loops closed as far as they go."""
    return followed(robot, angles)


def frames(layout: Tree, q: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    """Rotation (Q, 3, 3) and origin (Q, 3) of each joint's frame in the base frame."""
    R: list[FloatArray] = []
    p: list[FloatArray] = []
    Q = len(q)
    for i, frame in enumerate(layout.frames):
        parent_R = R[frame.parent] if frame.parent >= 0 else np.broadcast_to(np.eye(3), (Q, 3, 3))
        parent_p = p[frame.parent] if frame.parent >= 0 else np.zeros((Q, 3))
        slid = q[:, i, None] * frame.R[:, frame.axis] if frame.slides else np.zeros((Q, 3))
        turn = np.eye(3) if frame.slides else _turn(frame.axis, q[:, i])
        R.append(parent_R @ frame.R @ turn)
        p.append(parent_p + (parent_R @ (frame.p + slid)[..., None])[..., 0])
    return R, p


def _turn(k: int, angle: FloatArray) -> FloatArray:
    turn = np.zeros((len(angle), 3, 3))
    i, j = (k + 1) % 3, (k + 2) % 3
    turn[:, k, k] = 1.0
    turn[:, i, i] = turn[:, j, j] = np.cos(angle)
    turn[:, j, i] = np.sin(angle)
    turn[:, i, j] = -turn[:, j, i]
    return turn


def placed(R: list[FloatArray], p: list[FloatArray], frame: int, local: FloatArray, count: int) -> FloatArray:
    """A point (3,) in a frame's axes (-1: the base's) in the base frame (Q, 3), Q = count postures."""
    if frame < 0:
        return np.tile(local, (count, 1))
    return np.asarray(p[frame] + R[frame] @ local)


def _chain(layout: Tree, frame: int) -> set[int]:
    below = set()
    while frame >= 0:
        below.add(frame)
        frame = layout.frames[frame].parent
    return below
