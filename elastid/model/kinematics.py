r"""Where a robot's bodies are: positions of joints, centres of mass and points of bodies, and the tool's Jacobian.

Many postures at once, in NumPy; elastic joints that are not driven stand at 0. All in the base frame, m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.arrays import BoolArray, FloatArray
from elastid.model.multibody import Attachment, Tree, tree
from elastid.model.parallel_linkage.assembly import followed, rates
from elastid.robot import BASE, Robot


@dataclass(frozen=True)
class Skeleton:
    """Points of a robot in Q postures and the straight links between them.

    points (Q, n, 3).  names: what each point is.  links: pairs of points.  moves (n,): whether any joint moves it.
    tool: the point that is the last centre of mass.
    """

    points: FloatArray
    names: tuple[str, ...]
    links: tuple[tuple[int, int], ...]
    moves: BoolArray
    tool: int


def skeleton(
    robot: Robot, angles: FloatArray, further: Mapping[str, Sequence[Sequence[float]]] | None = None
) -> Skeleton:
    """The skeleton at the driven joints' angles (Q, n_u): base, joints, centres of mass, and further points of bodies.

    further: body name to points in the body's own axes.
    """
    layout = tree(robot)
    R, p = _frames(layout, link_angles(robot, angles))
    names, links, moves = ["base"], [], [False]
    points = [np.zeros((len(angles), 3))]
    origin = {BASE: 0}
    tool = 0

    def add(name: str, at: FloatArray, mobile: bool, linked_to: int) -> int:
        names.append(name)
        points.append(at)
        moves.append(mobile)
        links.append((linked_to, len(names) - 1))
        return len(names) - 1

    for body, seat in zip(robot.bodies, layout.attachments, strict=True):
        # A body's joints turn about one origin, which only what is below the first of them moves.
        carrier = layout.frames[seat.frame - len(body.joints) + 1].parent if body.joints else seat.frame
        name = f"joint {body.joints[0].name}" if body.joints else f"body {body.name}"
        origin[body.name] = add(name, _placed(R, p, seat, np.zeros(3)), carrier >= 0, origin[body.parent])
        tool = add(
            f"center of mass of {body.name}",
            _placed(R, p, seat, np.array(body.center_of_mass)),
            seat.frame >= 0,
            origin[body.name],
        )
        for i, point in enumerate((further or {}).get(body.name, ()), start=1):
            at = _placed(R, p, seat, np.array(point))
            add(f"point {i} of {body.name}", at, seat.frame >= 0, origin[body.name])
    return Skeleton(np.stack(points, axis=1), tuple(names), tuple(links), np.array(moves), tool)


def tool_jacobian(robot: Robot, angles: FloatArray) -> FloatArray:
    """J (Q, 6, n_u): velocity (m/s) of the last body's centre of mass and its angular velocity per driven joint's."""
    layout = tree(robot)
    q = link_angles(robot, angles)
    R, p = _frames(layout, q)
    seat = layout.attachments[-1]
    tool = _placed(R, p, seat, np.array(robot.bodies[-1].center_of_mass))
    J = np.zeros((len(angles), 6, len(robot.joints)))
    for i in _chain(layout, seat.frame):
        axis = R[i][:, :, layout.frames[i].axis]
        J[:, :3, i], J[:, 3:, i] = np.cross(axis, tool - p[i]), axis
    return J @ rates(robot, q)


def link_angles(robot: Robot, angles: FloatArray) -> FloatArray:
    """Angles (Q, n_l) of all joints from those of the driven ones (Q, n_u), loops closed as far as they go."""
    return followed(robot, angles)


def _frames(layout: Tree, q: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    """Rotation (Q, 3, 3) and origin (Q, 3) of each joint's frame in the base frame."""
    R: list[FloatArray] = []
    p: list[FloatArray] = []
    Q = len(q)
    for i, frame in enumerate(layout.frames):
        parent_R = R[frame.parent] if frame.parent >= 0 else np.broadcast_to(np.eye(3), (Q, 3, 3))
        parent_p = p[frame.parent] if frame.parent >= 0 else np.zeros((Q, 3))
        R.append(parent_R @ frame.R @ _turn(frame.axis, q[:, i]))
        p.append(parent_p + parent_R @ frame.p)
    return R, p


def _turn(k: int, angle: FloatArray) -> FloatArray:
    turn = np.zeros((len(angle), 3, 3))
    i, j = (k + 1) % 3, (k + 2) % 3
    turn[:, k, k] = 1.0
    turn[:, i, i] = turn[:, j, j] = np.cos(angle)
    turn[:, j, i] = np.sin(angle)
    turn[:, i, j] = -turn[:, j, i]
    return turn


def _placed(R: list[FloatArray], p: list[FloatArray], seat: Attachment, point: FloatArray) -> FloatArray:
    """A point (3,) in a body's axes in the base frame (Q, 3)."""
    local = seat.p + seat.R @ point
    if seat.frame < 0:
        return np.broadcast_to(local, (len(p[0]), 3)).copy()
    placed: FloatArray = p[seat.frame] + R[seat.frame] @ local
    return placed


def _chain(layout: Tree, frame: int) -> set[int]:
    below = set()
    while frame >= 0:
        below.add(frame)
        frame = layout.frames[frame].parent
    return below
