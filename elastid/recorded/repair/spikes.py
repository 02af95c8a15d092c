"""Spikes of one or two samples, replaced by the median of the other repetitions (Hampel's rule across periods).

    e = x - median over periods,   d = |e - running median of e| > 8 sigma

A sample is a spike only where e is as far from the parabola through the samples beside it, six times as far as each of
those, and d six times as large as beside it: drift, transients, steps and bursts of oscillation are no spikes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.statistics import STD_OVER_MAD
from elastid.recorded.repair import Finding, Log, Repaired
from elastid.recorded.repair.converter import step
from elastid.recorded.repair.repeats import expected

REPLACED = "spikes replaced"
_MIN_SIGMAS = 8.0
_MIN_PERIODS = 3
# Spikes of more than this part of a channel are no single ones.
_MAX_SHARE = 0.01
# Samples: of the running median, of a spike at most, and beside a spike.
_MEDIAN_WINDOW = 11
_MAX_RUN = 2
_N_BESIDE = 6
# Distance of a spike over that of the samples beside it, at least.
_MIN_RATIO_TO_BESIDE = 6.0


def despiked(signals: FloatArray, L: int, sign: int, log: Log) -> Repaired:
    """Signals (P L, c), finite, without spikes of one or two samples; unchanged for fewer than three repetitions."""
    if len(signals) // L < _MIN_PERIODS:
        return Repaired(signals)
    finite = np.ones(len(signals), dtype=np.bool_)
    usual = [expected(x, L, sign, finite, robust=True) for x in signals.T]
    return _replaced(signals, usual, "the other periods", "the median of the other periods", log)


def despiked_without_period(signals: FloatArray, log: Log) -> Repaired:
    """Signals (n, c), finite, without spikes of one or two samples, judged by the samples beside them alone."""
    usual = [np.zeros(len(x)) for x in signals.T]
    return _replaced(signals, usual, "the samples beside them", "the parabola through the samples beside", log)


def _replaced(signals: FloatArray, usual: Sequence[FloatArray], others: str, value: str, log: Log) -> Repaired:
    """Signals (n, c) without what differs from the usual (n,) of each channel."""
    result, findings = signals.copy(), []
    for c, name in enumerate(log.names):
        x = signals[:, c]
        spikes, values = _spikes(x, usual[c])
        if spikes.size == 0:
            continue
        if spikes.size > _MAX_SHARE * len(x):
            text = f"{name}: {spikes.size} of {len(x)} samples differ from {others}: too many for spikes"
            text += ", left unchanged"
            findings.append(Finding("spikes left", int(spikes.size), text))
            continue
        result[spikes, c] = values
        text = (
            f"{name}: {spikes.size} of {len(x)} samples are spikes, the first is {log.at(spikes[0])}: replaced by "
            f"{value}"
        )
        findings.append(Finding(REPLACED, int(spikes.size), text))
    return Repaired(result, tuple(findings))


def _spikes(x: FloatArray, expectation: FloatArray) -> tuple[IntArray, FloatArray]:
    """Samples (k,) of the spikes, and the usual values (k,) there."""
    from scipy.ndimage import median_filter

    e = x - expectation
    d = np.abs(e - median_filter(e, _MEDIAN_WINDOW, mode="mirror"))
    least = max(_threshold(d), 2 * step(x), 1e-9 * np.ptp(x))
    far = np.flatnonzero(d > least)
    spikes, usual = [far[:0]], [x[:0]]
    for run in np.split(far, np.flatnonzero(np.diff(far) > 1) + 1):
        # Near an end a spike cannot be distinguished from a bend.
        inside = run.size > 0 and run[0] > _N_BESIDE and run[-1] < len(e) - _N_BESIDE
        if inside and len(run) <= _MAX_RUN and _is_alone(d, run):
            local, scatter = _parabola(e, run)
            away = np.abs(e[run] - local).max()
            if away > max(least, _MIN_RATIO_TO_BESIDE * scatter):
                spikes.append(run)
                usual.append(x[run] - e[run] + local)
    return np.concatenate(spikes), np.concatenate(usual)


def _parabola(e: FloatArray, run: IntArray) -> tuple[FloatArray, float]:
    """The parabola through the samples beside a run, at the run, and the largest distance of those from it."""
    first, last = int(run[0]), int(run[-1])
    beside = np.r_[max(0, first - 1 - _N_BESIDE) : max(0, first - 1), last + 2 : min(len(e), last + 2 + _N_BESIDE)]
    middle = (first + last) / 2
    powers = np.vander((beside - middle) / _N_BESIDE, 3)
    coefficients = np.linalg.lstsq(powers, e[beside], rcond=None)[0]
    scatter = float(np.abs(e[beside] - powers @ coefficients).max())
    return np.asarray(np.vander((run - middle) / _N_BESIDE, 3) @ coefficients), scatter


def _threshold(d: FloatArray) -> float:
    """8 sigma, sigma from the median; where most samples agree exactly, from the smaller 99 %."""
    sigma = STD_OVER_MAD * float(np.median(d))
    if sigma == 0:
        sigma = float(np.sqrt(np.mean(np.sort(d)[: int(0.99 * len(d))] ** 2)))
    return _MIN_SIGMAS * sigma


def _is_alone(d: FloatArray, run: IntArray) -> bool:
    first, last = int(run[0]), int(run[-1])
    beside = np.concatenate([d[max(0, first - 2 * _N_BESIDE) : first - 1], d[last + 2 : last + 2 + 2 * _N_BESIDE]])
    return bool(d[run].max() > _MIN_RATIO_TO_BESIDE * beside.max())
