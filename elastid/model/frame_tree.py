r"""The frames of a robot's joints as a tree, turns of its joints, and positions of points of its bodies, in CasADi.

One frame a joint, fixed to the moved body; a joint about an oblique axis has a frame whose z is that axis. A
joint that slides moves its frame's origin along that axis and turns nothing. Origins are numbers, but for coordinates
of the geometry that are symbols of theta. A turn about a coordinate axis costs six operations a vector instead of a
3 x 3 product.

.. math:: p = p_i + R_i\, T_i(q_i)\, p_{i+1}

from the body up to a frame that carries it. A point is transformed from frame to frame, at six operations a turn about
a coordinate axis; rotation matrices are never formed. Two points are compared in the last frame that carries both, so
that an expression holds the joints between them and no others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.robot import BASE, Compensator, Joint, Loop, Robot, unit_axis

# (3,), m: an array where all its coordinates are numbers, else a column of SX.
Point: TypeAlias = Any
NUMBERS: Mapping[str, ca.SX] = MappingProxyType({})


@dataclass(frozen=True)
class BodyFrame:
    """A joint's frame: constant rotation R (3, 3) and origin p (3,) in the parent frame, then a turn about `axis`.

    parent: index of the frame it is carried by, -1 for the base.  axis: 0, 1, 2 of its own x, y, z.  slides: the joint
    moves the frame along the axis instead of turning it about it.  zero: rad, added to the angle of the turn.
    """

    parent: int
    R: FloatArray
    p: Point
    axis: int
    slides: bool = False
    zero: Any = 0.0

    def angle(self, q: Any) -> Any:
        """Return the angle of the turn at the position q of the joint; exactly q for a zero offset of 0."""
        return q if isinstance(self.zero, float) and self.zero == 0 else q + self.zero


@dataclass(frozen=True)
class Attachment:
    """Seat of a body: the frame that carries it (-1: the base), rotation and origin of its own axes in there."""

    frame: int
    R: FloatArray
    p: Point

    def placed(self, rotation: FloatArray, xyz: Point) -> "Attachment":
        """Return the seat at xyz (3,) and with a rotation (3, 3) in these axes."""
        is_number = isinstance(self.p, np.ndarray) and isinstance(xyz, np.ndarray)
        p = _clean(self.p + self.R @ xyz) if is_number else ca.SX(self.p) + ca.DM(self.R) @ xyz
        return Attachment(self.frame, _clean(self.R @ rotation), p)


ON_BASE = Attachment(-1, np.eye(3), np.zeros(3))


@dataclass(frozen=True)
class Tree:
    """Robot as frames (one per joint, in the robot's order), attachments (one per body), and named frames."""

    frames: tuple[BodyFrame, ...]
    attachments: tuple[Attachment, ...]
    named: tuple[Attachment, ...] = ()


def tree(robot: Robot, theta: Mapping[str, ca.SX] = NUMBERS) -> Tree:
    """Build the frames of a robot's joints, with placements and oblique axes as constants.

    theta: names to symbols; coordinates among them are these symbols, all others numbers.
    """
    frames = []
    seats = {BASE: ON_BASE}
    for body in robot.all_bodies:
        seat = seats[body.parent].placed(body.placement.rotation, located(f"p_{body.name}", body.placement.xyz, theta))
        for joint in body.joints:
            axis, align = _axis_and_rotation(joint)
            point = located(f"pj_{joint.name}", joint.point, theta)
            at_point = seat.placed(align, point)
            zero = theta.get(f"zero_{joint.name}", joint.zero)
            frames.append(BodyFrame(at_point.frame, at_point.R, at_point.p, axis, joint.slides, zero))
            seat = replace(Attachment(len(frames) - 1, -align.T, np.zeros(3)).placed(np.eye(3), point), R=align.T)
        seats[body.name] = seat.placed(body.mounting.rotation, np.array(body.mounting.xyz))
    placements = ((seats[frame.body], frame.placement) for frame in robot.frames)
    frame_attachments = tuple(seat.placed(place.rotation, np.array(place.xyz)) for seat, place in placements)
    return Tree(tuple(frames), tuple(seats[body.name] for body in robot.all_bodies), frame_attachments)


def located(name: str, xyz: Sequence[float], theta: Mapping[str, ca.SX]) -> Point:
    """Return a point as numbers, or as symbols for the coordinates name_x, ... that theta contains."""
    names = [f"{name}_{axis}" for axis in "xyz"]
    if not any(name in theta for name in names):
        return np.array(xyz, dtype=float)
    return ca.vertcat(*(theta.get(name, number) for name, number in zip(names, xyz, strict=True)))


def _axis_and_rotation(joint: Joint) -> tuple[int, FloatArray]:
    """Return the coordinate axis of the motion, and the constant rotation from it to the joint's axis."""
    direction = unit_axis(joint.axis)
    largest = int(np.argmax(np.abs(direction)))
    if direction[largest] == 1.0:
        return largest, np.eye(3)
    x = np.cross(np.eye(3)[(largest + 1) % 3], direction)
    x /= np.linalg.norm(x)
    return 2, _clean(np.column_stack([x, np.cross(direction, x), direction]))


def _clean(array: FloatArray) -> FloatArray:
    """Set rounding residues of sines and cosines to 0 and +-1, so that CasADi omits the products."""
    nearest = np.round(array)
    return np.where(np.abs(array - nearest) < 4 * np.finfo(float).eps, nearest, array)


# The two axes that turn about each axis.
PLANES = ((1, 2), (2, 0), (0, 1))


@dataclass(frozen=True)
class Turn:
    """A rotation about coordinate axis k by an angle of cosine c and sine s; i, j, k in cyclic order.

    origin (3,): of the turned frame in its parent, which changes where the joint slides; there c = 1 and s = 0, and
    products with them drop out.
    """

    k: int
    c: ca.SX
    s: ca.SX
    origin: ca.SX

    def forth(self, v: ca.SX) -> ca.SX:
        """Rotate vectors v (3, n) of the turned frame into the axes before the turn."""
        i, j = PLANES[self.k]
        w = ca.SX(v)
        w[i, :], w[j, :] = self.c * v[i, :] - self.s * v[j, :], self.s * v[i, :] + self.c * v[j, :]
        return w

    def back(self, v: ca.SX) -> ca.SX:
        """Rotate vectors v (3, n) of the frame before the turn into the turned axes."""
        return replace(self, s=-self.s).forth(v)

    def tensor(self, T: ca.SX) -> ca.SX:
        """Rotate the symmetric tensor T (3, 3) of the turned frame into the axes before the turn, in 9 products."""
        (i, j), k, c, s = PLANES[self.k], self.k, self.c, self.s
        u = s * (T[i, i] - T[j, j]) + c * (2 * T[i, j])
        W = ca.SX(T)
        W[i, i], W[j, j] = T[i, i] - s * u, T[j, j] + s * u
        W[i, j] = W[j, i] = c * u - T[i, j]
        W[i, k] = W[k, i] = c * T[i, k] - s * T[j, k]
        W[j, k] = W[k, j] = s * T[i, k] + c * T[j, k]
        return W


def turns(layout: Tree, q: ca.SX) -> tuple[Turn, ...]:
    """Return the turn of each joint at q (n,); shared by all terms, so that sine and cosine are computed once."""
    return tuple(
        Turn(frame.axis, ca.SX(1), ca.SX(0), ca.SX(frame.p) + ca.DM(frame.R[:, frame.axis]) * q[i])
        if frame.slides
        else Turn(frame.axis, ca.cos(frame.angle(q[i])), ca.sin(frame.angle(q[i])), ca.SX(frame.p))
        for i, frame in enumerate(layout.frames)
    )


def seat(robot: Robot, layout: Tree, body: str) -> Attachment:
    """Return the seat of a body in the tree of frames; `base` for the base itself. KeyError for an unknown body."""
    seats = {BASE: ON_BASE}
    seats |= {part.name: placement for part, placement in zip(robot.all_bodies, layout.attachments, strict=True)}
    if body not in seats:
        raise KeyError(f"robot {robot.name} has no body {body}; there are {', '.join(seats)}")
    return seats[body]


def ends_of(
    robot: Robot, layout: Tree, link: Loop | Compensator, letter: str, theta: Mapping[str, ca.SX]
) -> tuple[tuple[Attachment, Point], ...]:
    """Return body and location of both ends of a loop or a compensator. letter: prefix of the coordinate names."""
    return tuple(
        (seat(robot, layout, end.body), located(f"{letter}{i}_{link.name}", end.point, theta))
        for i, end in enumerate(link.ends, start=1)
    )


def rotation(layout: Tree, joint_turns: Sequence[Turn], seat: Attachment) -> ca.SX:
    """Return R (3, 3) from the axes of a body to the base axes."""
    return ca.horzcat(*(direction(layout, joint_turns, seat, axis) for axis in np.eye(3)))


def position(
    layout: Tree, joint_turns: Sequence[Turn], seat: Attachment, point: Point = (0.0, 0.0, 0.0), seen_from: int = -1
) -> ca.SX:
    """Return a point (3,) of a body, in the body's axes, in the axes of the frame `seen_from` (-1: the base), m.

    seat: of the body.  joint_turns: of `turns(layout, q)`.  seen_from: the body's frame or one that carries it.
    """
    p = ca.SX(seat.p) + ca.DM(seat.R) @ ca.vertcat(point)
    frame = seat.frame
    while frame != seen_from:
        p = joint_turns[frame].origin + ca.DM(layout.frames[frame].R) @ joint_turns[frame].forth(p)
        frame = layout.frames[frame].parent
    return p


def direction(
    layout: Tree, joint_turns: Sequence[Turn], seat: Attachment, vector: FloatArray, seen_from: int = -1
) -> ca.SX:
    """Return a direction (3,) of a body in the axes of the frame `seen_from`, as for `position`."""
    tip, foot = (position(layout, joint_turns, seat, point, seen_from) for point in (vector.tolist(), (0.0, 0.0, 0.0)))
    return tip - foot


def last_common(layout: Tree, first: int, second: int) -> int:
    """Return the last frame that carries both frames, itself included; -1 if only the base does."""
    below = set(carriers(layout, first))
    return next((frame for frame in carriers(layout, second) if frame in below), -1)


def between(
    layout: Tree, joint_turns: Sequence[Turn], first: tuple[Attachment, Point], second: tuple[Attachment, Point]
) -> ca.SX:
    """Return the vector (3,) between points of two bodies, in the axes of the last frame that carries both, m."""
    frame = last_common(layout, first[0].frame, second[0].frame)
    return position(layout, joint_turns, *second, frame) - position(layout, joint_turns, *first, frame)


def carriers(layout: Tree, frame: int) -> list[int]:
    """List the frame and all frames that carry it, without the base."""
    frames = []
    while frame >= 0:
        frames.append(frame)
        frame = layout.frames[frame].parent
    return frames
