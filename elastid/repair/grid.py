"""Samples with their times -> samples at a steady rate, where what lies in a gap is missing (NaN)."""

from __future__ import annotations

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import DataError
from elastid.repair.finding import Finding, Log, Repaired

GAPS = "samples missing in time"
# Times may jitter by this part of a sample.
_JITTER = 0.3


def on_grid(time_s: FloatArray, signals: FloatArray, rate_hz: float, log: Log) -> Repaired:
    """Signals (n, c) with a row of NaN for each sample that the times (n,) leave out.

    Only the step from one sample to the next counts: a clock that is slightly off is no gap.  Raises DataError where
    times do not increase or lie between samples.
    """
    if not np.isfinite(time_s).all():
        raise DataError(f"{log.where}: a time is missing at {log.at(np.flatnonzero(~np.isfinite(time_s))[0])}")
    steps = np.diff(time_s) * rate_hz
    whole = np.round(steps).astype(np.int64)
    bad = np.flatnonzero((whole < 1) | (np.abs(steps - whole) > _JITTER))
    if bad.size:
        raise DataError(
            f"{log.where}: {bad.size} of {len(steps)} steps in time are no whole samples at {rate_hz:g} Hz, the first "
            f"after {log.at(bad[0])} of {steps[bad[0]] / rate_hz:.6g} s (median {np.median(np.diff(time_s)):.6g} s); "
            "correct rate_hz, or resample the log evenly"
        )
    row = np.concatenate([[0], np.cumsum(whole)])
    lost = int(row[-1]) + 1 - len(signals)
    if lost == 0:
        return Repaired(signals)
    result = np.full((int(row[-1]) + 1, signals.shape[1]), np.nan)
    result[row] = signals
    gaps = np.flatnonzero(whole > 1)
    word = f"{lost} samples are missing in {gaps.size} gaps of its times, the first after {log.at(gaps[0])}"
    return Repaired(result, (Finding(GAPS, lost, word),))
