"""Grids: the DFT lines that a multisine excites. Line k of a period of N samples is the frequency k * rate / N.

Even nonlinearities of an odd multisine fall on even lines, odd ones on the odd lines left out for their detection:
out of every few consecutive odd lines one at random. (Pintelon and Schoukens, System Identification: A Frequency Domain
Approach, 2nd ed., chapter 4.)
"""

import math
from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, IntArray, frozen_value
from elastid.base.errors import StudyError

Orthogonal: TypeAlias = Literal["dft", "hadamard", "zippered"]
Grid: TypeAlias = Literal["full", "odd", "odd-odd", "odd-random", "quasi-log", "odd-quasi-log", "lines"]

# Lines from one line of a grid to the next; the first is 1 modulo this.
_STEP = {"full": 1, "odd": 2, "odd-odd": 4, "odd-random": 2, "quasi-log": 1, "odd-quasi-log": 2, "lines": 1}
_MULTIPLES = {1: "multiples of", 2: "odd multiples of", 4: "1, 5, 9 ... times"}


@frozen_value
class Lines:
    """excited (F,): lines with an amplitude.  detection: lines in the band left free, on which distortion shows."""

    excited: IntArray
    detection: IntArray


def line_frequencies(lines: IntArray, rate_hz: float, period_samples: int) -> FloatArray:
    """Return frequencies (F,) in Hz of DFT lines (F,)."""
    return (lines * (rate_hz / period_samples)).astype(np.float64)


def grid_lines(
    grid: Grid, band_hz: tuple[float, float], rate_hz: float, period_samples: int, ratio: float = 1.05
) -> IntArray:
    """Return lines k (F,) with band_hz[0] <= k rate_hz / N <= band_hz[1] and 0 < k < N / 2, including detection lines.

    N = period_samples.  odd: odd k only, wherever the band begins; odd-odd: k = 1, 5, 9 ...; quasi-log: each line at
    about `ratio` times the last.  Raises StudyError where the band holds no line.

    >>> grid_lines("odd", (2.0, 7.0), 100.0, 100).tolist()
    [3, 5, 7]
    >>> grid_lines("odd-quasi-log", (1.0, 30.0), 100.0, 100, ratio=1.5).tolist()
    [1, 3, 5, 7, 11, 17, 25]
    """
    step = _STEP[grid]
    spacing = rate_hz / period_samples
    # A band edge meant to lie on a line does so in spite of rounding.
    first = max(1, math.ceil(band_hz[0] / spacing - 1e-6))
    lines = np.arange(first, min((period_samples - 1) // 2, math.floor(band_hz[1] / spacing + 1e-6)) + 1)
    lines = lines[lines % step == 1 % step]
    if lines.size == 0:
        raise StudyError(
            "excitation/lines",
            f"band_hz [{band_hz[0]:g}, {band_hz[1]:g}] holds no line: the lines are {_MULTIPLES[step]} "
            f"{spacing:g} Hz below {rate_hz / 2:g} Hz; widen band_hz or take a longer period",
        )
    return (_quasi_logarithmic(lines, ratio) if grid.endswith("quasi-log") else lines).astype(np.int64)


def user_lines(lines: Sequence[int], band_hz: tuple[float, float], rate_hz: float, period_samples: int) -> IntArray:
    """Return the user's own lines (F,) in ascending order; StudyError where one is outside the band or given twice."""
    band = grid_lines("full", band_hz, rate_hz, period_samples)
    outside = [k for k in lines if k not in band]
    if outside or len(set(lines)) < len(lines):
        fault = f"line {outside[0]} is outside band_hz" if outside else "a line is given twice"
        raise StudyError(
            "excitation/lines",
            f"{fault}; band_hz [{band_hz[0]:g}, {band_hz[1]:g}] and a period of "
            f"{period_samples / rate_hz:g} s allow lines {band[0]} to {band[-1]}, each once",
            "excitation.lines",
        )
    return np.array(sorted(lines), dtype=np.int64)


def with_detection(lines: IntArray, group: int, rng: np.random.Generator) -> Lines:
    """Omit one random line of every `group` consecutive lines (F,); an incomplete last group stays complete."""
    groups = len(lines) // group
    left_out = np.arange(groups) * group + rng.integers(0, group, groups)
    return Lines(np.delete(lines, left_out), lines[left_out])


def line_count_refusal(n_lines: int, n_groups: int, noun: str) -> str:
    """Return why a grid has too few lines for as many motors or unknowns; empty where it has enough.

    >>> line_count_refusal(4, 6, "motors")
    '4 lines for 6 motors; take a period at least 1.5 times as long, a wider band_hz or a fuller grid'
    """
    if n_lines >= n_groups:
        return ""
    longer = math.ceil(10 * n_groups / max(1, n_lines)) / 10
    return (
        f"{n_lines} lines for {n_groups} {noun}; take a period at least {longer:g} times as long, a wider band_hz or a "
        "fuller grid"
    )


def zippered_grid(n_lines: int, n_u: int) -> IntArray:
    """Return the input (n_lines,) of each line, interleaved; StudyError for fewer lines than inputs.

    >>> zippered_grid(5, 2).tolist()
    [0, 1, 0, 1, 0]
    """
    if refusal := line_count_refusal(n_lines, n_u, "motors"):
        raise StudyError(
            "excitation/lines",
            f"zippered gives every motor lines of its own, and there are {refusal}",
            "excitation.orthogonal",
        )
    return np.arange(n_lines) % n_u


def _quasi_logarithmic(lines: IntArray, ratio: float) -> IntArray:
    """Return lines each of which is the nearest to `ratio` times the last, and at least the next one."""
    half_step = (lines[1] - lines[0]) / 2 if len(lines) > 1 else 0.5
    indices = [0]
    while True:
        target = lines[indices[-1]] * ratio
        following = max(int(np.argmin(np.abs(lines - target))), indices[-1] + 1)
        if following >= len(lines) or target > lines[-1] + half_step:
            return lines[indices]
        indices.append(following)
