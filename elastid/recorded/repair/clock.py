r"""The clock of a log: one that differs from the generator's, delay between two logs.

Consecutive periods are then shifted by e = T - N samples, which their mean cross-spectrum C shows,

.. math:: \hat e = \arg\max_e\, \mathrm{Re} \sum_k C_k e^{2 \pi j k e / N}, \quad C_k = \sum_p X_{p+1} X_p^*

and the log is resampled at multiples of T / N: the generator's clock is taken as right.

Interpolation is by a sinc in a Kaiser window of half width W samples (Kaiser and Schafer, IEEE Trans. ASSP 28, 1980),

    x(t) = sum_n x(n) b sinc(b (t - n)) I_0(beta sqrt(1 - (b (t - n) / W)^2)) / I_0(beta)

with b = 1, or the ratio of the rates where the new one is lower.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.recorded.repair import Finding, Log, Repaired, blocks, scaled

RESAMPLED = "samples resampled"
# Half width W in samples and shape beta of the Kaiser window; it passes frequencies up to this part of the rate.
HALF_WIDTH, _BETA, PASSBAND = 32, 9.0, 0.45
# The kernels of so many times are in memory together.
_TIMES_AT_ONCE = 4096


@dataclass(frozen=True)
class ClockLimits:
    """Limits of delays, times and clocks."""

    # Correlation at the best delay at least; below, the signals are not the same.
    min_correlation: float = 0.5
    # Quartz clocks differ by less; a period that is off by more is stated wrong.
    max_error: float = 5e-4
    # A smaller shift over the whole record, in samples, does no harm.
    min_shift: float = 0.02
    # Resampling must leave at most this part of the power that does not repeat.
    max_remaining_share: float = 0.5
    # A log may end this part of a period too early; the rest is taken from the period before.
    max_missing_end: float = 5e-3


CLOCK = ClockLimits()


def delay(first: FloatArray, second: FloatArray, N: int | None) -> tuple[float, float]:
    """Delay of the second signal (n,) against the first, in samples from -N/2 to N/2, and their correlation there.

    Of the mean periods, or of the whole signals without a period (N None); the fraction of a sample comes from the
    phase of their cross-spectrum.
    """
    if N is None:
        N = 2 * max(len(first), len(second))
        first, second = (np.concatenate([x - x.mean(), np.zeros(N - len(x))]) for x in (first, second))
    X, Y = (np.fft.rfft(blocks(x, N).mean(axis=0)) for x in (first, second))
    C = Y * X.conj()
    C[0] = 0.0
    rho = np.fft.irfft(C, N)
    size = np.sqrt(np.sum(np.abs(X[1:]) ** 2) * np.sum(np.abs(Y[1:]) ** 2))
    peak = int(np.argmax(rho))
    tau = refined_shift(C, N, float(peak - N if peak > N // 2 else peak))
    return tau, correlation(C, N, tau) / size if size > 0 else 0.0


def correlation(C: ComplexArray, N: int, shift: float) -> float:
    """Re sum_k C_k exp(2 pi j k shift / N) of a cross-spectrum (N // 2 + 1,)."""
    return float(np.sum((C * np.exp(_turns(C, N) * shift)).real))


def refined_shift(C: ComplexArray, N: int, shift: float) -> float:
    """The maximum of the correlation near a shift, by Newton's method; as it is where it is near no maximum."""
    turns = _turns(C, N)
    for _ in range(5):
        phasor = C * np.exp(turns * shift)
        slope, bend = float(np.sum((turns * phasor).real)), float(np.sum((turns**2 * phasor).real))
        if bend >= 0:
            return shift
        shift -= float(np.clip(slope / bend, -0.5, 0.5))
    return shift


def _turns(C: ComplexArray, N: int) -> ComplexArray:
    return (2j * np.pi * np.arange(len(C)) / N).astype(np.complex128)


def at_times(signals: FloatArray, times: FloatArray, period: float, band: float = 1.0) -> FloatArray:
    """Signals (n, c) at times (m,) in samples, periodic beyond their ends; band: b, below 1 for a lower rate."""
    reach = int(np.ceil(HALF_WIDTH / band))
    before = reach + max(0, int(np.ceil(-times.min())))
    after = reach + 1 + max(0, int(np.ceil(times.max())) - len(signals) + 1)
    padded = _continued(signals, period, before, after)
    result = np.empty((len(times), signals.shape[1]))
    offsets = np.arange(-reach, reach + 1)
    for first in range(0, len(times), _TIMES_AT_ONCE):
        t = times[first : first + _TIMES_AT_ONCE]
        nearest, weights = kernel(t, band)
        result[first : first + _TIMES_AT_ONCE] = np.einsum(
            "tk,tkc->tc", weights, padded[nearest[:, None] + before + offsets]
        )
    return result


def kernel(t: FloatArray, band: float = 1.0) -> tuple[IntArray, FloatArray]:
    """The samples (m,) nearest to times t (m,), and the weights (m, 2 W / b + 1) of those around them."""
    reach = int(np.ceil(HALF_WIDTH / band))
    nearest = np.round(t).astype(np.int64)
    apart = band * ((t - nearest)[:, None] - np.arange(-reach, reach + 1))
    inside = np.clip(1 - (apart / HALF_WIDTH) ** 2, 0.0, None)
    weights = band * np.sinc(apart) * np.i0(_BETA * np.sqrt(inside)) / np.i0(_BETA) * (inside > 0)
    # A constant stays a constant.
    return nearest, weights / weights.sum(axis=1, keepdims=True)


def _continued(x: FloatArray, period: float, before: int, after: int) -> FloatArray:
    """Both ends continued periodically, each shifted so that a drift makes no jump."""
    n = len(x)
    # Each end and its continuation, taken one period further inside.
    left = _inside(x, np.arange(-before, 1.0) + period, period)
    right = _inside(x, np.arange(n - 1.0, n + after) - period, period)
    return np.concatenate([left[:-1] + x[0] - left[-1], x, right[1:] + x[-1] - right[0]])


def _inside(x: FloatArray, times: FloatArray, period: float) -> FloatArray:
    """Values at times that are at most one period outside."""
    N = round(period)
    if period != N and len(x) > period + 2 * HALF_WIDTH:
        return at_times(x, times, N)
    nearest = np.round(times).astype(np.int64)
    return np.asarray(
        x[np.where(nearest < 0, nearest % N, np.where(nearest < len(x), nearest, len(x) - N + (nearest - len(x)) % N))]
    )


@dataclass(frozen=True)
class ClockDrift:
    """T - N in samples, and the parts of the power that do not repeat without and with the shift."""

    excess: float
    unexplained: float
    left: float


def clock_drift(drivers: FloatArray, N: int) -> ClockDrift:
    """Excess of the period over N samples, from signals (n, c) that the generator sends."""
    Z = np.fft.rfft(scaled(drivers, N), axis=1)
    # The first period may hold a transient.
    Z = Z[1:] if len(Z) > 3 else Z
    far = max(1, len(Z) // 2)
    C, power = _cross(Z, 1)
    C_far, power_far = _cross(Z, far)
    # In eighths of a sample, from which the maximum is found.
    shifts = np.arange(-(limit := 8 * int(CLOCK.max_error * N + 2)), limit + 1)
    excess = refined_shift(C, N, float(shifts[np.argmax(np.fft.irfft(C, 8 * N)[shifts % (8 * N)])]) / 8)
    excess = refined_shift(C_far, N, far * excess) / far
    unshifted = correlation(C, N, 0.0)
    if correlation(C, N, excess) < unshifted:
        # Single jumps, such as lost samples: next to each other most periods agree as they are.
        return ClockDrift(0.0, 1 - unshifted / power, 1 - unshifted / power)
    before, after = (1 - correlation(C_far, N, e) / power_far for e in (0.0, far * excess))
    return ClockDrift(excess, before, after)


def resampled(signals: FloatArray, drivers: FloatArray, N: int, log: Log) -> Repaired:
    """Signals (n, c), finite, at the generator's clock, where it differs; DataError where fewer than two are left."""
    P = len(signals) // N
    if P < 2:
        return Repaired(signals)
    drift = clock_drift(drivers, N)
    is_clock = CLOCK.min_shift <= abs(drift.excess) * P and abs(drift.excess) <= CLOCK.max_error * N
    if not is_clock or drift.left > CLOCK.max_remaining_share * drift.unexplained:
        return Repaired(signals)
    T = N + drift.excess
    # Leakage biases the first estimate: corrected by the drift that is left after resampling.
    for _ in range(2):
        times = np.arange(int(len(drivers) / max(T, N)) * N, dtype=np.float64) * (T / N)
        T *= 1 + clock_drift(at_times(drivers, times, T), N).excess / N
    periods = int((len(signals) + CLOCK.max_missing_end * N) // T)
    if periods < 2:
        raise DataError(
            "records/clock",
            f"its period is {T:.3f} samples instead of {N}, and the log holds fewer than two of them; "
            "measure more periods",
            log.where,
        )
    result = at_times(signals, np.arange(periods * N, dtype=np.float64) * (T / N), T)
    text = (
        f"the period is {T:.4f} samples instead of {N}: the clocks of generator and log differ by "
        f"{1e6 * (T / N - 1):.1f} ppm; resampled, {100 * drift.left / drift.unexplained:.2g} % of the power that "
        "did not repeat remains"
    )
    return Repaired(result, (Finding(RESAMPLED, len(result), text),))


def _cross(Z: ComplexArray, lag: int) -> tuple[ComplexArray, float]:
    """C (F,) of spectra Z (P, F, c), summed over periods and channels, and the power that it cannot exceed."""
    a, b = Z[:-lag], Z[lag:]
    C: ComplexArray = np.sum(b * a.conj(), axis=(0, 2))
    return C, float(np.sqrt(np.sum(np.abs(a) ** 2) * np.sum(np.abs(b) ** 2)))
