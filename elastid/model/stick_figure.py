r"""The robot as a stick figure in small motion: bodies, rods of loops, struts of compensators.

.. math:: \delta p = J(q)\, \delta q_l
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.frame_tree import tree
from elastid.model.kinematics import frames, knots, placed, point_jacobians
from elastid.robot import Robot

StickKind: TypeAlias = Literal["arm", "mass", "strut"]


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
    """The sticks at positions q (n_l,) of all joints."""
    layout = tree(robot)
    anchors, ends = _anchors(robot)
    # Centres of mass only where nothing else shows how far a body reaches.
    carriers = {body.parent for body in robot.all_bodies} | {frame.body for frame in robot.frames}
    every = knots(robot, layout, anchors)
    shown = [i for i, knot in enumerate(every) if knot.kind != "center of mass" or knot.owner not in carriers]
    visible = [every[i] for i in shown]
    R, p = frames(layout, np.asarray(q, dtype=float)[None])
    points = [placed(R, p, knot.frame, knot.local, 1) for knot in visible]
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
    """Points of bodies that loops and compensators end on; of each of these its two ends: body, number of its point."""
    anchors: dict[str, list[Sequence[float]]] = {}
    pairs = []
    for ends in (*(loop.ends for loop in robot.loops), *(compensator.ends for compensator in robot.compensators)):
        for end in ends:
            anchors.setdefault(end.body, []).append(end.point)
        pairs.append(tuple((end.body, len(anchors[end.body])) for end in ends))
    return anchors, pairs
