r"""Positions of points of a robot's bodies, as CasADi expressions of the joints' coordinates.

.. math:: p = p_i + R_i\, T_i(q_i)\, p_{i+1}

from the body up to a frame that carries it. A point is transformed from frame to frame, at six operations a turn about
a coordinate axis; rotation matrices are never formed. Two points are compared in the last frame that carries both, so
that an expression holds the joints between them and no others.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from elastid.model.frame_tree import Attachment, Point, Tree, Turn
from elastid.robot import BASE, Robot


def seat(robot: Robot, layout: Tree, body: str) -> Attachment:
    """Where a body sits in the tree of frames; `base` for the base itself. KeyError for an unknown body."""
    if body == BASE:
        return Attachment(-1, np.eye(3), np.zeros(3))
    for candidate, attachment in zip(robot.all_bodies, layout.attachments, strict=True):
        if candidate.name == body:
            return attachment
    raise KeyError(
        f"robot {robot.name} has no body {body}; there are {BASE}, {', '.join(b.name for b in robot.all_bodies)}"
    )


def position(
    layout: Tree, turned: Sequence[Turn], at: Attachment, point: Point | Sequence[float], seen_from: int = -1
) -> ca.SX:
    """A point (3,) of a body, given in the body's axes, in the axes of the frame `seen_from` (-1: the base), m.

    at: where the body sits.  turned: of `turns(layout, q)`.  seen_from: the body's frame or one that carries it.
    """
    p = ca.SX(at.p) + ca.DM(at.R) @ ca.vertcat(point)
    frame = at.frame
    while frame != seen_from:
        p = turned[frame].origin + ca.DM(layout.frames[frame].R) @ turned[frame].forth(p)
        frame = layout.frames[frame].parent
    return p


def last_common(layout: Tree, first: int, second: int) -> int:
    """The last frame that carries both frames, itself included; -1 where only the base does."""
    below = set(_chain(layout, first))
    return next((frame for frame in _chain(layout, second) if frame in below), -1)


def between(
    layout: Tree,
    turned: Sequence[Turn],
    first: tuple[Attachment, Point | Sequence[float]],
    second: tuple[Attachment, Point | Sequence[float]],
) -> ca.SX:
    """The vector (3,) from one body's point to another's, in the axes of the last frame that carries both, m."""
    frame = last_common(layout, first[0].frame, second[0].frame)
    start, end = (position(layout, turned, at, point, frame) for at, point in (first, second))
    return end - start


def _chain(layout: Tree, frame: int) -> list[int]:
    """The frame and all that carry it, the base left out."""
    frames = []
    while frame >= 0:
        frames.append(frame)
        frame = layout.frames[frame].parent
    return frames
