"""Grids: which DFT lines a multisine excites. Line k of a period of N samples is the frequency k * rate / N."""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import numpy as np

from elastid.arrays import FloatArray, IntArray
from elastid.errors import StudyError

Grid: TypeAlias = Literal["full", "odd"]

# A band edge meant to lie on a line must find it in spite of rounding; in lines.
_ON_A_LINE = 1e-6


def line_frequencies(lines: IntArray, rate_hz: float, period_samples: int) -> FloatArray:
    """Frequencies (F,) in Hz of DFT lines (F,)."""
    return (lines * (rate_hz / period_samples)).astype(np.float64)


def grid_lines(grid: Grid, band_hz: tuple[float, float], rate_hz: float, period_samples: int) -> IntArray:
    """Lines k (F,) with band_hz[0] <= k rate_hz / N <= band_hz[1], 0 < k < N / 2; `odd`: odd k only.

    N = period_samples. An odd grid is odd wherever the band begins. Raises StudyError where the band holds no line.

    >>> grid_lines("odd", (2.0, 7.0), 100.0, 100).tolist()
    [3, 5, 7]
    """
    spacing = rate_hz / period_samples
    first = max(1, math.ceil(band_hz[0] / spacing - _ON_A_LINE))
    last = min((period_samples - 1) // 2, math.floor(band_hz[1] / spacing + _ON_A_LINE))
    lines = np.arange(first, last + 1)
    if grid == "odd":
        lines = lines[lines % 2 == 1]
    if lines.size == 0:
        kind = "odd multiples" if grid == "odd" else "multiples"
        raise StudyError(
            f"band_hz [{band_hz[0]:g}, {band_hz[1]:g}] holds no line: the lines are {kind} of {spacing:g} Hz "
            f"below {rate_hz / 2:g} Hz; widen band_hz or take a longer period"
        )
    return lines.astype(np.int64)
