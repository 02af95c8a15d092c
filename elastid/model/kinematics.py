r"""Kinematics of many postures in NumPy: skeleton, stick figure, frames, Jacobians, motions that no mass resists.

.. math:: [v;\, \omega] = J(q)\, \dot q, \qquad \tau = J(q)^T\, [F;\, N], \qquad
          M = \sum_{bodies} m J_v^T J_v + J_\omega^T I_c J_\omega + \sum_{rigid\ gears} e J_m r^2 e^T

Niglis & Oberg (2015), eqs. (2.1), (2.3), (2.4), (2.6); their J is the analytic Jacobian, this one the geometric one.
Where driven joints alone are given, elastic joints that are not driven stand at 0. All in the axes of the base, SI.
`ElasticModel.frame_velocity` is the same Jacobian in CasADi, in the frame's own axes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import StudyError
from elastid.model.closed_posture import follow_angles
from elastid.model.frame_tree import ON_BASE, Attachment, Tree, carriers, tree
from elastid.model.spec import StickKind
from elastid.robot import BASE, Robot


@dataclass(frozen=True, eq=False)
class Knot:
    """A point: local (3,) in the axes of a joint's frame, -1 for the base.  owner: the body, joint or frame.

    behind: the knot that a straight link leads here from, -1 for the first one, the base.
    """

    kind: Literal["base", "joint", "body", "center of mass", "point", "frame"]
    owner: str
    frame: int
    local: FloatArray
    behind: int
    number: int = 0


NO_POINTS: Mapping[str, Sequence[Sequence[float]]] = {}


def knots(robot: Robot, layout: Tree, further: Mapping[str, Sequence[Sequence[float]]] = NO_POINTS) -> list[Knot]:
    """List the base, then all points of each body, then the frames. further: body name to points in its own axes."""
    points = [Knot("base", BASE, -1, np.zeros(3), -1)]
    origin = {BASE: 0}
    points += _points(ON_BASE, BASE, 0, further)
    for body, seat in zip(robot.all_bodies, layout.attachments, strict=True):
        # A body's joints start from one origin, but for those at a point of their own.
        above, first = origin[body.parent], seat.frame - len(body.joints) + 1
        for i, joint in enumerate(body.joints):
            if i == 0 or any(joint.point):
                points.append(Knot("joint", joint.name, first + i, np.zeros(3), above))
                above = len(points) - 1
        if not body.joints or any(body.mounting.xyz) or any(any(joint.point) for joint in body.joints):
            points.append(Knot("body", body.name, seat.frame, seat.p, above))
            above = len(points) - 1
        origin[body.name] = above
        center = seat.p + seat.R @ np.array(body.center_of_mass)
        points.append(Knot("center of mass", body.name, seat.frame, center, above))
        points += _points(seat, body.name, above, further)
    for frame, seat in zip(robot.frames, layout.named, strict=True):
        points.append(Knot("frame", frame.name, seat.frame, seat.p, origin[frame.body]))
    return points


def _points(seat: Attachment, body: str, behind: int, further: Mapping[str, Sequence[Sequence[float]]]) -> list[Knot]:
    points = enumerate(further.get(body, ()), start=1)
    return [Knot("point", body, seat.frame, seat.p + seat.R @ np.array(p), behind, i) for i, p in points]


@dataclass(frozen=True)
class Skeleton:
    """Points (Q, n, 3) of a robot in Q postures, as `knots` lists them, and pairs of those that straight links join.

    moves (n,): any joint does.
    """

    points: FloatArray
    links: tuple[tuple[int, int], ...]
    moves: BoolArray


@dataclass(frozen=True)
class Poses:
    """A frame in Q postures: position (Q, 3) of its origin in m, rotation (Q, 3, 3) with its axes as columns."""

    position: FloatArray
    rotation: FloatArray


def frame_poses(robot: Robot, q: FloatArray, frame: str) -> Poses:
    """Compute poses of a named frame or body at positions q (Q, n_l) of all joints; StudyError for an unknown name."""
    _, seat, R, p = _attachment(robot, q, frame)
    rotation = R[seat.frame] if seat.frame >= 0 else np.broadcast_to(np.eye(3), (len(q), 3, 3))
    return Poses(place_end(R, p, seat.frame, seat.p, len(q)), rotation @ seat.R)


def frame_jacobians(robot: Robot, q: FloatArray, frame: str) -> FloatArray:
    """Compute the geometric Jacobian J (Q, 6, n_l) of a named frame or body at q (Q, n_l), as in the equation above.

    Rows: velocity of the frame's origin, then angular velocity, both in the axes of the base.
    """
    layout, seat, R, p = _attachment(robot, q, frame)
    return point_jacobians(layout, R, p, seat.frame, place_end(R, p, seat.frame, seat.p, len(q)))


_tree = lru_cache(maxsize=8)(tree)


def _attachment(robot: Robot, q: FloatArray, name: str) -> tuple[Tree, Attachment, list[FloatArray], list[FloatArray]]:
    layout = _tree(robot)
    seats = {body.name: seat for body, seat in zip(robot.all_bodies, layout.attachments, strict=True)}
    seats |= {frame.name: seat for frame, seat in zip(robot.frames, layout.named, strict=True)}
    if name not in seats:
        raise StudyError(
            "robot/unknown-name", f"robot {robot.name} has no frame and no body {name}; there are {', '.join(seats)}"
        )
    return layout, seats[name], *frames(layout, np.asarray(q, dtype=float))


def point_jacobians(
    layout: Tree, R: list[FloatArray], p: list[FloatArray], carrier: int, point: FloatArray
) -> FloatArray:
    """Compute J (Q, 6, n_l) of a point (Q, 3) for each joint below the frame that carries it (-1: the base)."""
    J = np.zeros((len(point), 6, len(layout.frames)))
    for i in carriers(layout, carrier):
        axis = R[i][:, :, layout.frames[i].axis]
        if layout.frames[i].slides:
            J[:, :3, i] = axis
        else:
            J[:, :3, i], J[:, 3:, i] = np.cross(axis, point - p[i]), axis
    return J


def skeleton(robot: Robot, angles: FloatArray) -> Skeleton:
    """Build the skeleton at the driven joints' angles (Q, n_u): base, joints, centres of mass, frames."""
    layout = tree(robot)
    R, p = frames(layout, follow_angles(robot, angles))
    points = knots(robot, layout)
    return Skeleton(
        np.stack([place_end(R, p, knot.frame, knot.local, len(angles)) for knot in points], axis=1),
        tuple((knot.behind, i) for i, knot in enumerate(points) if knot.behind >= 0),
        np.array([_moves(layout, knot) for knot in points]),
    )


