"""Torques at standstill that tell friction before it slides: loops that grow, and a small multisine of a given peak."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.excitation.grids import grid_lines
from elastid.excitation.multisine import synthesise
from elastid.excitation.phases import random_phases


def growing_loops(smallest: float, largest: float, count: int, frequency_hz: float, rate_hz: float) -> FloatArray:
    """One cycle of a sine for each of `count` amplitudes, spaced logarithmically, the smallest first (n,).

    >>> np.abs(growing_loops(1.0, 4.0, 3, 1.0, 8.0)).reshape(3, 8).max(axis=1).round(6).tolist()
    [1.0, 2.0, 4.0]
    """
    samples = round(rate_hz / frequency_hz)
    cycle = np.sin(2 * np.pi * np.arange(samples) / samples)
    return np.outer(np.geomspace(smallest, largest, count), cycle).ravel()


def small_multisine(
    peak: float, band_hz: tuple[float, float], period_samples: int, rate_hz: float, rng: np.random.Generator
) -> FloatArray:
    """One period (n,) of an odd random-phase multisine of equal lines whose largest value is `peak`."""
    lines = grid_lines("odd", band_hz, rate_hz, period_samples)
    signal = synthesise(lines, np.exp(1j * random_phases((len(lines), 1), rng)), period_samples)[:, 0]
    return np.asarray(peak / np.abs(signal).max() * signal)
