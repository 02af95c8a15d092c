"""Spikes of one or two samples, replaced by the median of the other repetitions (Hampel's rule across periods).

    e = x - median over the other periods,   d = |e - running median of e| > 8 sigma

A sample is a spike only where e is as far from the parabola through its neighbours, six times as far as each of those,
and d six times as large as at its neighbours and three times as at all but 2 % of the samples of most parts of the log:
drift, transients, steps and bursts of oscillation are no spikes, nor is what recurs, as the pulse of a controller at an
encoder's count.  With its own period in the median e would be 0 at a third of the samples of three periods, a lone
other one then a spike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.statistics import STD_OVER_MAD
from elastid.recorded.repair import Finding, Log, Repaired, blocks, expected, runs
from elastid.recorded.repair.converter import step

REPLACED = "spikes replaced"


@dataclass(frozen=True)
class SpikeLimits:
    """Limits that distinguish a spike from a signal."""

    min_sigmas: float = 8.0
    min_periods: int = 3
    # Spikes of more than this part of a channel are no single ones.
    max_share: float = 0.01
    # Samples: of the running median, of a spike at most, and of its neighbours on each side.
    median_window: int = 11
    max_run: int = 2
    neighbours: int = 6
    # Distance of a spike over that of its neighbours, at least.
    min_ratio: float = 6.0
    # And over the distance of this share of the samples, in the median of parts of the log.
    usual_share: float = 0.98
    parts: int = 20
    min_over_usual: float = 3.0


LIMITS = SpikeLimits()


def despiked(signals: FloatArray, L: int, sign: int, log: Log) -> Repaired:
    """Signals (P L, c), finite, without spikes of one or two samples; unchanged for fewer than three repetitions."""
    if len(signals) // L < LIMITS.min_periods:
        return Repaired(signals)
    apart = [_from_others(x, L, sign) for x in signals.T]
    return _replaced(signals, apart, L, "the other periods", "the median of the other periods", log)


def despiked_without_period(signals: FloatArray, log: Log) -> Repaired:
    """Signals (n, c), finite, without spikes of one or two samples, judged by their neighbours alone."""
    value = "the parabola through their neighbours"
    return _replaced(signals, list(signals.T), len(signals), "their neighbours", value, log)


def _from_others(x: FloatArray, L: int, sign: int) -> FloatArray:
    """e (n,): each sample less the median of the other repetitions, from their order with this one."""
    E = blocks(x - expected(x, L, sign, np.ones(len(x), dtype=np.bool_), robust=True), L, sign)
    ordered, middle = np.sort(E, axis=0), len(E) // 2
    below, centre = ordered[middle - 1], ordered[middle]
    if len(E) % 2:
        above = ordered[middle + 1]
        E = E - np.where(centre > E, centre + above, np.where(centre < E, below + centre, below + above)) / 2
    else:
        E = E - np.where(centre > E, centre, below)
    return np.asarray((E * float(sign) ** np.arange(len(E))[:, None]).ravel())


def _replaced(
    signals: FloatArray, apart: Sequence[FloatArray], L: int, reference: str, value: str, log: Log
) -> Repaired:
    """Signals (n, c) without the spikes of each channel.  apart: e (n,) of each."""
    result, findings = signals.copy(), []
    for c, name in enumerate(log.names):
        x = signals[:, c]
        spikes, values = _spikes(x, apart[c], L)
        if spikes.size == 0:
            continue
        if spikes.size > LIMITS.max_share * len(x):
            kind, text = "spikes left", f"differ from {reference}: too many for spikes, left unchanged"
        else:
            result[spikes, c] = values
            kind, text = REPLACED, f"are spikes, the first is {log.time_of(spikes[0])}: replaced by {value}"
        findings.append(Finding(kind, spikes.size, f"{name}: {spikes.size} of {len(x)} samples {text}"))
    return Repaired(result, tuple(findings))


def _spikes(x: FloatArray, e: FloatArray, L: int) -> tuple[IntArray, FloatArray]:
    """Samples (k,) of the spikes, and their usual values (k,)."""
    from scipy.ndimage import median_filter

    d = np.abs(e - median_filter(e, LIMITS.median_window, mode="mirror"))
    least = max(_threshold(d), 2 * step(x), 1e-9 * np.ptp(x))
    parts = d[: len(d) // LIMITS.parts * LIMITS.parts].reshape(LIMITS.parts, -1)
    beyond_usual = LIMITS.min_over_usual * float(np.median(np.quantile(parts, LIMITS.usual_share, axis=1)))
    spikes, usual = [np.arange(0)], [x[:0]]
    for first, end in runs(np.asarray(d > least)):
        run = np.arange(first, end)
        # Near an end a spike cannot be distinguished from a bend.
        inside = first > LIMITS.neighbours and end <= len(e) - LIMITS.neighbours
        if inside and len(run) <= LIMITS.max_run and _is_alone(d, run):
            local, scatter = _parabola(e, run)
            distance = np.abs(e[run] - local).max()
            if distance > max(least, LIMITS.min_ratio * scatter) and distance >= _in_others(e, run, L):
                spikes.append(run)
                usual.append(x[run] - e[run] + local)
    found, values = np.concatenate(spikes), np.concatenate(usual)
    if found.size > LIMITS.max_share * len(x):
        return found, values
    is_rare = np.repeat([d[run].max(initial=0.0) > beyond_usual for run in spikes], [len(run) for run in spikes])
    return found[is_rare], values[is_rare]


def _parabola(e: FloatArray, run: IntArray) -> tuple[FloatArray, float]:
    """The parabola through the neighbours of a run, at the run, and the largest distance of those from it."""
    first, last, n = int(run[0]), int(run[-1]), LIMITS.neighbours
    sides = np.r_[max(0, first - 1 - n) : max(0, first - 1), last + 2 : min(len(e), last + 2 + n)]
    middle = (first + last) / 2
    powers = np.vander((sides - middle) / n, 3)
    coefficients = np.linalg.lstsq(powers, e[sides], rcond=None)[0]
    scatter = float(np.abs(e[sides] - powers @ coefficients).max())
    return np.asarray(np.vander((run - middle) / n, 3) @ coefficients), scatter


def _in_others(e: FloatArray, run: IntArray, L: int) -> float:
    """Largest distance from the parabola in the two other periods of three, whose e have half of a spike in one."""
    if len(e) != 3 * L:
        return 0.0
    others = [(run + p * L) % len(e) for p in (1, 2)]
    if any(other[0] <= LIMITS.neighbours or other[-1] >= len(e) - LIMITS.neighbours for other in others):
        return np.inf
    return max(float(np.abs(e[other] - _parabola(e, other)[0]).max()) for other in others)


def _threshold(d: FloatArray) -> float:
    """8 sigma, sigma from the median; where most samples agree exactly, from the smaller 99 %."""
    sigma = STD_OVER_MAD * float(np.median(d))
    if sigma == 0:
        sigma = float(np.sqrt(np.mean(np.sort(d)[: int(0.99 * len(d))] ** 2)))
    return LIMITS.min_sigmas * sigma


def _is_alone(d: FloatArray, run: IntArray) -> bool:
    first, last, n = int(run[0]), int(run[-1]), 2 * LIMITS.neighbours
    sides = np.concatenate([d[max(0, first - n) : first - 1], d[last + 2 : last + 2 + n]])
    return bool(d[run].max() > LIMITS.min_ratio * sides.max())
