"""An array in a few numbers: its first value, its range, and how many values are missing; read in pieces."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Up to so many values of an array are shown, one by one.
_MAX_SHOWN = 40
# Longer texts are cut.
_MAX_TEXT = 100


@dataclass(frozen=True)
class ValueRange:
    """first: NaN where it is missing.  low, high: of the values that are finite, NaN without any.  missing: others."""

    first: float
    low: float
    high: float
    missing: int


def value_range(blocks: Iterable[NDArray[Any]]) -> ValueRange:
    """Of numbers in pieces, real or (their magnitude) complex.

    >>> value_range([np.array([2.0, 1.0]), np.array([np.nan, 5.0])])
    ValueRange(first=2.0, low=1.0, high=5.0, missing=1)
    """
    firsts: list[float] = []
    lows, highs, missing = [np.nan], [np.nan], 0
    for block in blocks:
        values = np.abs(block) if block.dtype.kind == "c" else block
        if not values.size:
            continue
        firsts.append(float(values.flat[0]))
        good = values if values.dtype.kind in "iub" else values[np.isfinite(values)]
        missing += values.size - good.size
        if good.size:
            lows.append(float(good.min()))
            highs.append(float(good.max()))
    return ValueRange(
        firsts[0] if firsts else np.nan, float(np.fmin.reduce(lows)), float(np.fmax.reduce(highs)), missing
    )


def shown_values(values: NDArray[Any]) -> str:
    """An array in a line: all values where they are few, else their range.

    >>> shown_values(np.array([0, 1, 2]))
    '0, 1, 2'
    >>> shown_values(np.linspace(0, 1j, 100))
    'magnitude 0 to 1'
    """
    if values.dtype.kind not in "fiubc":
        if not any(str(value) for value in values.ravel()):
            return "empty texts"
        texts = [_shortened(str(value)) for value in values.ravel()[:_MAX_SHOWN]]
        return ", ".join(texts) + (f" and {values.size - _MAX_SHOWN} more" if values.size > _MAX_SHOWN else "")
    if values.size == 1 or (values.ndim < 2 and values.size <= _MAX_SHOWN):
        return ", ".join(str(v) if values.dtype.kind == "b" else f"{v:.6g}" for v in values.ravel())
    return shown_range(value_range([values]), values.dtype.kind == "c")


def shown_range(of: ValueRange, is_complex: bool = False) -> str:
    """A range in words."""
    if np.isnan(of.low):
        return "no finite number"
    missing = f", {of.missing} not finite" if of.missing else ""
    return f"{'magnitude ' if is_complex else ''}{of.low:.6g} to {of.high:.6g}{missing}"


def _shortened(text: str) -> str:
    return text if len(text) <= _MAX_TEXT else f"{text[:_MAX_TEXT]} ..."
