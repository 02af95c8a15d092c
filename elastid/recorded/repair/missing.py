"""Missing samples (NaN): filled from the same phase of other repetitions, or interpolated without a period."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.recorded.repair import Finding, Log, Repaired
from elastid.recorded.repair.repeats import expected

FILLED = "missing samples filled"
# A repetition that lacks more than this part of a channel is filled but does not count as a measurement.
_MAX_MISSING_OF_REPETITION = 0.1
# A channel that lacks more than this part is refused.
_MAX_MISSING_SHARE = 1 / 3
# Good samples on either side of a gap that give the distance of the signal from the other repetitions.
_SAMPLES_BESIDE = 8


def filled(signals: FloatArray, L: int, sign: int, log: Log) -> Repaired:
    """Signals (n, c) without NaN in their whole repetitions, which are all that is returned.

    Raises DataError where more than a third of a channel is missing, a phase is missing in all repetitions, or fewer
    than two repetitions are left.
    """
    P = len(signals) // L
    whole = signals[: P * L]
    good = np.isfinite(whole)
    if good.all():
        return Repaired(whole)
    result, findings = whole.copy(), []
    for c in np.flatnonzero(~good.all(axis=0)):
        _check(good[:, c], P, L, log, int(c))
        result[:, c] = _filled(whole[:, c], good[:, c], L, sign)
        findings.append(Finding(FILLED, int(np.sum(~good[:, c])), _text(good[:, c], log, int(c))))
    lacking = (~good).reshape(P, L, -1).mean(axis=1).max(axis=1)
    left_out = np.flatnonzero(lacking > _MAX_MISSING_OF_REPETITION)
    if P - len(left_out) < 2:
        raise DataError(
            f"{log.where}: {len(left_out)} of {P} repetitions lack more than {_MAX_MISSING_OF_REPETITION:.0%} of their "
            "samples, and two are needed; measure again, or cut the bad part off with samples"
        )
    if left_out.size:
        findings.append(_left_out(left_out, P))
    return Repaired(result, tuple(findings), tuple(int(p) for p in left_out))


def _filled(x: FloatArray, good: BoolArray, L: int, sign: int) -> FloatArray:
    """The common shape, moved so that it joins the good samples on both sides of a gap."""
    shape = expected(x, L, sign, good, robust=False)
    away = np.where(good, x - shape, 0.0)
    known = np.flatnonzero(good)
    edges = np.diff(np.concatenate([[0], (~good).astype(int), [0]]))
    result = np.where(good, x, shape)
    for start, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        i = int(np.searchsorted(known, start))
        before, after = known[max(0, i - _SAMPLES_BESIDE) : i], known[i : i + _SAMPLES_BESIDE]
        sides = [side for side in (before, after) if side.size]
        places, offsets = ([float(values[side].mean()) for side in sides] for values in (np.arange(len(x)), away))
        result[start:end] += np.interp(np.arange(start, end), places, offsets)
    return result


def _check(good: BoolArray, P: int, L: int, log: Log, c: int) -> None:
    missing = np.flatnonzero(~good)
    what = f"{log.where}: {log.names[c]}: {missing.size} of {len(good)} samples are missing (NaN or infinite)"
    if missing.size > _MAX_MISSING_SHARE * len(good):
        raise DataError(f"{what}, the first is {log.at(missing[0])}; measure again, or cut them off with samples")
    lost = np.flatnonzero(~good.reshape(P, L).any(axis=0))
    if lost.size:
        raise DataError(
            f"{what}, and {lost.size} of them in every period at the same place, the first {log.at(lost[0])}: no other "
            "period has that phase; measure again, or cut them off with samples"
        )


def _text(good: BoolArray, log: Log, c: int) -> str:
    missing = np.flatnonzero(~good)
    return (
        f"{log.names[c]}: {missing.size} of {len(good)} samples are missing (NaN or infinite), the first is "
        f"{log.at(missing[0])}: filled from the same phase of the other periods"
    )


def _left_out(left_out: IntArray, P: int) -> Finding:
    numbers = ", ".join(str(p + 1) for p in left_out)
    limit = f"{_MAX_MISSING_OF_REPETITION:.0%}"
    text = f"repetitions {numbers} of {P} lack more than {limit} of their samples and are left out"
    return Finding("repetitions left out", len(left_out), text)


INTERPOLATED = "missing samples interpolated"
# Samples of a gap at most, and the part of a channel that may be missing.
_MAX_GAP = 2
_MAX_INTERPOLATED_SHARE = 0.01
# Samples on each side of a gap that its cubic goes through.
_INTERPOLATION_SAMPLES = 2


def bridged_gaps(signals: FloatArray, log: Log) -> Repaired:
    """Signals (n, c) without NaN; DataError for long gaps, or too many, with the piece of the log that is complete."""
    result, findings = signals.copy(), []
    for c in range(signals.shape[1]):
        good = np.isfinite(signals[:, c])
        missing = np.flatnonzero(~good)
        if missing.size == 0:
            continue
        what = f"{log.names[c]}: {missing.size} of {len(good)} samples are missing (NaN or infinite), the first is "
        what += log.at(missing[0])
        runs = np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1)
        is_inside = missing[0] >= _INTERPOLATION_SAMPLES and missing[-1] < len(good) - _INTERPOLATION_SAMPLES
        is_short = max(map(len, runs)) <= _MAX_GAP and missing.size <= _MAX_INTERPOLATED_SHARE * len(good)
        if not (is_inside and is_short):
            first, last = _longest_piece(np.asarray(np.isfinite(signals).all(axis=1)))
            raise DataError(
                f"{log.where}: {what}, and a record without a period has no other one to fill them from; the longest "
                f"piece without gaps is samples: [{log.first + first}, {log.first + last}]: use that, or measure again"
            )
        for run in runs:
            beside = np.flatnonzero(good[: run[0]])[-_INTERPOLATION_SAMPLES:].tolist()
            beside += (run[-1] + 1 + np.flatnonzero(good[run[-1] + 1 :])[:_INTERPOLATION_SAMPLES]).tolist()
            cubic = np.polynomial.Polynomial.fit(beside, signals[beside, c], 3)
            result[run, c] = cubic(run)
        findings.append(
            Finding(INTERPOLATED, int(missing.size), f"{what}: interpolated between the samples beside them")
        )
    return Repaired(result, tuple(findings))


def _longest_piece(good: BoolArray) -> tuple[int, int]:
    edges = np.diff(np.concatenate([[0], good.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if starts.size == 0:
        return 0, 0
    best = int(np.argmax(ends - starts))
    return int(starts[best]), int(ends[best])
