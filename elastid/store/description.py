"""The content of an artefact: groups, variables with axes, shapes, units and values, and the provenance."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from elastid.base.arrays import shown_range, shown_values, value_range
from elastid.store.files import attributes, kind_of, opened

# Values that are in memory at a time where a range is found.
_BLOCK_VALUES = 1 << 20


def described(path: Path | str) -> str:
    """Groups, variables with axes, shapes, units and values, and the provenance of a file."""
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
            yield f"{indent}{name} {_axes(item)}{_words(item)}{_values(item)}"


def _axes(dataset: Any) -> str:
    if dataset.attrs.get("CLASS") == b"DIMENSION_SCALE":
        return f"({dataset.size})"
    # Not by `dataset.dims`: HDF5 takes the type of this attribute on trust, and a damaged one ends the process.
    labels = np.asarray(dataset.attrs.get("DIMENSION_LABELS", []))
    if labels.shape != (dataset.ndim,):
        labels = np.full(dataset.ndim, "")
    words = (each.decode(errors="replace") if isinstance(each, bytes) else str(each) for each in labels)
    return "(" + ", ".join(f"{word} {n}".strip() for word, n in zip(words, dataset.shape, strict=True)) + ")"


def _words(dataset: Any) -> str:
    units, long_name = dataset.attrs.get("units"), dataset.attrs.get("long_name", "")
    return (f": {long_name}" if long_name else "") + (f" [{units}]" if units else "")


def _values(dataset: Any) -> str:
    if not dataset.size:
        return ""
    if dataset.dtype.kind not in "fiubc":
        return f" = {shown_values(np.asarray(dataset.asstr()[()]))}"
    if dataset.size <= _BLOCK_VALUES:
        return f" = {shown_values(np.asarray(dataset[()]))}"
    n = max(1, _BLOCK_VALUES * len(dataset) // dataset.size)
    blocks = (dataset[start : start + n] for start in range(0, len(dataset), n))
    return f" = {shown_range(value_range(blocks), dataset.dtype.kind == 'c')}"
