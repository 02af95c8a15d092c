"""Spikes of one or two samples, replaced by the median of the other repetitions (Hampel's rule across periods).

    e = x - median over periods,   d = |e - running median of e| > 8 sigma

A sample is a spike only where e is as far from the parabola through its neighbours, six times as far as each of those,
and d six times as large as at its neighbours: drift, transients, steps and bursts of oscillation are no spikes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.statistics import STD_OVER_MAD
from elastid.recorded.repair import Finding, Log, Repaired, expected, runs
from elastid.recorded.repair.converter import step

REPLACED = "spikes replaced"


@dataclass(frozen=True)
class SpikeLimits:
    """Limits that distinguish a spike from a signal; their false-alarm rates are not measured."""

    min_sigmas: float = 8.0
    min_periods: int = 3
    max_share: float = 0.01  # spikes of more than this part of a channel are no single ones
    # Samples: of the running median, of a spike at most, and of its neighbours on each side.
    median_window: int = 11
    max_run: int = 2
    neighbours: int = 6
    min_ratio: float = 6.0  # distance of a spike over that of its neighbours, at least


LIMITS = SpikeLimits()


def despiked(signals: FloatArray, L: int, sign: int, log: Log) -> Repaired:
    """Signals (P L, c), finite, without spikes of one or two samples; unchanged for fewer than three repetitions."""
    if len(signals) // L < LIMITS.min_periods:
        return Repaired(signals)
    finite = np.ones(len(signals), dtype=np.bool_)
    usual = [expected(x, L, sign, finite, robust=True) for x in signals.T]
    return _replaced(signals, usual, "the other periods", "the median of the other periods", log)


def despiked_without_period(signals: FloatArray, log: Log) -> Repaired:
    """Signals (n, c), finite, without spikes of one or two samples, judged by their neighbours alone."""
    usual = [np.zeros(len(x)) for x in signals.T]
    return _replaced(signals, usual, "their neighbours", "the parabola through their neighbours", log)


def _replaced(signals: FloatArray, usual: Sequence[FloatArray], reference: str, value: str, log: Log) -> Repaired:
    result, findings = signals.copy(), []
    for c, name in enumerate(log.names):
        x = signals[:, c]
        spikes, values = _spikes(x, usual[c])
        if spikes.size == 0:
            continue
        if spikes.size > LIMITS.max_share * len(x):
            kind, text = "spikes left", f"differ from {reference}: too many for spikes, left unchanged"
        else:
            result[spikes, c] = values
            kind, text = REPLACED, f"are spikes, the first is {log.time_of(spikes[0])}: replaced by {value}"
        findings.append(Finding(kind, spikes.size, f"{name}: {spikes.size} of {len(x)} samples {text}"))
    return Repaired(result, tuple(findings))


def _spikes(x: FloatArray, expectation: FloatArray) -> tuple[IntArray, FloatArray]:
    """Samples (k,) of the spikes, and their usual values (k,)."""
    from scipy.ndimage import median_filter

    e = x - expectation
    d = np.abs(e - median_filter(e, LIMITS.median_window, mode="mirror"))
    sigma = STD_OVER_MAD * float(np.median(d))
    if sigma == 0:  # most samples agree exactly
        sigma = float(np.sqrt(np.mean(np.sort(d)[: int(0.99 * len(d))] ** 2)))
    least = max(LIMITS.min_sigmas * sigma, 2 * step(x), 1e-9 * np.ptp(x))
    spikes, usual = [np.arange(0)], [x[:0]]
    for first, end in runs(np.asarray(d > least)):
        run = np.arange(first, end)
        # Near an end a spike cannot be distinguished from a bend.
        inside = first > LIMITS.neighbours and end <= len(e) - LIMITS.neighbours
        if inside and len(run) <= LIMITS.max_run and _is_alone(d, run):
            local, scatter = _parabola(e, run)
            if np.abs(e[run] - local).max() > max(least, LIMITS.min_ratio * scatter):
                spikes.append(run)
                usual.append(x[run] - e[run] + local)
    return np.concatenate(spikes), np.concatenate(usual)


def _parabola(e: FloatArray, run: IntArray) -> tuple[FloatArray, float]:
    """The parabola through the neighbours of a run, at the run, and the largest distance of those from it."""
    first, last, n = int(run[0]), int(run[-1]), LIMITS.neighbours
    sides = np.r_[max(0, first - 1 - n) : max(0, first - 1), last + 2 : min(len(e), last + 2 + n)]
    middle = (first + last) / 2
    powers = np.vander((sides - middle) / n, 3)
    coefficients = np.linalg.lstsq(powers, e[sides], rcond=None)[0]
    scatter = float(np.abs(e[sides] - powers @ coefficients).max())
    return np.asarray(np.vander((run - middle) / n, 3) @ coefficients), scatter


def _is_alone(d: FloatArray, run: IntArray) -> bool:
    first, last, n = int(run[0]), int(run[-1]), 2 * LIMITS.neighbours
    sides = np.concatenate([d[max(0, first - n) : first - 1], d[last + 2 : last + 2 + n]])
    return bool(d[run].max() > LIMITS.min_ratio * sides.max())
