"""Velocities of frames and bodies, and gravity as they see it, as Jacobians to the joints' rates, in CasADi."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.frame_tree import Attachment, Tree, Turn


@dataclass(frozen=True)
class Rates:
    """Jacobians (3, n) of a frame: its angular velocity and the velocity of its origin, in its own axes."""

    angular: ca.SX
    linear: ca.SX

    def at(self, seat: Attachment) -> Rates:
        """Those of axes fixed in the frame at a seat."""
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
