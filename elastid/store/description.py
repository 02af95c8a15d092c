"""What is in an artefact, in plain words."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from elastid.store.files import attributes, opened


def kind_of(path: Path) -> str | None:
    """Which artefact of elastid a file is; None where it is none."""
    try:
        with h5py.File(path, "r") as file:
            kind = file.attrs.get("elastid")
    except OSError:
        return None
    return kind if isinstance(kind, str) else None


def described(path: Path) -> str:
    """Groups, variables with axes, shapes and units, and where the file came from."""
    kind = kind_of(path) or ""
    with opened(path, kind) as file:
        return "\n".join([f"{path}: {kind}, written by elastid", *_lines(file, 1)])


def _lines(group: Any, depth: int) -> Iterator[str]:
    indent = "  " * depth
    for name, value in attributes(group).items():
        if name not in ("elastid", "study"):
            yield f"{indent}{name} = {value}"
    for name, item in group.items():
        if isinstance(item, h5py.Group):
            yield f"{indent}{name}/"
            yield from _lines(item, depth + 1)
        elif name != "study":
            yield f"{indent}{name} {_axes(item)}{_words(item)}"


def _axes(dataset: Any) -> str:
    if dataset.is_scale:
        return f"({dataset.size})"
    return "(" + ", ".join(f"{d.label} {n}" for d, n in zip(dataset.dims, dataset.shape, strict=True)) + ")"


def _words(dataset: Any) -> str:
    units, long_name = dataset.attrs.get("units"), dataset.attrs.get("long_name", "")
    return f": {long_name}" + (f" [{units}]" if units else "")
