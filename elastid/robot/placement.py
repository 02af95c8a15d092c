"""Placement: directions, vectors and placements of a robot, and access to its named numbers.

A named number has a unit and a path of attributes and indices: ("joints", 0, "spring", "stiffness").
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.section import Key, section
from elastid.base.units import Angle, InUnit, Length

Axis: TypeAlias = Literal["x", "y", "z"] | tuple[float, float, float]
Vector3: TypeAlias = tuple[Length, Length, Length]
Angles3: TypeAlias = tuple[Angle, Angle, Angle]
Acceleration3: TypeAlias = tuple[
    Annotated[float, InUnit("m/s^2")], Annotated[float, InUnit("m/s^2")], Annotated[float, InUnit("m/s^2")]
]


def unit_axis(axis: Axis) -> FloatArray:
    """Return a direction (3,) of length one; ValueError for the zero vector."""
    vector = np.eye(3)["xyz".index(axis)] if isinstance(axis, str) else np.array(axis, dtype=float)
    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise ValueError("an axis is the zero vector; give a direction such as [0, 0, 1] or z")
    return vector / length


@section
class Placement:
    """Translation and rotation of a frame in its parent."""

    # fmt: off
    xyz: Annotated[Vector3, Key("Translation along the axes of the parent.", "measured before any rotation of the "
        "child.")] = (0.0, 0.0, 0.0)
    rpy: Annotated[Angles3, Key("Roll, pitch and yaw about fixed axes, after the translation.", "use one angle where "
        "possible; URDF uses the same order, most robot controllers a different one.")] = (0.0, 0.0, 0.0)
    # fmt: on

    @classmethod
    def of(cls, rotation: FloatArray, translation: FloatArray) -> "Placement":
        """Return the placement for a rotation (3, 3) and a translation (3,); at a pitch of +-90 deg the yaw is 0."""
        R = rotation
        cosine = float(np.hypot(R[0, 0], R[1, 0]))
        if cosine > 1e-9:  # otherwise roll and yaw have the same axis
            roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
        else:
            roll, yaw = np.arctan2(-R[1, 2], R[1, 1]), 0.0
        x, y, z = (float(length) for length in translation)
        return cls((x, y, z), (float(roll), float(np.arctan2(-R[2, 0], cosine)), float(yaw)))

    def then(self, *placements: "Placement") -> "Placement":
        """Return the placement of the last frame of a chain, each placed in the frame before it."""
        R, p = self.rotation, np.array(self.xyz)
        for placement in placements:
            R, p = R @ placement.rotation, p + R @ np.array(placement.xyz)
        return Placement.of(R, p)

    @property
    def rotation(self) -> FloatArray:
        """R (3, 3) = Rz(yaw) Ry(pitch) Rx(roll), with the axes of the frame as columns in the parent's frame."""
        (sr, sp, sy), (cr, cp, cy) = np.sin(self.rpy), np.cos(self.rpy)
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )


Path: TypeAlias = tuple[str | int, ...]
# name: (SI unit, path)
Numbers: TypeAlias = dict[str, tuple[str, Path]]


def coordinates(prefix: str, path: Path) -> Numbers:
    """Return the three coordinates of a point: prefix_x, prefix_y and prefix_z."""
    return {f"{prefix}_{axis}": ("m", (*path, i)) for i, axis in enumerate("xyz")}


def below(path: str | Path, numbers: Numbers) -> Numbers:
    """Return the numbers of an attribute with paths from its owner, in which the attribute has the path `path`."""
    steps = (path,) if isinstance(path, str) else path
    return {name: (unit, (*steps, *inner)) for name, (unit, inner) in numbers.items()}


def number_at(description: Any, path: Path) -> float:
    """Return the number at a path."""
    for step in path:
        description = description[step] if isinstance(step, int) else getattr(description, step)
    return float(description)


def replaced(description: Any, values: Mapping[Path, float]) -> Any:
    """Return the description with other numbers at these paths; every changed dataclass is checked again."""
    if () in values:
        return values[()]
    inner: dict[str | int, dict[Path, float]] = {}
    for (step, *further), value in values.items():
        inner.setdefault(step, {})[tuple(further)] = value
    if isinstance(description, tuple):
        return tuple(replaced(entry, inner[i]) if i in inner else entry for i, entry in enumerate(description))
    return replace(
        description, **{str(step): replaced(getattr(description, str(step)), entry) for step, entry in inner.items()}
    )