def _moves(layout: Tree, knot: Knot) -> bool:
    """True if any joint moves it; a joint's own turning does not move its origin."""
    if knot.kind == "joint":
        return layout.frames[knot.frame].parent >= 0 or layout.frames[knot.frame].slides
    return knot.frame >= 0


def frames(layout: Tree, q: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    """Compute rotation (Q, 3, 3) and origin (Q, 3) of each joint's frame in the base frame."""
    R: list[FloatArray] = []
    p: list[FloatArray] = []
    base = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
    for i, frame in enumerate(layout.frames):
        parent_R, parent_p = (R[frame.parent], p[frame.parent]) if frame.parent >= 0 else base
        slid = q[:, i, None] * frame.R[:, frame.axis] if frame.slides else np.zeros_like(base[1])
        R.append(parent_R @ frame.R @ (np.eye(3) if frame.slides else _turn(frame.axis, frame.angle(q[:, i]))))
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


def place_end(R: list[FloatArray], p: list[FloatArray], frame: int, local: FloatArray, count: int) -> FloatArray:
    """Transform a point (3,) in a frame's axes (-1: the base's) to the base frame (Q, 3), Q = count postures."""
    if frame < 0:
        return np.tile(local, (count, 1))
    return p[frame] + R[frame] @ local


@dataclass(frozen=True, eq=False)
class StickFigure:
    """points (n, 3) in the base frame, m; jacobian (n, 3, n_l): their velocities per rate of each joint.

    links: pairs of points and the kind of link: an arm, the way to a centre of mass where the arm ends, or a rod
    or strut between two bodies.  joints: the points that are joints.
    """

    points: FloatArray
    jacobian: FloatArray
    links: tuple[tuple[int, int, StickKind], ...]
    joints: tuple[int, ...]


def stick_figure(robot: Robot, q: FloatArray) -> StickFigure:
    """Build the stick figure at positions q (n_l,) of all joints."""
    layout = tree(robot)
    anchors, ends = _anchors(robot)
    # Centres of mass only where nothing else shows how far a body reaches.
    carrying = {body.parent for body in robot.all_bodies} | {frame.body for frame in robot.frames}
    every = knots(robot, layout, anchors)
    shown = [i for i, knot in enumerate(every) if knot.kind != "center of mass" or knot.owner not in carrying]
    visible = [every[i] for i in shown]
    R, p = frames(layout, np.asarray(q, dtype=float)[None])
    points = [place_end(R, p, knot.frame, knot.local, 1) for knot in visible]
    J = [point_jacobians(layout, R, p, knot.frame, point) for knot, point in zip(visible, points, strict=True)]
    links: list[tuple[int, int, StickKind]] = [
        (shown.index(knot.behind), i, "mass" if knot.kind == "center of mass" else "arm")
        for i, knot in enumerate(visible)
        if knot.behind >= 0
    ]
    number = {(knot.owner, knot.number): i for i, knot in enumerate(visible) if knot.kind == "point"}
    links += [(number[first], number[second], "strut") for first, second in ends]
    joints = tuple(i for i, knot in enumerate(visible) if knot.kind == "joint")
    return StickFigure(np.concatenate(points), np.concatenate(J)[:, :3], tuple(links), joints)


def _anchors(robot: Robot) -> tuple[dict[str, list[Sequence[float]]], list[tuple[tuple[str, int], ...]]]:
    """Return points at the ends of loops and compensators, and per connection body and point index of both ends."""
    anchors: dict[str, list[Sequence[float]]] = {}
    pairs = []
    for ends in (*(loop.ends for loop in robot.loops), *(compensator.ends for compensator in robot.compensators)):
        for end in ends:
            anchors.setdefault(end.body, []).append(end.point)
        pairs.append(tuple((end.body, len(anchors[end.body])) for end in ends))
    return anchors, pairs
