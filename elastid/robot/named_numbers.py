"""Named numbers of a robot, those that can be identified: the unit of each and its path in the description.

A path is the attributes and positions that lead to the number from the object: ("joints", 0, "spring", "stiffness").
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeAlias

Path: TypeAlias = tuple[str | int, ...]
# name: (SI unit, path)
Numbers: TypeAlias = dict[str, tuple[str, Path]]


def coordinates(prefix: str, path: Path) -> Numbers:
    """The three coordinates of a point: prefix_x, prefix_y and prefix_z."""
    return {f"{prefix}_{axis}": ("m", (*path, i)) for i, axis in enumerate("xyz")}


def below(path: str | Path, numbers: Numbers) -> Numbers:
    """The numbers of a part, seen from the object that has the part at `path`."""
    steps = (path,) if isinstance(path, str) else path
    return {name: (unit, (*steps, *inner)) for name, (unit, inner) in numbers.items()}


def number_at(description: Any, path: Path) -> float:
    """The number at a path."""
    for step in path:
        description = description[step] if isinstance(step, int) else getattr(description, step)
    return float(description)


def replaced(description: Any, values: Mapping[Path, float]) -> Any:
    """The same description with other numbers at these paths, each dataclass checked again once all are in it."""
    if () in values:
        return values[()]
    inner: dict[str | int, dict[Path, float]] = {}
    for (step, *rest), value in values.items():
        inner.setdefault(step, {})[tuple(rest)] = value
    if isinstance(description, tuple):
        return tuple(replaced(part, inner[i]) if i in inner else part for i, part in enumerate(description))
    return replace(
        description, **{str(step): replaced(getattr(description, str(step)), part) for step, part in inner.items()}
    )
