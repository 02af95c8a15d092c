r"""Time stamps of a log: judged, and its samples brought from their instants to an even grid.

The signal is the band-limited one that fits all samples in the sense of least squares,

.. math:: \min_x \sum_i w_i \Bigl(s(t_i) - \sum_j x_j \varphi(t_i / T_k - j)\Bigr)^2, \quad
    w_i = \tfrac12 (t_{i+1} - t_{i-1})

with phi a windowed sinc (below) and T_k the longest mean of some steps in a row, so that samples are nowhere fewer
than knots (Feichtinger, Groechenig and Strohmer, Numer. Math. 69, 1995); it holds frequencies up to 0.45 / T_k.

The clock of a log: one that differs from the generator's, delay between two logs.

Consecutive periods are then shifted by e = T - N samples, which their mean cross-spectrum C shows,

.. math:: \hat e = \arg\max_e\, \mathrm{Re} \sum_k C_k e^{2 \pi j k e / N}, \quad C_k = \sum_p X_{p+1} X_p^*

and the log is resampled at multiples of T / N: the generator's clock is taken as right.

Interpolation is by a sinc in a Kaiser window of half width W samples (Kaiser and Schafer, IEEE Trans. ASSP 28, 1980),

    x(t) = sum_n x(n) b sinc(b (t - n)) I_0(beta sqrt(1 - (b (t - n) / W)^2)) / I_0(beta)

with b = 1, or the ratio of the rates where the new one is lower.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, folded
from elastid.logs.repair import MAX_WRONG_FRACTION, Log, scaled
from elastid.logs.repair.interpolation import MAX_BRIDGED

RESAMPLED, JITTER = "samples resampled", "time stamps with jitter"
# Half width W in samples and shape beta of the Kaiser window; it passes frequencies up to this part of the rate.
HALF_WIDTH, _BETA, PASSBAND = 32, 9.0, 0.45
# The kernels of so many times are in memory together.
_TIMES_AT_ONCE = 4096


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
# Half the last digit of rounded stamps, and the tilt of the fitted line where halves are rounded up, then down.
MAX_ROUNDING = 0.8
# Longer steps, in medians, are gaps.
MIN_GAP = 1.9
# Knots per sample at rate_hz, at least; fewer leave too little of the band that the rate promises.
MIN_RATE_FRACTION = 0.75
# Residuals at the stamps over residuals on an even grid, below which the samples were taken at the stamps; knots per
# sample of this test: with fewer, the error of the band limit exceeds the effect of the jitter.
SMOOTHER, JUDGED_FRACTION = 0.8, 0.9
# Samples at rate_hz over those of the log, or the inverse: beyond, stamps are not in s, or jump.
MAX_RATE_RATIO = 20.0


def delay(first: FloatArray, second: FloatArray, N: int | None) -> tuple[float, float]:
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
    return [np.fft.rfft(folded(x, N).mean(axis=0), axis=0) for x in signals], N


def _peak(C: ComplexArray, N: int) -> float:
    """Find the shift with the largest correlation of a cross-spectrum (N // 2 + 1,), whose mean is removed."""
    C[0] = 0.0
    peak = int(np.argmax(np.fft.irfft(C, N)))
    return refined_shift(C, N, float(peak - N if peak > N // 2 else peak))


def correlation(C: ComplexArray, N: int, shift: float) -> float:
    """Compute Re sum_k C_k exp(2 pi j k shift / N) of a cross-spectrum (N // 2 + 1,)."""
    return float(np.sum((C * np.exp(_turns(C, N) * shift)).real))


def refined_shift(C: ComplexArray, N: int, shift: float) -> float:
    """Find the maximum of the correlation near a shift, by Newton's method; as it is where it is near no maximum."""
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
    """Interpolate signals (n, c) at times (m,) in samples, periodic beyond the ends; band: b, < 1 for a lower rate."""
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
    """Compute the samples (m,) nearest to times t (m,), and the weights (m, 2 W / b + 1) of those around them."""
    reach = int(np.ceil(HALF_WIDTH / band))
    nearest = np.round(t).astype(np.int64)
    apart = band * ((t - nearest)[:, None] - np.arange(-reach, reach + 1))
    inside = np.clip(1 - (apart / HALF_WIDTH) ** 2, 0.0, None)
    weights = band * np.sinc(apart) * np.i0(_BETA * np.sqrt(inside)) / np.i0(_BETA) * (inside > 0)
    # A constant stays a constant.
    return nearest, weights / weights.sum(axis=1, keepdims=True)


def _continued(x: FloatArray, period: float, before: int, after: int) -> FloatArray:
    n = len(x)
    # Each end and its continuation, taken one period further inside.
    first = _values_at(x, np.arange(-before, 1.0) + period, period)
    last = _values_at(x, np.arange(n - 1.0, n + after) - period, period)
    return np.concatenate([first[:-1] + x[0] - first[-1], x, last[1:] + x[-1] - last[0]])


def _values_at(x: FloatArray, times: FloatArray, period: float) -> FloatArray:
    N = round(period)
    if period != N and len(x) > period + 2 * HALF_WIDTH:
        return at_times(x, times, N)
    nearest = np.round(times).astype(np.int64)
    return x[
        np.where(nearest < 0, nearest % N, np.where(nearest < len(x), nearest, len(x) - N + (nearest - len(x)) % N))
    ]


@dataclass(frozen=True)
class ClockDrift:
    """T - N in samples, and the parts of the power that do not repeat without and with the shift."""

    excess: float
    unexplained: float
    corrected_unexplained: float


def clock_drift(drivers: FloatArray, N: int) -> ClockDrift:
    """Estimate the excess of the period over N samples, from signals (n, c) that the generator sends."""
    Z = np.fft.rfft(scaled(drivers, N), axis=1)
    # The first period may hold a transient.
    Z = Z[1:] if len(Z) > 3 else Z
    far = max(1, len(Z) // 2)
    C, _ = _cross(Z, 1)
    C_far, power_far = _cross(Z, far)
    # In eighths of a sample, from which the maximum is found.
    shifts = np.arange(-(limit := 8 * int(MAX_CLOCK_ERROR * N + 2)), limit + 1)
    excess = refined_shift(C, N, float(shifts[np.argmax(np.fft.irfft(C, 8 * N)[shifts % (8 * N)])]) / 8)
    excess = refined_shift(C_far, N, far * excess) / far
    before, after = (1 - correlation(C_far, N, e) / power_far for e in (0.0, far * excess))
    return ClockDrift(excess, before, after)


def resampled(signals: FloatArray, drivers: FloatArray, N: int, log: Log) -> FloatArray:
    """Resample finite signals (n, c) to the generator's clock if it differs; DataError for fewer than two periods."""
    P = len(signals) // N
    if P < 2:
        return signals
    drift = clock_drift(drivers, N)
    is_clock = abs(drift.excess) * P >= MAX_GRID_DEVIATION and abs(drift.excess) <= MAX_CLOCK_ERROR * N
    if not is_clock or drift.corrected_unexplained > MAX_REMAINING_FRACTION * drift.unexplained:
        return signals
    T = N + drift.excess
    # Leakage biases the first estimate: corrected by the drift that is left after resampling.
    for _ in range(2):
        times = np.arange(int(len(drivers) / max(T, N)) * N, dtype=np.float64) * (T / N)
        T *= 1 + clock_drift(at_times(drivers, times, T), N).excess / N
    periods = int((len(signals) + MAX_MISSING_END * N) // T)
    if periods < 2:
        text = f"its period is {T:.3f} samples, not {N}, and the log contains fewer than two. Measure more periods"
        raise log.error("records/clock", text)
    result = at_times(signals, np.arange(periods * N, dtype=np.float64) * (T / N), T)
    text = (
        f"the period is {T:.4f} samples, not {N}: the clocks of generator and log differ by {1e6 * (T / N - 1):.1f} "
        f"ppm; after resampling, {100 * drift.corrected_unexplained / drift.unexplained:.2g} % of the non-repeating "
        "power remains"
    )
    log.report(RESAMPLED, len(result), text)
    return result


def _cross(Z: ComplexArray, lag: int) -> tuple[ComplexArray, float]:
    """Compute C (F,) of spectra Z (P, F, c), summed over periods and channels, and the power that it cannot exceed."""
    a, b = Z[:-lag], Z[lag:]
    C: ComplexArray = np.sum(b * a.conj(), axis=(0, 2))
    return C, float(np.sqrt(np.sum(np.abs(a) ** 2) * np.sum(np.abs(b) ** 2)))


GAPS, SET_BACK = "samples missing in time", "clock set back"
# Knots that are solved for together, and those beyond either end that are solved for and not used.
_KNOTS, _OVERLAP = 16384, 4 * HALF_WIDTH
_TOLERANCE = 1e-8  # below the noise of any sensor
# Damping of the least squares: knots beyond the ends are barely constrained by any sample, and noise of 1e-3 would
# become more than the signal in the last samples. Within the record it costs the square of it, 1e-6 of a signal.
_DAMPING = 1e-3


# Stamps among which the last digit of one is nonzero.
LAST = 20


def describe_steps(time_s: FloatArray) -> str:
    """Describe shortest, median and longest step between stamps (n,), and the mean rate."""
    shortest, median, longest = (f"{1e3 * f(np.diff(time_s)):.6g}" for f in (np.min, np.median, np.max))
    mean_hz = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    return f"steps of {shortest} to {longest} ms, median {median} ms, mean rate {mean_hz:.6g} Hz"


def even_grid(time_s: FloatArray) -> tuple[IntArray, float] | None:
    """Find the row of each stamp and the rate in Hz of the uniform grid of stamps (n,); None without such a grid.

    Rounded stamps, such as 2 and 3 ms in turn at 400 Hz, lie on one.
    """
    time_s = time_s - time_s[0]  # of a calendar's seconds a clock of some kHz would be lost in their rounding
    steps, candidates = np.diff(time_s), [np.arange(len(time_s))]
    median = float(np.median(steps))
    if median > 0:
        candidates.append(np.concatenate([[0], np.cumsum(np.maximum(np.round(steps / median), 1).astype(np.int64))]))
    rounding = MAX_ROUNDING * _resolution(time_s)
    for rows in candidates:
        step, start = np.polyfit(rows.astype(np.float64), time_s, 1)
        allowed = np.maximum(MAX_GRID_DEVIATION * step, rounding)
        if step > 0 and np.all(np.abs(time_s - start - step * rows) <= allowed):
            return rows, 1 / float(step)
    return None


def _resolution(time_s: FloatArray) -> float:
    """Find the decimal step of the last stamps; 0 where they have more than nine digits.

    It is the coarsest: loggers with a fixed number of significant digits write fewer decimals as time goes on.
    """
    last = time_s[-LAST:, None] * 10.0 ** np.arange(10)
    is_whole = np.all(np.abs(last - np.round(last)) < 1e-3, axis=0)
    return 10.0 ** -int(np.argmax(is_whole)) if is_whole.any() else 0.0


def on_grid(time_s: FloatArray, signals: FloatArray, rate_hz: float, log: Log) -> FloatArray:
    """Bring signals (n, c) to rate_hz from the first stamp on, with rows of NaN for gaps of the stamps (n,).

    Stamps on an even grid at rate_hz, but for clocks that differ as quartzes do, change no sample.
    Rows in another order than their stamps are sorted.  A clock that was set back leaves a gap of unknown length.
    Raises DataError where stamps are missing, where many fall, and where long steps leave too little of the band.
    """
    time_s, signals = rising(time_s, signals, log)
    if len(time_s) < 3 or time_s[-1] == time_s[0]:
        raise log.error("records/clock", "its time does not increase. Name another channel as time, or omit time")
    time_s = time_s - time_s[0]
    if not 1 / MAX_RATE_RATIO < (len(time_s) - 1) / (time_s[-1] * rate_hz) < MAX_RATE_RATIO:
        after = log.time_of(int(np.argmax(np.diff(time_s))))
        raise log.error(
            "records/clock",
            f"its {len(time_s)} time stamps have {describe_steps(time_s)}, the longest after {after}; rate_hz is "
            f"{rate_hz:g}. Give the time in s, correct rate_hz, or exclude a jump by samples",
        )
    grid = even_grid(time_s)
    even = _logger_jitter(time_s, signals) if grid is None else None
    if even is not None:
        jitter_s, grid_hz = even
        grid = np.arange(len(time_s)), grid_hz
        text = (
            f"time stamps jitter by up to {1e3 * jitter_s:.3g} ms around an even grid of {grid_hz:.6g} Hz; the signals "
            "are smoother on the grid: the rows are taken as evenly sampled"
        )
        log.report(JITTER, len(time_s), text)
    if grid is not None:
        rows, grid_hz = grid
        if abs(grid_hz / rate_hz - 1) <= MAX_CLOCK_ERROR:
            count, result = int(rows[-1]) + 1 - len(signals), np.full((int(rows[-1]) + 1, signals.shape[1]), np.nan)
            result[rows] = signals
            _report_gaps(count, np.flatnonzero(np.diff(rows) > 1), log)
            return result
        time_s = rows / grid_hz
    return _at_instants(time_s, signals, rate_hz, log)


def rising(time_s: FloatArray, signals: FloatArray, log: Log) -> tuple[FloatArray, FloatArray]:
    """Sort stamps (n,) and their signals (n, c).

    Raises DataError for missing stamps, and for more falling steps than of single faults.
    """
    if not np.isfinite(time_s).all():
        place = log.time_of(np.flatnonzero(~np.isfinite(time_s))[0])
        raise log.error("records/clock", f"the time is missing at {place}. Exclude that part by samples")
    twice = np.flatnonzero(np.diff(time_s) == 0) + 1
    if 0 < len(twice) <= max(1.0, MAX_WRONG_FRACTION * len(time_s)) and even_grid(time_s) is None:
        place = log.time_of(twice[0])
        log.report(
            "rows with the stamp of another",
            len(twice),
            f"{len(twice)} rows have the time of the row before, the first at {place}; discarded",
        )
        time_s, signals = np.delete(time_s, twice), np.delete(signals, twice, axis=0)
    falls = np.flatnonzero(np.diff(time_s) < 0)
    if not len(falls):
        return time_s, signals
    place = log.time_of(falls[0] + 1)
    if len(falls) > max(1.0, MAX_WRONG_FRACTION * len(time_s)):
        text = f"the time runs backwards in {len(falls)} of {len(time_s) - 1} steps, the first at {place}"
        raise log.error("records/clock", f"{text}. Sort the rows by time, or exclude that part by samples")
    order = np.argsort(time_s, kind="stable")
    steps = np.diff(time_s[order])
    if steps.min() > np.median(steps) / 2:
        log.report(
            "rows sorted by time", len(falls), f"{len(falls)} rows were not in time order, the first at {place}; sorted"
        )
        return time_s[order], signals[order]
    gap_s = (MAX_BRIDGED + 2) * float(np.median(np.diff(time_s)))
    log.report(SET_BACK, len(falls), f"the time falls at {place}, as after a clock was set back; treated as a gap")
    rises = np.diff(time_s, prepend=time_s[0])
    rises[falls + 1] = gap_s
    return np.cumsum(rises), signals


def _logger_jitter(time_s: FloatArray, signals: FloatArray) -> tuple[float, float] | None:
    """Return the largest distance in s of stamps (n,) from an even grid, and its rate in Hz.

    None for distances of a sample and more, as at gaps, and for signals (n, c) that are clearly smoother at their
    stamps: their sampling was uneven.
    """
    rows = np.arange(len(time_s), dtype=np.float64)
    step, start = np.polyfit(rows, time_s, 1)
    jitter_s = float(np.abs(time_s - start - step * rows).max())
    if not jitter_s < step:
        return None
    some = slice(0, _KNOTS // 4)  # each channel takes seconds
    knot_hz = JUDGED_FRACTION / step
    at_stamps, on_rows = (_fitted(t[some], signals[some], t[:1], knot_hz)[1] for t in (time_s, step * rows))
    # By all channels: a torque with more than the band in it is as rough at both.
    ratio = np.exp(np.mean(np.log(np.maximum(at_stamps, 1e-12) / np.maximum(on_rows, 1e-12))))
    return (jitter_s, 1 / float(step)) if ratio > SMOOTHER else None


def _report_gaps(count: int, gaps: IntArray, log: Log) -> None:
    if count:
        text = f"{count} samples are missing in {gaps.size} gaps of its time, the first after {log.time_of(gaps[0])}"
        log.report(GAPS, count, text)


def _at_instants(time_s: FloatArray, signals: FloatArray, rate_hz: float, log: Log) -> FloatArray:
    """Resample signals from instants (n,) in s, the first of which is 0."""
    steps_s, steps = np.diff(time_s), describe_steps(time_s)
    gaps = np.flatnonzero(steps_s > MIN_GAP * np.median(steps_s))
    knot_steps = np.delete(steps_s, gaps)
    row = min(8, len(knot_steps))  # steps, whose mean no knots are closer than
    knot_hz = 1 / float(np.convolve(knot_steps, np.full(row, 1 / row), mode="valid").max())
    if knot_hz < MIN_RATE_FRACTION * rate_hz:
        unit = 10.0 ** (np.floor(np.log10(knot_hz)) - 1)
        advised_hz = np.floor(knot_hz / unit + 1e-9) * unit
        raise log.error(
            "records/clock",
            f"its time has {steps}, sufficient up to {PASSBAND * knot_hz:.3g} Hz; rate_hz {rate_hz:g} needs "
            f"{PASSBAND * rate_hz:.3g} Hz. Set rate_hz: {advised_hz:g}",
        )
    knot_hz = min(knot_hz, rate_hz)  # a lower rate than that of the stamps holds the lower band alone
    grid_s = np.arange(int(time_s[-1] * rate_hz + 1e-6) + 1) / rate_hz
    result, ratio = _fitted(time_s, signals, grid_s, knot_hz)
    missing = np.isin(np.searchsorted(time_s, grid_s, side="right") - 1, gaps)
    result[missing] = np.nan
    text = (
        f"its time has {steps}; resampled to {rate_hz:g} Hz, exact up to {PASSBAND * knot_hz:.3g} Hz, without "
        f"{ratio.max(initial=0.0):.2g} of its rms, which is noise or faster"
    )
    log.report(RESAMPLED, len(result), text)
    _report_gaps(int(missing.sum()), gaps, log)
    return result


def _fitted(
    time_s: FloatArray, signals: FloatArray, grid_s: FloatArray, knot_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Interpolate signals (m, c) at grid_s; return the ratio (c,) of rms residual to rms signal with them, 0 without.

    NaN in blocks of knots without samples, as in a long pause.
    """
    instants, grid = time_s * knot_hz, grid_s * knot_hz
    result = np.full((len(grid_s), signals.shape[1]), np.nan)
    squares = np.zeros(signals.shape[1])
    for first in range(0, int(grid[-1]) + 1, _KNOTS):
        low, high = first - _OVERLAP, first + _KNOTS + _OVERLAP
        near = slice(*np.searchsorted(instants, [low, high]))
        rows = slice(*np.searchsorted(grid, [first, first + _KNOTS]))
        inside = slice(*np.searchsorted(instants[near], [first, first + _KNOTS]))
        for i in range(signals.shape[1]):
            t, s = instants[near], signals[near, i]
            valid = np.isfinite(s)
            if not valid.any():
                continue
            knots = _knots(t[valid], s[valid], low, high)
            result[rows, i] = at_times(knots[:, None], grid[rows] - low, len(knots))[:, 0]
            residual = s[inside] - at_times(knots[:, None], t[inside] - low, len(knots))[:, 0]
            squares[i] += float(np.nansum(residual**2))
    logged = np.isfinite(signals).any(axis=0)
    size = np.maximum(np.nanstd(signals[:, logged], axis=0), 1e-300)
    ratio = np.zeros(signals.shape[1])
    ratio[logged] = np.sqrt(squares[logged] / len(signals)) / size
    return result, ratio


def _knots(t: FloatArray, s: FloatArray, low: int, high: int) -> FloatArray:
    """Solve for x (high - low + 1,) at whole t from low to high, of samples s (n,) at instants t (n,)."""
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import lsmr

    start = np.interp(np.arange(low, high + 1.0), t, s)
    nearest, weights = kernel(t - low)
    columns = np.clip(nearest[:, None] + np.arange(-HALF_WIDTH, HALF_WIDTH + 1), 0, high - low)
    row_starts = np.arange(0, columns.size + 1, columns.shape[1])
    K = csr_array((weights.ravel(), columns.ravel(), row_starts), shape=(len(t), high - low + 1))
    w = np.sqrt(np.clip(np.gradient(t), 1e-3, 1.0))
    correction = lsmr(K * w[:, None], w * (s - K @ start), _DAMPING, _TOLERANCE, _TOLERANCE, maxiter=60)[0]
    return np.asarray(start + correction)
