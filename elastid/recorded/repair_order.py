"""The order in which the faults of a log are repaired: each step establishes what the next one relies on.

whole samples in a period -> stops -> clock -> lost samples -> check of the period -> missing samples -> spikes; limits
and steps are reported of the samples as they were logged.  Without a period: missing samples, limits and steps only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.recorded.period import at_whole_samples, grid_samples, with_whole_end
from elastid.recorded.periodicity import MIN_PERIODS, repetition
from elastid.recorded.repair import Finding, Log, Repaired
from elastid.recorded.repair.clock import resampled
from elastid.recorded.repair.converter import find_clipping, find_steps
from elastid.recorded.repair.lost_samples import realigned
from elastid.recorded.repair.missing import bridged_gaps, filled
from elastid.recorded.repair.repeats import find_drift
from elastid.recorded.repair.spikes import despiked
from elastid.recorded.repair.stops import without_stops

# A resampled sample counts as missing where missing ones have this part in it.
_MAX_MISSING_SHARE = 0.02


def repair(
    signals: FloatArray,
    roles: Mapping[str, Sequence[int]],
    period: float,
    half_wave: bool,
    log: Log,
    check: Callable[[FloatArray], None],
) -> Repaired:
    """Signals (n, c), some samples NaN, repaired: whole repetitions of a period, or of half of one where half_wave.

    roles: the columns of r, u and y.  check: refuses drivers (n, d), NaN where missing, that are not periodic.
    Raises DataError for a fault without a repair.
    """
    N, drivers = grid_samples(period, half_wave), np.array(roles["r"] or roles["u"])
    L, sign = (N // 2, -1) if half_wave else (N, 1)
    start = _in_whole_samples(signals, period, N, L)
    going = without_stops(start.signals, roles, L, lambda x: repetition(x, L, sign).is_as_stated, log)
    bridged = _bridged(going.signals)
    clock = _at_the_clock(going.signals, bridged, drivers, N, log)
    in_step = realigned(clock.signals, _bridged(clock.signals)[:, drivers], N, log)
    check(in_step.signals[:, drivers])
    whole = filled(in_step.signals, L, sign, log)
    is_reported = len(start.signals) > len(signals) * N / period or bool(going.findings)
    if np.isfinite(signals).all() and is_reported and not in_step.findings:
        # All that is missing is the end of the second repetition, or repetitions with a stop.
        whole = replace(whole, findings=())
    clean = despiked(whole.signals, L, sign, log)
    as_logged = bridged if clock.findings else clean.signals
    reported = (*find_clipping(as_logged, L, log), *find_steps(as_logged, L, sign, log))
    reported += find_drift(clean.signals, drivers, L, sign, log)
    steps = (start, going, clock, in_step, whole, clean)
    return Repaired(clean.signals, (*(f for step in steps for f in step.findings), *reported), whole.left_out)


def repair_without_period(signals: FloatArray, log: Log) -> Repaired:
    """Signals (n, c), some samples NaN, with single gaps interpolated; DataError where gaps are longer."""
    whole = bridged_gaps(signals, log)
    n = len(signals)
    reported = (*find_clipping(whole.signals, n, log), *find_steps(whole.signals, n, 1, log))
    return Repaired(whole.signals, (*whole.findings, *reported))


def _in_whole_samples(signals: FloatArray, period: float, N: int, L: int) -> Repaired:
    """Signals with N samples in a period, and two whole repetitions of L where the second one lacks its end only."""
    result = at_whole_samples(signals, period, N)
    text = f"a period of {period:.8g} samples is brought to {N}"
    findings = (Finding("periods brought to whole samples", 1, text),) if period != N else ()
    if not MIN_PERIODS * L <= len(result) < 2 * L:
        return Repaired(result, findings)
    ended = with_whole_end(result, L)
    return replace(ended, findings=(*findings, *ended.findings))


def _bridged(signals: FloatArray) -> FloatArray:
    """Straight lines where samples are missing: good enough to compare periods with."""
    result = signals.copy()
    rows = np.arange(len(signals))
    for c in np.flatnonzero(~np.isfinite(signals).all(axis=0)):
        known = np.isfinite(signals[:, c])
        result[:, c] = np.interp(rows, rows[known], signals[known, c])
    return result


def _at_the_clock(signals: FloatArray, bridged: FloatArray, drivers: IntArray, N: int, log: Log) -> Repaired:
    """Resampled to the generator's clock; the places of missing samples are resampled along and stay missing."""
    missing = ~np.isfinite(signals)
    both = resampled(np.concatenate([bridged, missing], axis=1), bridged[:, drivers], N, log)
    if not both.findings:
        return Repaired(signals)
    values, touched = np.split(both.signals, 2, axis=1)
    return replace(both, signals=np.where(np.abs(touched) > _MAX_MISSING_SHARE, np.nan, values))
