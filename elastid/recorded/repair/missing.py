"""Samples that a logger lost (NaN rows are put in) or doubled (taken out), and missing ones (NaN).

From a lost or doubled sample on every period is shifted by whole samples; the place is where the sum of squares, with
the old shift before and the new one after, is smallest.  Missing samples are filled from the same phase of other
repetitions, without a period by the cubic through the samples beside a gap of one or two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.recorded.repair import Finding, Log, Repaired, expected, runs, scaled

DROPPED = "lost samples put back"
DOUBLED = "doubled samples taken out"
FILLED = "missing samples filled"
INTERPOLATED = "missing samples interpolated"
CUT = "logs cut at gaps"
# Good samples on each side of a gap without a period that its cubic goes through.
_CUBIC_SAMPLES = 2


@dataclass(frozen=True)
class MissingLimits:
    """Limits of the search for shifts and of the filling of gaps."""

    min_periods: int = 4  # periods in which shifts are searched for, at least
    max_shift: float = 0.02  # larger shifts, as a part of the period, have other causes
    max_remaining_share: float = 0.5  # a shift must leave at most this part of the power that does not repeat
    # A repetition that lacks more than this part of a channel is filled but does not count as a measurement.
    max_missing_of_repetition: float = 0.1
    max_missing_share: float = 1 / 3  # a channel that lacks more than this part is refused
    # Without a period: samples of a gap at most, and the part of a channel that may be missing.
    max_gap: int = 2
    max_interpolated_share: float = 0.01
    # A channel that leaps to exactly 0 and back, each time so many times as far as the step that 99 % of its samples
    # stay below, has lost samples.
    leap: float = 10.0
    usual_step: float = 0.99


LIMITS = MissingLimits()


def realigned(signals: FloatArray, drivers: FloatArray, N: int, log: Log) -> Repaired:
    """Signals (n, c) with all periods in step, from the shifts of drivers (n, d), finite signals of the generator.

    Unchanged where there are fewer than four periods, no shift, or one at most periods (a wrong period).
    """
    P = len(drivers) // N
    if LIMITS.min_periods > P:
        return Repaired(signals)
    X = scaled(drivers, N)
    if 2 * np.count_nonzero(_best_lags(_cross(X[1:], X[:-1]))) >= P - 1:
        return Repaired(signals)
    # The mean (N, d) of the two consecutive periods that agree best, later ones first where all do.
    apart = np.sum((X[1:] - X[:-1]) ** 2, axis=(1, 2))
    best = len(apart) - 1 - int(np.argmin(apart[::-1]))
    reference = np.asarray((X[best] + X[best + 1]) / 2)
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
            text = f"{-change} samples are lost near {log.time_of(place)}: put back as missing ones"
        else:
            text = f"{change} samples are there twice near {log.time_of(place)}: taken out"
            result = np.concatenate([result[:row], result[row + change :]])
        findings.append(Finding(DROPPED if change < 0 else DOUBLED, abs(change), text))
        moved -= change
    return Repaired(result, tuple(findings))


def without_dropouts(signals: FloatArray, L: int, log: Log) -> Repaired:
    """Signals (n, c) with NaN where a channel drops to 0 for a while, and not so a repetition later or earlier."""
    result, findings = signals, []
    for c, name in enumerate(log.names[: signals.shape[1]]):
        x = signals[:, c]
        zeros = [(int(a), int(b)) for a, b in runs(np.asarray(x == 0)) if a > 0 and b < len(x)]
        if not zeros:
            continue
        least = LIMITS.leap * float(np.nanquantile(np.abs(np.diff(x)), LIMITS.usual_step))
        lost = [np.arange(a, b) for a, b in zeros if _is_dropout(x, a, b, least, L)]
        if lost:
            result = result.copy()
            result[np.concatenate(lost), c] = np.nan
            count = sum(map(len, lost))
            text = (
                f"{name}: {count} samples of 0 are no values, the first is {log.time_of(lost[0][0])}: taken as missing"
            )
            findings.append(Finding("dropouts taken as missing", count, text))
    return Repaired(result, tuple(findings))


def _is_dropout(x: FloatArray, start: int, end: int, least: float, L: int) -> bool:
    """True of zeros in x (n,) from `start` to `end` between two values of one sign beyond `least`."""
    before, after = float(x[start - 1]), float(x[end])
    others = [x[start + shift : end + shift] for shift in (-L, L) if start + shift >= 0 and end + shift <= len(x)]
    return (
        before * after > 0
        and min(abs(before), abs(after)) > least
        and end - start <= LIMITS.max_missing_of_repetition * L
        and all(other.all() for other in others)
    )


def _cross(X: FloatArray, reference: FloatArray) -> FloatArray:
    """Circular cross-correlation (P, N) of periods (P, N, d) with one (N, d) or with one for each."""
    F = np.fft.rfft(X, axis=1) * np.fft.rfft(reference, axis=-2).conj()
    return np.fft.irfft(F.sum(axis=2), X.shape[1], axis=1)


def _best_lags(together: FloatArray) -> IntArray:
    """The lag (P,), within 2 % of the period, of the highest correlation."""
    reach = max(2, int(LIMITS.max_shift * together.shape[1]))
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
    return np.where(left < LIMITS.max_remaining_share * unexplained, best, usual)


def _split(x: FloatArray, reference: FloatArray, old: int, new: int) -> int:
    """Sample of two periods (2 N, d) at which the shift changes."""
    twice = np.tile(reference, (2, 1))
    before, after = (np.sum((x - np.roll(twice, lag, axis=0)) ** 2, axis=1) for lag in (old, new))
    return int(np.argmin(np.concatenate([[0.0], np.cumsum(before - after)])))


def filled(signals: FloatArray, L: int, sign: int, log: Log) -> Repaired:
    """The whole repetitions of signals (n, c) without NaN.

    Raises DataError where more than a third of a channel, or a phase in all, is missing, or fewer than two are left.
    """
    P = len(signals) // L
    periodic = signals[: P * L]
    good = np.isfinite(periodic)
    if good.all():
        return Repaired(periodic)
    result, findings = periodic.copy(), []
    for c in np.flatnonzero(~good.all(axis=0)):
        missing = np.flatnonzero(~good[:, c])
        text = _missing(missing, good, log, int(c))
        _check(good[:, c], P, L, log, text)
        result[:, c] = _filled(periodic[:, c], good[:, c], L, sign)
        text = f"{text}, the first is {log.time_of(missing[0])}: filled from the same phase of the other periods"
        findings.append(Finding(FILLED, missing.size, text))
    lacking = (~good).reshape(P, L, -1).mean(axis=1).max(axis=1)
    left_out = np.flatnonzero(lacking > LIMITS.max_missing_of_repetition)
    limit = f"{LIMITS.max_missing_of_repetition:.0%}"
    if P - len(left_out) < 2:
        raise DataError(
            "records/missing-samples",
            f"{len(left_out)} of {P} repetitions lack more than {limit} of their samples, and two are "
            "needed; measure again, or cut the bad part off with samples",
            log.where,
        )
    if left_out.size:
        numbers = ", ".join(str(p + 1) for p in left_out)
        text = f"repetitions {numbers} of {P} lack more than {limit} of their samples and are left out"
        findings.append(Finding("repetitions left out", len(left_out), text))
    return Repaired(result, tuple(findings), tuple(int(p) for p in left_out))


def _filled(x: FloatArray, good: BoolArray, L: int, sign: int) -> FloatArray:
    """The common shape, moved so that it joins the good samples on both sides of a gap."""
    shape = expected(x, L, sign, good, robust=False)
    away = np.where(good, x - shape, 0.0)
    known = np.flatnonzero(good)
    result = np.where(good, x, shape)
    for start, end in runs(~good):
        i = int(np.searchsorted(known, start))
        # Eight good samples on either side give the distance of the signal from the other repetitions.
        before, after = known[max(0, i - 8) : i], known[i : i + 8]
        sides = [side for side in (before, after) if side.size]
        places, offsets = ([float(values[side].mean()) for side in sides] for values in (np.arange(len(x)), away))
        result[start:end] += np.interp(np.arange(start, end), places, offsets)
    return result


def _check(good: BoolArray, P: int, L: int, log: Log, problem: str) -> None:
    missing, text = np.flatnonzero(~good), f"{log.where}: {problem}"
    if missing.size > LIMITS.max_missing_share * len(good):
        raise DataError(
            "records/missing-samples",
            f"{text}, the first is {log.time_of(missing[0])}; measure again, or cut them off with samples",
        )
    lost = np.flatnonzero(~good.reshape(P, L).any(axis=0))
    if lost.size:
        raise DataError(
            "records/missing-samples",
            f"{text}, and {lost.size} of them in every period at the same place, the first {log.time_of(lost[0])}: no "
            "other period has that phase; measure again, or cut them off with samples",
        )


def _missing(missing: IntArray, good: BoolArray, log: Log, c: int) -> str:
    return f"{log.names[c]}: {missing.size} of {len(good)} samples are missing (NaN or infinite)"


def pieces_between_gaps(signals: FloatArray, least: int) -> IntArray:
    """First row and end (k, 2) of the pieces of signals (n, c) that no gap interrupts which is too long for a cubic.

    least: rows of a piece.
    """
    good = runs(np.asarray(np.isfinite(signals).all(axis=1)), _CUBIC_SAMPLES)
    if len(good) == 0:
        return good
    apart = np.flatnonzero(good[1:, 0] - good[:-1, 1] > LIMITS.max_gap)
    pieces = np.stack([good[np.r_[0, apart + 1], 0], good[np.r_[apart, len(good) - 1], 1]], axis=1)
    return np.asarray(pieces[pieces[:, 1] - pieces[:, 0] >= least])


def bridged_gaps(signals: FloatArray, log: Log) -> Repaired:
    """Signals (n, c) without NaN; DataError for long gaps, or too many, with the piece of the log that is complete."""
    result, findings = signals.copy(), []
    for c in range(signals.shape[1]):
        good = np.isfinite(signals[:, c])
        missing = np.flatnonzero(~good)
        if missing.size == 0:
            continue
        text = f"{_missing(missing, good, log, c)}, the first is {log.time_of(missing[0])}"
        gaps = runs(~good)
        is_inside = missing[0] >= _CUBIC_SAMPLES and missing[-1] < len(good) - _CUBIC_SAMPLES
        is_short = np.ptp(gaps, axis=1).max() <= LIMITS.max_gap
        if not (is_inside and is_short and missing.size <= LIMITS.max_interpolated_share * len(good)):
            pieces = runs(np.asarray(np.isfinite(signals).all(axis=1)))
            first, last = max(pieces, key=np.ptp, default=(0, 0))
            raise DataError(
                "records/missing-samples",
                f"{text}, and a record without a period has no other one to fill them from; the longest "
                f"piece without gaps is samples: [{log.number(first)}, {log.number(last)}]: use that, or measure again",
                log.where,
            )
        for start, end in gaps:
            sides = np.flatnonzero(good[:start])[-_CUBIC_SAMPLES:].tolist()
            sides += (end + np.flatnonzero(good[end:])[:_CUBIC_SAMPLES]).tolist()
            cubic = np.polynomial.Polynomial.fit(sides, signals[sides, c], 3)
            result[start:end, c] = cubic(np.arange(start, end))
        findings.append(Finding(INTERPOLATED, missing.size, f"{text}: interpolated between their neighbours"))
    return Repaired(result, tuple(findings))
