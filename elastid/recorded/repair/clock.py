r"""A log whose clock differs from the generator's: its period is no whole number of samples.

Consecutive periods are then shifted by e = T - N samples, which their mean cross-spectrum C shows,

.. math:: \hat e = \arg\max_e\, \mathrm{Re} \sum_k C_k e^{2 \pi j k e / N}, \quad C_k = \sum_p X_{p+1} X_p^*

and the log is resampled at multiples of T / N: the generator's clock is taken as right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError
from elastid.recorded.repair.delay import correlation, refined_shift
from elastid.recorded.repair.finding import Finding, Log, Repaired
from elastid.recorded.repair.repeats import flat
from elastid.recorded.repair.sample_times import at_times

RESAMPLED = "samples resampled"
# Quartz clocks differ by less; a period that is off by more is stated wrong.
MAX_CLOCK_ERROR = 5e-4
# A smaller shift over the whole record, in samples, does no harm.
_MIN_SHIFT = 0.02
# Resampling must leave at most this part of the power that does not repeat.
_MAX_REMAINING_SHARE = 0.5
# A log may end this part of a period too early; the rest is taken from the period before.
_MAX_MISSING_END = 5e-3
# Spacing of the shifts, in samples, among which the largest correlation is searched for.
_SEARCH_STEP = 0.05
_ROUNDS = 2


@dataclass(frozen=True)
class ClockDrift:
    """T - N in samples, and the parts of the power that do not repeat without and with the shift."""

    excess: float
    unexplained: float
    left: float


def clock_drift(drivers: FloatArray, N: int) -> ClockDrift:
    """Excess of the period over N samples, from signals (n, c) that the generator sends."""
    P = len(drivers) // N
    X = np.stack([flat(x, N) for x in drivers.T], axis=2)
    size = np.sqrt(np.mean(X**2, axis=(0, 1)))
    Z = np.fft.rfft(X / np.where(size > 0, size, 1.0), axis=1)
    # The first period may hold a transient.
    Z = Z[1:] if P > 3 else Z
    far = max(1, len(Z) // 2)
    C, power = _cross(Z, 1)
    C_far, power_far = _cross(Z, far)
    limit = MAX_CLOCK_ERROR * N + 1
    grid = np.arange(-limit, limit + _SEARCH_STEP, _SEARCH_STEP)
    excess = refined_shift(C, N, float(grid[np.argmax([correlation(C, N, e) for e in grid])]))
    excess = refined_shift(C_far, N, far * excess) / far
    unshifted = correlation(C, N, 0.0)
    if correlation(C, N, excess) < unshifted:
        # Single jumps, such as lost samples: next to each other most periods agree as they are.
        return ClockDrift(0.0, 1 - unshifted / power, 1 - unshifted / power)
    before, after = (1 - correlation(C_far, N, e) / power_far for e in (0.0, far * excess))
    return ClockDrift(excess, before, after)


def resampled(signals: FloatArray, drivers: FloatArray, N: int, log: Log) -> Repaired:
    """Signals (n, c), finite, at the generator's clock; unchanged where it agrees with the log's.

    Raises DataError where fewer than two periods are left.
    """
    P = len(signals) // N
    if P < 2:
        return Repaired(signals)
    drift = clock_drift(drivers, N)
    is_small = abs(drift.excess) <= MAX_CLOCK_ERROR * N
    if abs(drift.excess) * P < _MIN_SHIFT or not is_small or drift.left > _MAX_REMAINING_SHARE * drift.unexplained:
        return Repaired(signals)
    T = _period(drivers, N, drift)
    whole = int((len(signals) + _MAX_MISSING_END * N) // T)
    if whole < 2:
        raise DataError(
            f"{log.where}: its period is {T:.3f} samples instead of {N}, and the log holds fewer than two of them; "
            "measure more periods"
        )
    result = at_times(signals, np.arange(whole * N, dtype=np.float64) * (T / N), T)
    text = (
        f"the period is {T:.4f} samples instead of {N}: the clocks of generator and log differ by "
        f"{1e6 * (T / N - 1):.1f} ppm; resampled, {100 * drift.left / drift.unexplained:.2g} % of the power that "
        "did not repeat remains"
    )
    return Repaired(result, (Finding(RESAMPLED, len(result), text),))


def _period(drivers: FloatArray, N: int, drift: ClockDrift) -> float:
    """T in samples, corrected by the drift that is left after resampling: leakage biases the first estimate."""
    T = N + drift.excess
    for _ in range(_ROUNDS):
        times = np.arange(int(len(drivers) / max(T, N)) * N, dtype=np.float64) * (T / N)
        T *= 1 + clock_drift(at_times(drivers, times, T), N).excess / N
    return T


def _cross(Z: ComplexArray, lag: int) -> tuple[ComplexArray, float]:
    """C (F,) of spectra Z (P, F, c), summed over periods and channels, and the power that it cannot exceed."""
    a, b = Z[:-lag], Z[lag:]
    C: ComplexArray = np.sum(b * a.conj(), axis=(0, 2))
    return C, float(np.sqrt(np.sum(np.abs(a) ** 2) * np.sum(np.abs(b) ** 2)))
