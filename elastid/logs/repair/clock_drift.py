r"""Clocks of two signals: the delay between them, and the drift of a log relative to the generator.

Consecutive periods of T samples are shifted by e = T - N samples, which their mean cross-spectrum C shows,

.. math:: \hat e = \arg\max_e\, \mathrm{Re} \sum_k C_k e^{2 \pi j k e / N}, \quad C_k = \sum_p X_{p+1} X_p^*

and the log is resampled at multiples of T / N: the generator's clock is taken as right.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, fold_periods
from elastid.logs.repair import LogReport, detrend_repetitions
from elastid.logs.repair.resampling import RESAMPLED, resample_at

# Correlation at the best delay at least; below, the signals are not the same.
MIN_DELAY_CORRELATION = 0.5
# Quartz clocks differ by less; a period that is off by more is stated wrong.
MAX_CLOCK_ERROR = 5e-4
# Maximum non-repeating power after resampling, relative to the power before.
MAX_REMAINING_FRACTION = 0.5
# Fraction of a period that may be missing at the end; the period before replaces it.
MAX_MISSING_END = 5e-3
# Deviations from an even grid, and shifts over a whole record, in samples, that do no harm.
MAX_GRID_DEVIATION = 0.02


def estimate_delay(first: FloatArray, second: FloatArray, N: int | None) -> tuple[float, float]:
    """Estimate the delay of the second signal (n,) or signals (n, c), -N/2 to N/2 samples, and their correlation.

    Relative to the first.  Of the mean periods, or of the whole signals without a period (N None); the fraction of a
    sample comes from the phase of their cross-spectrum, summed over the columns.
    """
    (X, Y), N = _spectra([x.reshape(len(x), -1) for x in (first, second)], N)
    C = np.sum(Y * X.conj(), axis=1)
    size = np.sqrt(np.sum(np.abs(X[1:]) ** 2) * np.sum(np.abs(Y[1:]) ** 2))
    tau = _peak(C, N)
    return tau, correlation(C, N, tau) / size if size > 0 else 0.0


def delay_by_torque(
    torques: FloatArray, motions: FloatArray, orders: IntArray, N: int | None, shift: float
) -> tuple[float, float, float]:
    r"""Estimate the delay of motions (n, c) against torques (n, c); return also the agreement there and at shift.

    .. math:: \max_\tau\, \mathrm{Re} \sum_k e^{j \omega_k \tau} \frac{|U_k|}{|A_k|} A_k^T U_k^*

    with the accelerations A (phase transform: Knapp and Carter, IEEE Trans. ASSP 24, 1976).  Most lines are those of an
    inertia, whose torque and acceleration are in phase.  orders (c,): of the derivatives that are accelerations.
    """
    (U, Y), N = _spectra((torques, motions), N)
    A = Y * (1j * np.arange(len(Y))[:, None]) ** orders
    C = np.sum(A * U.conj(), axis=1) * np.linalg.norm(U, axis=1) / np.maximum(np.linalg.norm(A, axis=1), 1e-300)
    size, tau = max(float(np.linalg.norm(U[1:]) ** 2), 1e-300), _peak(C, N)
    return tau, correlation(C, N, tau) / size, correlation(C, N, shift) / size


def _spectra(signals: Sequence[FloatArray], N: int | None) -> tuple[list[ComplexArray], int]:
    """Compute spectra (F, c) of mean periods of signals (n, c), padded without a period; and samples of a period."""
    if N is None:
        N = 2 * max(map(len, signals))
        signals = [np.pad(x - x.mean(axis=0), ((0, N - len(x)), (0, 0))) for x in signals]
    return [np.fft.rfft(fold_periods(x, N).mean(axis=0), axis=0) for x in signals], N


def _peak(C: ComplexArray, N: int) -> float:
    """Find the shift with the largest correlation of a cross-spectrum (N // 2 + 1,), whose mean is removed."""
    C[0] = 0.0
    peak = int(np.argmax(np.fft.irfft(C, N)))
    return refine_shift(C, N, float(peak - N if peak > N // 2 else peak))


def correlation(C: ComplexArray, N: int, shift: float) -> float:
    """Compute Re sum_k C_k exp(2 pi j k shift / N) of a cross-spectrum (N // 2 + 1,)."""
    return float(np.sum((C * np.exp(_turns(C, N) * shift)).real))


def refine_shift(C: ComplexArray, N: int, shift: float) -> float:
    """Find the maximum of the correlation near a shift, by Newton's method; as it is where it is near no maximum."""
    turns = _turns(C, N)
    for _ in range(5):
        phasor = C * np.exp(turns * shift)
        slope, curvature = float(np.sum((turns * phasor).real)), float(np.sum((turns**2 * phasor).real))
        if curvature >= 0:
            return shift
        shift -= float(np.clip(slope / curvature, -0.5, 0.5))
    return shift


def _turns(C: ComplexArray, N: int) -> ComplexArray:
    return (2j * np.pi * np.arange(len(C)) / N).astype(np.complex128)


@dataclass(frozen=True)
class ClockDrift:
    """T - N in samples, and the parts of the power that do not repeat without and with the shift."""

    excess: float
    unexplained: float
    corrected_unexplained: float


def estimate_clock_drift(drivers: FloatArray, N: int) -> ClockDrift:
    """Estimate the excess of the period over N samples, from excitation signals (n, c)."""
    X = np.stack([detrend_repetitions(x, N) for x in drivers.T], axis=2)
    size = np.sqrt(np.mean(X**2, axis=(0, 1)))
    Z = np.fft.rfft(X / np.where(size > 0, size, 1.0), axis=1)  # scale each signal to an rms of 1, or 0
    # The first period may hold a transient.
    Z = Z[1:] if len(Z) > 3 else Z
    far_lag = max(1, len(Z) // 2)
    C, _ = _cross_spectrum(Z, 1)
    C_far, power_far = _cross_spectrum(Z, far_lag)
    # Grid of an eighth of a sample for the search of the maximum.
    shifts = np.arange(-(limit := 8 * int(MAX_CLOCK_ERROR * N + 2)), limit + 1)
    excess = refine_shift(C, N, float(shifts[np.argmax(np.fft.irfft(C, 8 * N)[shifts % (8 * N)])]) / 8)
    excess = refine_shift(C_far, N, far_lag * excess) / far_lag
    error_before, error_after = (1 - correlation(C_far, N, e) / power_far for e in (0.0, far_lag * excess))
    return ClockDrift(excess, error_before, error_after)


def resample_to_generator(signals: FloatArray, drivers: FloatArray, N: int, log: LogReport) -> FloatArray:
    """Resample finite signals (n, c) to the generator's clock if it differs; DataError for fewer than two periods."""
    P = len(signals) // N
    if P < 2:
        return signals
    drift = estimate_clock_drift(drivers, N)
    is_clock = abs(drift.excess) * P >= MAX_GRID_DEVIATION and abs(drift.excess) <= MAX_CLOCK_ERROR * N
    if not is_clock or drift.corrected_unexplained > MAX_REMAINING_FRACTION * drift.unexplained:
        return signals
    T = N + drift.excess
    # Leakage biases the first estimate: corrected by the drift that is left after resampling.
    for _ in range(2):
        times = np.arange(int(len(drivers) / max(T, N)) * N, dtype=np.float64) * (T / N)
        T *= 1 + estimate_clock_drift(resample_at(drivers, times, T), N).excess / N
    periods = int((len(signals) + MAX_MISSING_END * N) // T)
    if periods < 2:
        text = f"its period is {T:.3f} samples, not {N}, and the log contains fewer than two. Measure more periods"
        raise log.error("records/clock", text)
    result = resample_at(signals, np.arange(periods * N, dtype=np.float64) * (T / N), T)
    text = f"the period is {T:.4f} samples, not {N}: the clocks of generator and log differ by {1e6 * (T / N - 1):.1f}"
    text += f" ppm; after resampling, {100 * drift.corrected_unexplained / drift.unexplained:.2g} %"
    log.report(RESAMPLED, len(result), text + " of the non-repeating power remains")
    return result


def _cross_spectrum(Z: ComplexArray, lag: int) -> tuple[ComplexArray, float]:
    """Compute C (F,) of spectra Z (P, F, c), summed over periods and channels, and the power that it cannot exceed."""
    a, b = Z[:-lag], Z[lag:]
    C: ComplexArray = np.sum(b * a.conj(), axis=(0, 2))
    return C, float(np.sqrt(np.sum(np.abs(a) ** 2) * np.sum(np.abs(b) ** 2)))
