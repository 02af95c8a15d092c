r"""A log whose clock differs from the generator's: its period is no whole number of samples.

Consecutive periods are then shifted by e = T - N samples. Their mean cross-spectrum C tells it,

.. math:: \hat e = \arg\max_e\, \mathrm{Re} \sum_k C_k e^{2 \pi j k e / N}, \quad C_k = \sum_p X_{p+1} X_p^*

and the log is resampled at multiples of T / N, the generator's clock being the right one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError
from elastid.recorded.repair.finding import Finding, Log, Repaired
from elastid.recorded.repair.repeats import flat
from elastid.recorded.repair.sample_times import at_times

RESAMPLED = "samples resampled"
# Clocks of quartz differ by less; a period that is off by more was stated wrong.
LARGEST = 5e-4
# A shift over the whole record below this, in samples, does no harm.
_SMALLEST = 0.02
# Resampling must leave less than half of what does not repeat.
_CLEARLY = 0.5
# A log may end this part of a period too early; what is beyond is taken from the period before.
_SHORT_BY = 5e-3
_STEP = 0.05
_ROUNDS = 2


@dataclass(frozen=True)
class ClockDrift:
    """T - N in samples, and the power that does not repeat without and with it, as parts of the whole."""

    excess: float
    unexplained: float
    left: float


def clock_drift(drivers: FloatArray, N: int) -> ClockDrift:
    """How much longer than N samples the period of signals (n, c) is, from those that are sent by the generator."""
    P = len(drivers) // N
    X = np.stack([flat(x, N) for x in drivers.T], axis=2)
    size = np.sqrt(np.mean(X**2, axis=(0, 1)))
    Z = np.fft.rfft(X / np.where(size > 0, size, 1.0), axis=1)
    # The first period may hold a transient.
    Z = Z[1:] if P > 3 else Z
    far = max(1, len(Z) // 2)
    C, power = _cross(Z, 1)
    C_far, power_far = _cross(Z, far)
    turns = (2j * np.pi * np.arange(Z.shape[1]) / N).astype(np.complex128)
    grid = np.arange(-LARGEST * N - 1, LARGEST * N + 1 + _STEP, _STEP)
    excess = _refined(C, turns, float(grid[np.argmax([_real(C, turns, e) for e in grid])]))
    excess = _refined(C_far, turns, far * excess) / far
    if _real(C, turns, excess) < _real(C, turns, 0.0):
        # Single jumps, such as lost samples: next to each other most periods agree as they are.
        return ClockDrift(0.0, 1 - _real(C, turns, 0.0) / power, 1 - _real(C, turns, 0.0) / power)
    before, after = (1 - _real(C_far, turns, e) / power_far for e in (0.0, far * excess))
    return ClockDrift(excess, before, after)


def resampled(signals: FloatArray, drivers: FloatArray, N: int, log: Log) -> Repaired:
    """Signals (n, c), finite, at the generator's clock; as they are where it agrees with the log's.

    Raises DataError where fewer than two periods are left.
    """
    P = len(signals) // N
    if P < 2:
        return Repaired(signals)
    drift = clock_drift(drivers, N)
    is_small = abs(drift.excess) <= LARGEST * N
    if abs(drift.excess) * P < _SMALLEST or not is_small or drift.left > _CLEARLY * drift.unexplained:
        return Repaired(signals)
    T = _period(drivers, N, drift)
    whole = int((len(signals) + _SHORT_BY * N) // T)
    if whole < 2:
        raise DataError(
            f"{log.where}: its period is {T:.3f} samples instead of {N}, and fewer than two of them are there; "
            "measure more periods"
        )
    result = at_times(signals, np.arange(whole * N, dtype=np.float64) * (T / N), T)
    word = (
        f"the period is {T:.4f} samples instead of {N}: the clocks of generator and log differ by "
        f"{1e6 * (T / N - 1):.1f} ppm; resampled, {100 * drift.left / drift.unexplained:.2g} % of what did not "
        "repeat is left"
    )
    return Repaired(result, (Finding(RESAMPLED, len(result), word),))


def _period(drivers: FloatArray, N: int, drift: ClockDrift) -> float:
    """T in samples; what resampling leaves of the drift, which leakage biased, is added."""
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


def _real(C: ComplexArray, turns: ComplexArray, e: float) -> float:
    return float(np.sum((C * np.exp(turns * e)).real))


def _refined(C: ComplexArray, turns: ComplexArray, e: float) -> float:
    """Newton's method on the derivative, where it is a maximum."""
    for _ in range(5):
        phasor = C * np.exp(turns * e)
        slope, bend = float(np.sum((turns * phasor).real)), float(np.sum((turns**2 * phasor).real))
        if bend >= 0:
            return e
        e -= float(np.clip(slope / bend, -0.5, 0.5))
    return e
