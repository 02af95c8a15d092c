"""Range of the values of an array as numbers and as text."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ValueRange:
    """First value, lowest and highest finite value (NaN without any), and number of values that are not finite."""

    first: float
    low: float
    high: float
    missing: int


def value_range(blocks: Iterable[NDArray[Any]]) -> ValueRange:
    """Compute the range of an array that is given in blocks; magnitudes for complex numbers.

    >>> value_range([np.array([2.0, 1.0]), np.array([np.nan, 5.0])])
    ValueRange(first=2.0, low=1.0, high=5.0, missing=1)
    """
    firsts = []
    lows, highs, missing = [np.nan], [np.nan], 0
    for block in blocks:
        values = np.abs(block) if block.dtype.kind == "c" else block
        if not values.size:
            continue
        firsts.append(float(values.flat[0]))
        finite = values if values.dtype.kind in "iub" else values[np.isfinite(values)]
        missing += values.size - finite.size
        if finite.size:
            lows.append(float(finite.min()))
            highs.append(float(finite.max()))
    return ValueRange(
        firsts[0] if firsts else np.nan, float(np.fmin.reduce(lows)), float(np.fmax.reduce(highs)), missing
    )


def format_values(values: NDArray[Any]) -> str:
    """Format an array in one row: up to 40 values, otherwise their range.

    >>> format_values(np.array([0, 1, 2]))
    '0, 1, 2'
    >>> format_values(np.linspace(0, 1j, 100))
    'magnitude 0 to 1'
    """
    max_values = 40
    if values.dtype.kind not in "fiubc":
        if not any(str(value) for value in values.ravel()):
            return "empty texts"
        texts = [f"{text[:100]} ..." if len(text) > 100 else text for text in map(str, values.ravel()[:max_values])]
        return ", ".join(texts) + (f" and {values.size - max_values} more" if values.size > max_values else "")
    if values.size == 1 or (values.ndim < 2 and values.size <= max_values):
        return ", ".join(str(v) if values.dtype.kind == "b" else f"{v:.6g}" for v in values.ravel())
    return format_range(value_range([values]), values.dtype.kind == "c")


def format_range(values: ValueRange, is_complex: bool = False) -> str:
    """Format the range of finite values, with the number of values that are missing."""
    if np.isnan(values.low):
        return "no finite number"
    missing = f", {values.missing} not finite" if values.missing else ""
    return f"{'magnitude ' if is_complex else ''}{values.low:.6g} to {values.high:.6g}{missing}"
