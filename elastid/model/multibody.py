r"""Tree of rigid bodies with joints that turn or slide: mass matrix, bias forces, potential, velocities, in CasADi.

.. math:: M(q) \ddot q + c(q, \dot q) + g(q) = \tau

Niglis & Oberg (2015), eq. (2.7). Recursions in joint frames: M by composite rigid bodies, c + g by Newton-Euler
(Featherstone, Rigid Body Dynamics Algorithms, 2008, chapters 5 and 6), written on 3-vectors so that a turn about a
coordinate axis costs six operations a vector instead of a 3 x 3 product. M is linear in masses and inertias, g in
masses.

One frame a joint, fixed to what the joint moves; a joint about an oblique axis has a frame whose z is that axis. A
joint that slides moves its frame's origin along that axis and turns nothing. Origins are numbers, but for coordinates
of the geometry that are symbols of theta.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.robot import BASE, Body, Joint, Placement, Robot, unit_axis

# (3,), m: an array where all its coordinates are numbers, else a column of SX.
Point: TypeAlias = Any
NUMBERS: Mapping[str, ca.SX] = MappingProxyType({})


@dataclass(frozen=True)
class BodyFrame:
    """A joint's frame: constant rotation R (3, 3) and origin p (3,) in the parent frame, then a turn about `axis`.

    parent: index of the frame it is carried by, -1 for the base.  axis: 0, 1, 2 of its own x, y, z.  slides: the joint
    moves the frame along the axis instead of turning it about it.
    """

    parent: int
    R: FloatArray
    p: Point
    axis: int
    slides: bool = False


@dataclass(frozen=True)
class Attachment:
    """Where a body sits: the frame that carries it (-1: the base), rotation and origin of its own axes in there."""

    frame: int
    R: FloatArray
    p: Point


@dataclass(frozen=True)
class Inertia:
    """Mass m, first moment h (3,) = m c and inertia tensor I (3, 3) about a frame's origin, in the frame's axes."""

    m: ca.SX
    h: ca.SX
    I: ca.SX  # noqa: E741

    def __add__(self, other: Inertia) -> Inertia:
        return Inertia(self.m + other.m, self.h + other.h, self.I + other.I)


@dataclass(frozen=True)
class Tree:
    """The robot as frames (one a joint, in the robot's order), attachments (one a body), and those of named frames."""

    frames: tuple[BodyFrame, ...]
    attachments: tuple[Attachment, ...]
    named: tuple[Attachment, ...] = ()


def tree(robot: Robot, theta: Mapping[str, ca.SX] = NUMBERS) -> Tree:
    """Lay out the frames of a robot's joints, placements and oblique axes gone into constants.

    theta: names to symbols; coordinates among them are these symbols, all others numbers.
    """
    frames: list[BodyFrame] = []
    seats = {BASE: Attachment(-1, np.eye(3), np.zeros(3))}
    for body in robot.all_bodies:
        place = located(f"p_{body.name}", body.placement.xyz, theta)
        seat = _placed(seats[body.parent], body.placement, place)
        for joint in body.joints:
            axis, align = _aligned(joint)
            point = located(f"pj_{joint.name}", joint.point, theta)
            frames.append(
                BodyFrame(seat.frame, _clean(seat.R @ align), _beyond(seat.p, seat.R, point), axis, joint.slides)
            )
            seat = Attachment(len(frames) - 1, align.T, _beyond(np.zeros(3), -align.T, point))
        seats[body.name] = _placed(seat, body.mounting)
    named = tuple(_placed(seats[frame.body], frame.placement) for frame in robot.frames)
    return Tree(tuple(frames), tuple(seats[body.name] for body in robot.all_bodies), named)


def located(name: str, xyz: Sequence[float], theta: Mapping[str, ca.SX]) -> Point:
    """A point of the description: numbers, or the symbols of those of its coordinates name_x, ... that theta has."""
    names = [f"{name}_{axis}" for axis in "xyz"]
    if not any(each in theta for each in names):
        return np.array(xyz, dtype=float)
    return ca.vertcat(*(theta.get(each, number) for each, number in zip(names, xyz, strict=True)))


def _placed(parent: Attachment, placement: Placement, xyz: Point = None) -> Attachment:
    place = np.array(placement.xyz) if xyz is None else xyz
    return Attachment(parent.frame, _clean(parent.R @ placement.rotation), _beyond(parent.p, parent.R, place))


def _beyond(p: Point, R: FloatArray, xyz: Point) -> Point:
    """p + R xyz."""
    if isinstance(p, np.ndarray) and isinstance(xyz, np.ndarray):
        return _clean(p + R @ xyz)
    return ca.SX(p) + ca.DM(R) @ xyz


def _aligned(joint: Joint) -> tuple[int, FloatArray]:
    """The coordinate axis of the motion, and the constant rotation that carries it onto the joint's axis."""
    direction = unit_axis(joint.axis)
    largest = int(np.argmax(np.abs(direction)))
    if direction[largest] == 1.0:
        return largest, np.eye(3)
    helper = np.eye(3)[(largest + 1) % 3]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return 2, _clean(np.column_stack([x, np.cross(direction, x), direction]))


def _clean(array: FloatArray) -> FloatArray:
    """Rounding residue of sines and cosines set to 0 and +-1, so that CasADi leaves the products out."""
    nearest = np.round(array)
    return np.where(np.abs(array - nearest) < 4 * np.finfo(float).eps, nearest, array)


def inertias(robot: Robot, layout: Tree, theta: Mapping[str, ca.SX]) -> tuple[Inertia, ...]:
    """What each frame carries, its bodies summed, as symbols of theta; what is fixed to the base moves nothing."""
    carried = [_nothing() for _ in layout.frames]
    for body, seat in zip(robot.all_bodies, layout.attachments, strict=True):
        if seat.frame >= 0:
            carried[seat.frame] += _inertia(body, seat, theta)
    return tuple(carried)


def _nothing() -> Inertia:
    return Inertia(ca.SX(0), ca.SX.zeros(3), ca.SX.zeros(3, 3))


def _inertia(body: Body, seat: Attachment, theta: Mapping[str, ca.SX]) -> Inertia:
    m = theta[f"m_{body.name}"]
    c = seat.p + ca.DM(seat.R) @ ca.vertcat(*(theta[f"c_{body.name}_{a}"] for a in "xyz"))
    xx, yy, zz, xy, xz, yz = _tensor(body, theta)
    about_com = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
    h = m * c
    steiner = ca.dot(c, h) * ca.DM.eye(3) - h @ c.T
    return Inertia(m, h, ca.DM(seat.R) @ about_com @ ca.DM(seat.R.T) + steiner)


def _tensor(body: Body, theta: Mapping[str, ca.SX]) -> list[ca.SX]:
    entries = [theta[f"I_{body.name}{suffix}"] for suffix in body.inertia_entries]
    return (entries * 3 if len(entries) == 1 else entries) + [ca.SX(0)] * (6 - max(3, len(entries)))


@dataclass(frozen=True)
class Turn:
    """A rotation about coordinate axis k by an angle of cosine c and sine s; i, j, k in cyclic order.

    origin (3,): of the turned frame in its parent, which changes where the joint slides; there c = 1 and s = 0, and
    what is multiplied by them drops out.
    """

    k: int
    c: ca.SX
    s: ca.SX
    origin: ca.SX

    @property
    def plane(self) -> tuple[int, int]:
        """The two axes that turn."""
        return (self.k + 1) % 3, (self.k + 2) % 3

    def forth(self, v: ca.SX) -> ca.SX:
        """The vector v (3,) of the turned frame in the axes before the turn."""
        i, j = self.plane
        w = ca.SX(v)
        w[i], w[j] = self.c * v[i] - self.s * v[j], self.s * v[i] + self.c * v[j]
        return w

    def back(self, v: ca.SX) -> ca.SX:
        """The vector v (3,) of the frame before the turn in the turned axes."""
        i, j = self.plane
        w = ca.SX(v)
        w[i], w[j] = self.c * v[i] + self.s * v[j], self.c * v[j] - self.s * v[i]
        return w

    def tensor(self, T: ca.SX) -> ca.SX:
        """The symmetric tensor T (3, 3) of the turned frame in the axes before the turn, in 9 products."""
        (i, j), k, c, s = self.plane, self.k, self.c, self.s
        u = s * (T[i, i] - T[j, j]) + c * (2 * T[i, j])
        W = ca.SX(T)
        W[i, i], W[j, j] = T[i, i] - s * u, T[j, j] + s * u
        W[i, j] = W[j, i] = c * u - T[i, j]
        W[i, k] = W[k, i] = c * T[i, k] - s * T[j, k]
        W[j, k] = W[k, j] = s * T[i, k] + c * T[j, k]
        return W


def turns(layout: Tree, q: ca.SX) -> tuple[Turn, ...]:
    """The turn of each joint at q (n,); shared by all terms, so that sine and cosine are taken once."""
    return tuple(_turn(frame, q[i]) for i, frame in enumerate(layout.frames))


def _turn(frame: BodyFrame, q: ca.SX) -> Turn:
    if frame.slides:
        return Turn(frame.axis, ca.SX(1), ca.SX(0), ca.SX(frame.p) + ca.DM(frame.R[:, frame.axis]) * q)
    return Turn(frame.axis, ca.cos(q), ca.sin(q), ca.SX(frame.p))


def composites(layout: Tree, carried: tuple[Inertia, ...], turned: tuple[Turn, ...]) -> tuple[Inertia, ...]:
    """What each joint moves, in its own frame; the last entry is the whole robot, about the base's origin."""
    total = [*carried, _nothing()]
    for i in reversed(range(len(layout.frames))):
        total[layout.frames[i].parent] += _seen_from_parent(total[i], layout.frames[i], turned[i])
    return tuple(total)


def _seen_from_parent(body: Inertia, frame: BodyFrame, turn: Turn) -> Inertia:
    R, p = ca.DM(frame.R), turn.origin
    h, tensor = R @ turn.forth(body.h), R @ turn.tensor(body.I) @ R.T
    # Steiner's theorem twice over: I - [p x][h x] - [h x][p x] - m [p x][p x], by way of g = 2 h + m p.
    g = 2 * h + body.m * p
    product = p @ g.T
    tensor += ca.trace(product) * ca.DM.eye(3) - (product + product.T) / 2
    return Inertia(body.m, h + body.m * p, tensor)


def mass_matrix(layout: Tree, composite: tuple[Inertia, ...], turned: tuple[Turn, ...]) -> ca.SX:
    """M (n, n), symmetric: row i is the momentum of all that joint i moves, at a rate of 1, on every joint below it."""
    n = len(layout.frames)
    M = ca.SX(n, n)
    for i, frame in enumerate(layout.frames):
        angular, linear = composite[i].I[:, frame.axis], ca.cross(_unit(frame.axis), composite[i].h)
        if frame.slides:
            angular, linear = -linear, composite[i].m * _unit(frame.axis)
        M[i, i] = _along(frame, angular, linear)
        child, j = i, frame.parent
        while j >= 0:
            angular, linear = _force_on_parent(angular, linear, layout.frames[child], turned[child])
            M[i, j] = M[j, i] = _along(layout.frames[j], angular, linear)
            child, j = j, layout.frames[j].parent
    return M


def _along(frame: BodyFrame, moment: ca.SX, force: ca.SX) -> ca.SX:
    """What of a moment (3,) about a frame's origin and a force (3,) its joint has to bear."""
    return force[frame.axis] if frame.slides else moment[frame.axis]


def _force_on_parent(moment: ca.SX, force: ca.SX, frame: BodyFrame, turn: Turn) -> tuple[ca.SX, ca.SX]:
    """Moment about the origin and force (3,) of a frame, in its parent's axes and about the parent's origin."""
    R = ca.DM(frame.R)
    force = R @ turn.forth(force)
    return R @ turn.forth(moment) + ca.cross(turn.origin, force), force


def bias(
    layout: Tree,
    carried: tuple[Inertia, ...],
    turned: tuple[Turn, ...],
    v: ca.SX,
    gravity: FloatArray,
    acceleration: ca.SX | None = None,
) -> ca.SX:
    """c + g (n,): the joint torques that hold the velocities v (n,) against Coriolis, centrifugal and gravity forces.

    With an acceleration v' (n,), the inverse dynamics M v' + c + g.
    Newton-Euler, the base accelerated by -gravity. U = [alpha x] + [omega x]^2 gives the acceleration
    a + U r of a point r of a body; with S the second moments of its mass, the moment of U r is the axis of U S - S U^T.
    """
    still, rising = ca.SX.zeros(3), ca.SX(-ca.DM(gravity))
    motion: list[tuple[ca.SX, ca.SX, ca.SX]] = []  # omega, a, U of each frame
    moments, forces = [], []
    alphas: list[ca.SX] = []
    for i, (frame, turn, body) in enumerate(zip(layout.frames, turned, carried, strict=True)):
        omega, a, U = motion[frame.parent] if frame.parent >= 0 else (still, rising, ca.SX.zeros(3, 3))
        alpha = alphas[frame.parent] if frame.parent >= 0 else still
        R = ca.DM(frame.R.T)
        a = turn.back(R @ (a + U @ turn.origin))
        omega, alpha = turn.back(R @ omega), turn.back(R @ alpha)
        rate, gain = _unit(frame.axis) * v[i], _unit(frame.axis) * (0 if acceleration is None else acceleration[i])
        if frame.slides:
            a = a + 2 * ca.cross(omega, rate) + gain
        else:
            alpha = alpha + ca.cross(omega, rate) + gain
            omega = omega + rate
        U = ca.skew(alpha) + omega @ omega.T - ca.sumsqr(omega) * ca.DM.eye(3)
        motion.append((omega, a, U))
        alphas.append(alpha)
        S = ca.trace(body.I) / 2 * ca.DM.eye(3) - body.I
        moments.append(ca.cross(body.h, a) + ca.inv_skew(U @ S - (U @ S).T))
        forces.append(body.m * a + U @ body.h)
    for i in reversed(range(len(layout.frames))):
        parent = layout.frames[i].parent
        if parent >= 0:
            moment, force = _force_on_parent(moments[i], forces[i], layout.frames[i], turned[i])
            moments[parent], forces[parent] = moments[parent] + moment, forces[parent] + force
    return ca.vertcat(*(_along(*each) for each in zip(layout.frames, moments, forces, strict=True)))


@dataclass(frozen=True)
class Rates:
    """Jacobians (3, n) of a frame: its angular velocity and the velocity of its origin, in its own axes."""

    angular: ca.SX
    linear: ca.SX

    def at(self, seat: Attachment) -> Rates:
        """The same of what is fixed in the frame at a seat."""
        R = ca.DM(seat.R.T)
        across = ca.DM(_skew(seat.p)) if isinstance(seat.p, np.ndarray) else ca.skew(seat.p)
        return Rates(R @ self.angular, R @ (self.linear - across @ self.angular))


def rates(layout: Tree, turned: tuple[Turn, ...]) -> tuple[Rates, ...]:
    """The Jacobians of every joint's frame; last, of the base, which does not move."""
    n = len(layout.frames)
    still = Rates(ca.SX(3, n), ca.SX(3, n))
    found: list[Rates] = []
    for i, (frame, turn) in enumerate(zip(layout.frames, turned, strict=True)):
        below, R = found[frame.parent] if frame.parent >= 0 else still, ca.DM(frame.R.T)
        angular = _back(turn, R @ below.angular)
        linear = _back(turn, R @ (below.linear - ca.skew(turn.origin) @ below.angular))
        moved = linear if frame.slides else angular
        moved[frame.axis, i] += 1
        found.append(Rates(angular, linear))
    return (*found, still)


def _back(turn: Turn, J: ca.SX) -> ca.SX:
    return ca.horzcat(*(turn.back(ca.densify(J[:, j])) for j in range(J.size2())))


def angular_velocities(layout: Tree, moving: tuple[Rates, ...]) -> ca.SX:
    """J (3 n_bodies, n): J v stacks the absolute angular velocity of each body, in the body's own axes."""
    return ca.vertcat(*(moving[seat.frame].at(seat).angular for seat in layout.attachments))


def frame_velocities(layout: Tree, moving: tuple[Rates, ...]) -> ca.SX:
    """J (6 n_f, n): J v stacks velocity of the origin and angular velocity of each named frame, in its own axes."""
    each = [moving[seat.frame].at(seat) for seat in layout.named]
    return ca.vertcat(ca.SX(0, len(layout.frames)), *(part for J in each for part in (J.linear, J.angular)))


def gravity_in_frames(layout: Tree, turned: tuple[Turn, ...], gravity: FloatArray) -> ca.SX:
    """Gravity (3 n_f,) in the axes of each named frame."""
    seen: list[ca.SX] = []
    for frame, turn in zip(layout.frames, turned, strict=True):
        above = seen[frame.parent] if frame.parent >= 0 else ca.SX(ca.DM(gravity))
        seen.append(turn.back(ca.DM(frame.R.T) @ above))
    seen.append(ca.SX(ca.DM(gravity)))
    return ca.vertcat(ca.SX(0, 1), *(ca.DM(seat.R.T) @ seen[seat.frame] for seat in layout.named))


def _skew(p: FloatArray) -> FloatArray:
    return np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])


def _unit(axis: int) -> ca.DM:
    return ca.DM(np.eye(3)[axis])
