"""The order in which the faults of a log are repaired: each step establishes what the next one relies on.

clock -> lost samples -> check of the period -> missing samples -> spikes; limits and steps are reported of the samples
as they were logged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.recorded.repair.clipping import find_clipping
from elastid.recorded.repair.clock import resampled
from elastid.recorded.repair.drift import find_drift
from elastid.recorded.repair.finding import Log, Repaired
from elastid.recorded.repair.lost_samples import realigned
from elastid.recorded.repair.missing import filled
from elastid.recorded.repair.quantisation import find_steps
from elastid.recorded.repair.spikes import despiked

# A resampled sample counts as missing where missing ones have this part in it.
_MAX_MISSING_SHARE = 0.02


def repair(
    signals: FloatArray, drivers: IntArray, N: int, half_wave: bool, log: Log, check: Callable[[FloatArray], None]
) -> Repaired:
    """Signals (n, c), some samples NaN, repaired: whole repetitions of N samples, or of half as many where half_wave.

    drivers: the columns that the generator sends.  check: refuses drivers (n, d) that are not periodic.
    Raises DataError for a fault without a repair.
    """
    L, sign = (N // 2, -1) if half_wave else (N, 1)
    bridged = _bridged(signals)
    clock = _at_the_clock(signals, bridged, drivers, N, log)
    in_step = realigned(clock.signals, _bridged(clock.signals)[:, drivers], N, log)
    check(_bridged(in_step.signals)[:, drivers])
    whole = filled(in_step.signals, L, sign, log)
    clean = despiked(whole.signals, L, sign, log)
    as_logged = bridged if clock.findings else clean.signals
    reported = (*find_clipping(as_logged, L, log), *find_steps(as_logged, L, sign, log))
    reported += find_drift(clean.signals, drivers, L, sign, log)
    findings = (*clock.findings, *in_step.findings, *whole.findings, *clean.findings, *reported)
    return Repaired(clean.signals, findings, whole.left_out)


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
