"""The linear models of fit.h5: matrices at the estimate, and their slopes to each parameter that moves them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, get_type_hints

import numpy as np

from elastid.linear.linear_model import LinearModel, Slope
from elastid.store.files import scale, texts
from elastid.store.values import read_value, write_value

_MATRICES = tuple(field.name for field in fields(Slope))


def write_linear(file: Any, models: Sequence[LinearModel]) -> None:
    """A group for each configuration; slopes of one matrix are one array (P, n, n) beside the names of its P."""
    group = file.create_group("linear")
    for i, model in enumerate(models):
        inner = group.create_group(str(i))
        for field in fields(LinearModel):
            if field.name != "slopes":
                write_value(inner, field.name, getattr(model, field.name))
        scale(inner, "slopes", tuple(model.slopes), "parameters that move a matrix")
        for name in _MATRICES:
            moved = {p: getattr(slope, name) for p, slope in model.slopes.items() if getattr(slope, name) is not None}
            if moved:
                scale(inner, f"moving_{name}", tuple(moved), f"parameters that move {name}")
                inner.create_dataset(f"d{name}", data=np.stack(list(moved.values())))


def read_linear(file: Any) -> tuple[LinearModel, ...]:
    """The linear models of a file, none of one that was written without them."""
    return tuple(_read(file["linear"][str(i)]) for i in range(len(file["linear"]))) if "linear" in file else ()


def _read(group: Any) -> LinearModel:
    hints = get_type_hints(LinearModel)
    known = {f.name: read_value(group, f.name, hints[f.name]) for f in fields(LinearModel) if f.name != "slopes"}
    moved: dict[str, dict[str, Any]] = {name: {} for name in texts(group, "slopes")}
    for matrix in _MATRICES:
        if f"d{matrix}" in group:
            for name, values in zip(texts(group, f"moving_{matrix}"), group[f"d{matrix}"][()], strict=True):
                moved[name][matrix] = values
    return LinearModel(**known, slopes={name: Slope(**slope) for name, slope in moved.items()})
