"""Samples at other times: on an even grid with missing samples (NaN) in its gaps, and interpolated at any times.

Interpolation is by a sinc in a Kaiser window of half width W samples (Kaiser and Schafer, IEEE Trans. ASSP 28, 1980),

    x(t) = sum_n x(n) b sinc(b (t - n)) I_0(beta sqrt(1 - (b (t - n) / W)^2)) / I_0(beta)

with b = 1, or the ratio of the rates where the new one is lower.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.recorded.repair.finding import Finding, Log, Repaired

GAPS = "samples missing in time"
# Times may jitter by this part of a sample.
_MAX_JITTER = 0.3
# Half width W in samples and shape beta of the Kaiser window.
_HALF_WIDTH = 32
_BETA = 9.0
# The kernels of so many times are in memory together.
_TIMES_AT_ONCE = 4096


def on_grid(time_s: FloatArray, signals: FloatArray, rate_hz: float, log: Log) -> Repaired:
    """Signals (n, c) with a row of NaN for each sample that the times (n,) leave out.

    Only the step from one sample to the next counts: a clock that is slightly off makes no gap.
    Raises DataError where times do not increase or lie between samples.
    """
    if not np.isfinite(time_s).all():
        place = log.at(np.flatnonzero(~np.isfinite(time_s))[0])
        raise DataError(f"{log.where}: the time is missing at {place}; cut that part off with samples")
    steps = np.diff(time_s) * rate_hz
    whole = np.round(steps).astype(np.int64)
    bad = np.flatnonzero((whole < 1) | (np.abs(steps - whole) > _MAX_JITTER))
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
    text = f"{lost} samples are missing in {gaps.size} gaps of its times, the first after {log.at(gaps[0])}"
    return Repaired(result, (Finding(GAPS, lost, text),))


def at_times(signals: FloatArray, times: FloatArray, period: float, band: float = 1.0) -> FloatArray:
    """Signals (n, c) at times (m,), in samples; beyond their ends they are continued periodically.

    band: b, below 1 for a lower rate.
    """
    reach = int(np.ceil(_HALF_WIDTH / band))
    before = reach + max(0, int(np.ceil(-times.min())))
    after = reach + 1 + max(0, int(np.ceil(times.max())) - len(signals) + 1)
    padded = _continued(signals, period, before, after)
    result = np.empty((len(times), signals.shape[1]))
    offsets = np.arange(-reach, reach + 1)
    for first in range(0, len(times), _TIMES_AT_ONCE):
        t = times[first : first + _TIMES_AT_ONCE]
        nearest = np.round(t).astype(np.int64)
        apart = band * ((t - nearest)[:, None] - offsets)
        inside = np.clip(1 - (apart / _HALF_WIDTH) ** 2, 0.0, None)
        kernel = band * np.sinc(apart) * np.i0(_BETA * np.sqrt(inside)) / np.i0(_BETA) * (inside > 0)
        # A constant stays a constant.
        kernel /= kernel.sum(axis=1, keepdims=True)
        result[first : first + _TIMES_AT_ONCE] = np.einsum(
            "tk,tkc->tc", kernel, padded[nearest[:, None] + before + offsets]
        )
    return result


def _continued(x: FloatArray, period: float, before: int, after: int) -> FloatArray:
    """Both ends continued periodically, each shifted so that a drift makes no jump."""
    n = len(x)
    # Each end and what lies beyond it, seen one period further inside.
    left = _inside(x, np.arange(-before, 1.0) + period, period)
    right = _inside(x, np.arange(n - 1.0, n + after) - period, period)
    return np.concatenate([left[:-1] + x[0] - left[-1], x, right[1:] + x[-1] - right[0]])


def _inside(x: FloatArray, times: FloatArray, period: float) -> FloatArray:
    """Values at times that are at most one period outside."""
    whole = round(period)
    if period != whole and len(x) > period + 2 * _HALF_WIDTH:
        return at_times(x, times, whole)
    nearest = np.round(times).astype(np.int64)
    return np.asarray(x[np.where(nearest < 0, nearest % whole, np.where(nearest < len(x), nearest, nearest - whole))])
