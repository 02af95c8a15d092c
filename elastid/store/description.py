"""Content of an artefact as text, for `elastid inspect`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from elastid.base.large_arrays import PIECE_VALUES
from elastid.base.value_range import format_range, format_values, value_range
from elastid.store.artefacts import kind_of, open_artefact, plain


def describe_artefact(path: Path | str) -> str:
    """Describe the groups, datasets (axes, shapes, units, values) and provenance of an artefact in plain text."""
    kind = kind_of(path) or ""
    with open_artefact(path, kind) as file:
        return "\n".join([f"{path}: {kind}, written by elastid", *_content_lines(file, 1)])


def _content_lines(group: Any, depth: int) -> Iterator[str]:
    """Yield a line for each attribute, group and dataset below a group."""
    indent = "  " * depth
    for name, value in group.attrs.items():
        if name not in ("elastid", "study"):
            yield f"{indent}{name} = {plain(value)}"
    for name, item in group.items():
        if isinstance(item, h5py.Group):
            yield f"{indent}{name}/"
            yield from _content_lines(item, depth + 1)
        elif name != "study":
            yield f"{indent}{name} {_axes(item)}{_label_text(item)}{_format_values(item)}"


def _axes(dataset: Any) -> str:
    if dataset.attrs.get("CLASS") == b"DIMENSION_SCALE":
        return f"({dataset.size})"
    # `dataset.dims` would end the process if this attribute is damaged: HDF5 does not check its type.
    labels = np.asarray(dataset.attrs.get("DIMENSION_LABELS", []))
    if labels.shape != (dataset.ndim,):
        labels = np.full(dataset.ndim, "")
    axis_names = (label.decode(errors="replace") if isinstance(label, bytes) else str(label) for label in labels)
    return "(" + ", ".join(f"{word} {n}".strip() for word, n in zip(axis_names, dataset.shape, strict=True)) + ")"


def _label_text(dataset: Any) -> str:
    units, long_name = dataset.attrs.get("units"), dataset.attrs.get("long_name", "")
    return (f": {long_name}" if long_name else "") + (f" [{units}]" if units else "")


def _format_values(dataset: Any) -> str:
    if not dataset.size:
        return ""
    if dataset.dtype.kind not in "fiubc":
        return f" = {format_values(np.asarray(dataset.asstr()[()]))}"
    if dataset.size <= PIECE_VALUES:
        return f" = {format_values(np.asarray(dataset[()]))}"
    n = max(1, PIECE_VALUES * len(dataset) // dataset.size)
    blocks = (dataset[start : start + n] for start in range(0, len(dataset), n))
    return f" = {format_range(value_range(blocks), dataset.dtype.kind == 'c')}"
