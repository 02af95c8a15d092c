r"""Masses of a tree of rigid bodies with joints that turn or slide: mass matrix and bias forces, in CasADi.

.. math:: M(q) \ddot q + c(q, \dot q) + g(q) = \tau

Niglis & Oberg (2015), eq. (2.7). Recursions in joint frames: M by composite rigid bodies, c + g by Newton-Euler
(Featherstone, Rigid Body Dynamics Algorithms, 2008, chapters 5 and 6), on 3-vectors. M is linear in masses and
inertias, g in masses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.frame_tree import Attachment, BodyFrame, Tree, Turn
from elastid.robot import Body, Robot


@dataclass(frozen=True)
class BodyInertia:
    """Mass m, first moment h (3,) = m c and inertia tensor I (3, 3) about a frame's origin, in the frame's axes."""

    m: ca.SX
    h: ca.SX
    I: ca.SX  # noqa: E741

    def __add__(self, other: BodyInertia) -> BodyInertia:
        return BodyInertia(self.m + other.m, self.h + other.h, self.I + other.I)


def inertias(robot: Robot, layout: Tree, theta: Mapping[str, ca.SX]) -> tuple[BodyInertia, ...]:
    """The inertia that each frame carries, summed over its bodies, as symbols of theta; not that fixed to the base."""
    carried = [_nothing() for _ in layout.frames]
    for body, seat in zip(robot.all_bodies, layout.attachments, strict=True):
        if seat.frame >= 0:
            carried[seat.frame] += _inertia(body, seat, theta)
    return tuple(carried)


def _nothing() -> BodyInertia:
    return BodyInertia(ca.SX(0), ca.SX.zeros(3), ca.SX.zeros(3, 3))


def _inertia(body: Body, seat: Attachment, theta: Mapping[str, ca.SX]) -> BodyInertia:
    m = theta[f"m_{body.name}"]
    c = seat.p + ca.DM(seat.R) @ ca.vertcat(*(theta[f"c_{body.name}_{a}"] for a in "xyz"))
    xx, yy, zz, xy, xz, yz = _tensor(body, theta)
    about_com = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
    h = m * c
    steiner = ca.dot(c, h) * ca.DM.eye(3) - h @ c.T
    return BodyInertia(m, h, ca.DM(seat.R) @ about_com @ ca.DM(seat.R.T) + steiner)


def _tensor(body: Body, theta: Mapping[str, ca.SX]) -> list[ca.SX]:
    entries = [theta[f"I_{body.name}{suffix}"] for suffix in body.inertia_entries]
    return (entries * 3 if len(entries) == 1 else entries) + [ca.SX(0)] * (6 - max(3, len(entries)))


def composites(layout: Tree, carried: tuple[BodyInertia, ...], turned: tuple[Turn, ...]) -> tuple[BodyInertia, ...]:
    """The inertia that each joint moves, in its own frame; last, that of the robot about the base's origin."""
    total = [*carried, _nothing()]
    for i in reversed(range(len(layout.frames))):
        total[layout.frames[i].parent] += _seen_from_parent(total[i], layout.frames[i], turned[i])
    return tuple(total)


def _seen_from_parent(body: BodyInertia, frame: BodyFrame, turn: Turn) -> BodyInertia:
    R, p = ca.DM(frame.R), turn.origin
    h, tensor = R @ turn.forth(body.h), R @ turn.tensor(body.I) @ R.T
    # Steiner's theorem twice over: I - [p x][h x] - [h x][p x] - m [p x][p x], by way of g = 2 h + m p.
    g = 2 * h + body.m * p
    product = p @ g.T
    tensor += ca.trace(product) * ca.DM.eye(3) - (product + product.T) / 2
    return BodyInertia(body.m, h + body.m * p, tensor)


def mass_matrix(layout: Tree, composite: tuple[BodyInertia, ...], turned: tuple[Turn, ...]) -> ca.SX:
    """M (n, n), symmetric: row i is the momentum that joint i makes at a rate of 1, on every joint below it."""
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
    """The part of a moment (3,) about a frame's origin and of a force (3,) that its joint bears."""
    return force[frame.axis] if frame.slides else moment[frame.axis]


def _force_on_parent(moment: ca.SX, force: ca.SX, frame: BodyFrame, turn: Turn) -> tuple[ca.SX, ca.SX]:
    """Moment about the origin and force (3,) of a frame, in its parent's axes and about the parent's origin."""
    R = ca.DM(frame.R)
    force = R @ turn.forth(force)
    return R @ turn.forth(moment) + ca.cross(turn.origin, force), force


def bias(
    layout: Tree,
    carried: tuple[BodyInertia, ...],
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


def _unit(axis: int) -> ca.DM:
    return ca.DM(np.eye(3)[axis])
