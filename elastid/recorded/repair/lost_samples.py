"""Samples that a logger lost or doubled: from there on every period is shifted by whole samples.

The place is where the sum of squares, with the old shift before and the new one after, is smallest. Lost samples
become missing ones (NaN rows), doubled ones are taken out, so that all periods are in step again.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.recorded.repair import Finding, Log, Repaired
from elastid.recorded.repair.repeats import flat

DROPPED = "lost samples put back"
DOUBLED = "doubled samples taken out"
_MIN_PERIODS = 4
# Larger shifts, as a part of the period, have other causes.
_MAX_SHIFT = 0.02
# A shift must leave at most this part of the power that does not repeat.
_MAX_REMAINING_SHARE = 0.5


def realigned(signals: FloatArray, drivers: FloatArray, N: int, log: Log) -> Repaired:
    """Signals (n, c) with all periods in step, from the shifts of drivers (n, d), finite signals of the generator.

    Unchanged where there are fewer than four periods, no shift, or one at most periods (a wrong period).
    """
    P = len(drivers) // N
    if P < _MIN_PERIODS:
        return Repaired(signals)
    X = np.stack([flat(x, N) for x in drivers.T], axis=2)
    size = np.sqrt(np.mean(X**2, axis=(0, 1)))
    X = X / np.where(size > 0, size, 1.0)
    if 2 * np.count_nonzero(_best_lags(_cross(X[1:], X[:-1]))) >= P - 1:
        return Repaired(signals)
    reference = _reference(X)
    lags = _lags(X, reference)
    jumps = np.flatnonzero(np.diff(lags)) + 1
    if jumps.size == 0:
        return Repaired(signals)
    result, findings, moved = signals, [], 0
    for p in jumps:
        old, new = int(lags[p - 1]), int(lags[p])
        place = (p - 1) * N + _split(X[p - 1 : p + 1].reshape(2 * N, -1), reference, old, new)
        row, change = place + moved, new - old
        if change < 0:
            gap = np.full((-change, signals.shape[1]), np.nan)
            result = np.concatenate([result[:row], gap, result[row:]])
        else:
            result = np.concatenate([result[:row], result[row + change :]])
        findings.append(_finding(change, log.at(place)))
        moved -= change
    return Repaired(result, tuple(findings))


def _finding(change: int, at: str) -> Finding:
    if change < 0:
        return Finding(DROPPED, -change, f"{-change} samples are lost near {at}: put back as missing ones")
    return Finding(DOUBLED, change, f"{change} samples are there twice near {at}: taken out")


def _reference(X: FloatArray) -> FloatArray:
    """The mean (N, d) of the two consecutive periods that agree best, later ones first where all do."""
    apart = np.sum((X[1:] - X[:-1]) ** 2, axis=(1, 2))
    best = len(apart) - 1 - int(np.argmin(apart[::-1]))
    return np.asarray((X[best] + X[best + 1]) / 2)


def _cross(X: FloatArray, reference: FloatArray) -> FloatArray:
    """Circular cross-correlation (P, N) of periods (P, N, d) with one (N, d) or with one for each."""
    F = np.fft.rfft(X, axis=1) * np.fft.rfft(reference, axis=-2).conj()
    return np.fft.irfft(F.sum(axis=2), X.shape[1], axis=1)


def _best_lags(together: FloatArray) -> IntArray:
    """The lag (P,), within 2 % of the period, of the highest correlation."""
    reach = max(2, int(_MAX_SHIFT * together.shape[1]))
    offsets = np.arange(-reach, reach + 1)
    return np.asarray(offsets[np.argmax(together[:, offsets], axis=1)])


def _lags(X: FloatArray, reference: FloatArray) -> IntArray:
    """Shift (P,) of each period, X_p(t) = reference(t - lag); the most frequent one where another explains little."""
    together = _cross(X, reference)
    best = _best_lags(together)
    values, counts = np.unique(best, return_counts=True)
    usual = int(values[np.argmax(counts)])
    power = np.sum(X**2, axis=(1, 2)) + np.sum(reference**2)
    left, unexplained = (power - 2 * together[np.arange(len(X)), lag] for lag in (best, usual))
    return np.where(left < _MAX_REMAINING_SHARE * unexplained, best, usual)


def _split(x: FloatArray, reference: FloatArray, old: int, new: int) -> int:
    """Sample of two periods (2 N, d) at which the shift changes."""
    twice = np.tile(reference, (2, 1))
    before, after = (np.sum((x - np.roll(twice, lag, axis=0)) ** 2, axis=1) for lag in (old, new))
    return int(np.argmin(np.concatenate([[0.0], np.cumsum(before - after)])))
