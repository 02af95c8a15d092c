"""The points of a robot's skeleton: joints, bodies, centres of mass, frames and further ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.frame_tree import Attachment, Tree
from elastid.robot import BASE, Robot


@dataclass(frozen=True, eq=False)
class Knot:
    """A point: local (3,) in the axes of a joint's frame, -1 for the base.  of: the body, joint or frame.

    behind: the knot that a straight link leads here from, -1 for the first one, the base.
    """

    kind: Literal["base", "joint", "body", "center of mass", "point", "frame"]
    of: str
    frame: int
    local: FloatArray
    behind: int
    number: int = 0

    @property
    def name(self) -> str:
        """In words."""
        if self.kind == "base":
            return "base"
        if self.kind == "point":
            return f"point {self.number} of {self.of}"
        return f"{self.kind}{' of' if self.kind == 'center of mass' else ''} {self.of}"


def knots(robot: Robot, layout: Tree, further: Mapping[str, Sequence[Sequence[float]]]) -> list[Knot]:
    """The base first, then body by body, then the frames.  further: body name to points in the body's own axes."""
    found = [Knot("base", BASE, -1, np.zeros(3), -1)]
    origin = {BASE: 0}
    found += _points(Attachment(-1, np.eye(3), np.zeros(3)), BASE, 0, further)
    for body, seat in zip(robot.all_bodies, layout.attachments, strict=True):
        # A body's joints start from one origin, but for those at a point of their own.
        first = seat.frame - len(body.joints) + 1
        for i, joint in enumerate(body.joints):
            if i == 0 or any(joint.point):
                above = origin.get(body.name, origin[body.parent])
                found.append(Knot("joint", joint.name, first + i, np.zeros(3), above))
                origin[body.name] = len(found) - 1
        if not body.joints or any(body.mounting.xyz) or any(any(joint.point) for joint in body.joints):
            above = origin.get(body.name, origin[body.parent])
            found.append(Knot("body", body.name, seat.frame, seat.p, above))
            origin[body.name] = len(found) - 1
        at = seat.p + seat.R @ np.array(body.center_of_mass)
        found.append(Knot("center of mass", body.name, seat.frame, at, origin[body.name]))
        found += _points(seat, body.name, origin[body.name], further)
    for frame, seat in zip(robot.frames, layout.named, strict=True):
        found.append(Knot("frame", frame.name, seat.frame, seat.p, origin[frame.body]))
    return found


def _points(seat: Attachment, body: str, behind: int, further: Mapping[str, Sequence[Sequence[float]]]) -> list[Knot]:
    points = enumerate(further.get(body, ()), start=1)
    return [Knot("point", body, seat.frame, seat.p + seat.R @ np.array(p), behind, i) for i, p in points]
