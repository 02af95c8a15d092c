r"""The period of a recorded excitation, stated or detected, by autocorrelation (Rabiner, IEEE Trans. ASSP 25, 1977).

.. math:: \rho(l) = \frac{\sum_t x(t)\, x(t + l)}{\sqrt{\sum_t x(t)^2 \sum_t x(t + l)^2}}

If a signal is periodic except for noise, rho is the same after one, two and more periods. A slow motion, which is
similar to itself after some lag, has another rho after each of them.
"""

from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, fold_periods
from elastid.base.errors import DataError
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.logs.repair import LogReport, detrend_repetitions
from elastid.logs.repair.clock_drift import MAX_CLOCK_ERROR, MAX_REMAINING_FRACTION, MIN_DELAY_CORRELATION
from elastid.logs.repair.masks import CHECK_CELLS, MAX_MISSING_FRACTION, MIN_OVER_USUAL
from elastid.logs.repair.resampling import resample_at

# Minimum correlation of repetitions; MIN_DELAY_CORRELATION if several periods show that the remainder is noise.
MIN_CORRELATION = 0.95
# Minimum number of periods for the test of the remainder, and maximum relative change of their correlations.
MIN_NOISY_PERIODS, MAX_CORRELATION_CHANGE = 4, 0.1
# The change between periods is noise if its autocorrelation at lags from 1/20 to 1/2 of a period is at most
# MAX_REST_CORRELATION: an aperiodic motion changes as slowly as it moves, which correlates at these lags.
MIN_REST_LAG, MAX_REST_CORRELATION = 0.05, 0.3
# A period is as good as another one if its unexplained power is at most 1.2 times as large plus 1 % of the signal's.
MAX_UNEXPLAINED_RATIO, UNEXPLAINED_MARGIN = 1.2, 0.01
MIN_PERIODS = 1.9  # in a log; the second may end early
# Maximum shift by lost samples, relative to the period and in samples; larger shifts have other causes.
MAX_SHIFT, MAX_SHIFT_SAMPLES = 0.02, 50
MIN_FRACTION_OF_BEST = 0.8  # lower peaks, relative to the highest one, are not refined


@dataclass(frozen=True)
class Repetition:
    """Correlation of signals with themselves at the stated lag, and the lag with the largest correlation.

    best_samples: that lag, not always an integer; 0 if the signals do not repeat.  best_correlation: at this lag.  If
    the study states a half wave, both are correlations with the negative signal.  remainder_is_noise: the part that
    does not repeat is noise, by several repetitions.
    """

    correlation: float
    best_samples: float
    best_correlation: float
    remainder_is_noise: bool = False

    @property
    def matches_stated_period(self) -> bool:
        """True if signals repeat after the stated lag, and no other lag is better."""
        min_correlation = MIN_DELAY_CORRELATION if self.remainder_is_noise else MIN_CORRELATION
        return self.correlation >= min_correlation and _is_as_good(self.correlation, self.best_correlation)

    @property
    def rank(self) -> tuple[bool, float]:
        """Sort key of the results of several signals or searches: periodic ones first."""
        return self.best_samples > 0, self.best_correlation


_NO_REPETITION = Repetition(0.0, 0.0, 0.0)


def repetition(signals: FloatArray, lag: int, sign: int = 1) -> Repetition:
    """Test if signals (n, c), NaN where missing, repeat after lag samples; sign -1: as x(t + lag) = -x(t).

    The result is that of the signal that repeats best, since not every input is excited in every experiment.  One
    repetition is compared with the next and, to detect a period that is off by a fraction of a sample, with many later
    ones.  Means and ramps of each lag are removed first: a position that drifts still repeats.
    """
    results = [_repetition(x, lag, sign) for x in signals.T if _varies(x)]
    return max(results, key=lambda r: (r.matches_stated_period, r.best_correlation), default=_NO_REPETITION)


def find_period(signals: FloatArray) -> Repetition:
    """Find the shortest lag after which a signal of (n, c) repeats, except for drift; best_samples 0 without one."""
    return max((_find_lag(x) for x in signals.T if _varies(x)), key=lambda result: result.rank, default=_NO_REPETITION)


def _varies(x: FloatArray) -> bool:
    return bool(np.isfinite(x).any() and np.nanmax(x) > np.nanmin(x))


def _repetition(x: FloatArray, lag: int, sign: int, starts: bool = True) -> Repetition:
    """Test one signal (n,); starts: its first repetition may contain the start from rest."""
    # Missing repetitions at the end do not count.
    finite = np.flatnonzero(np.isfinite(x))
    x = x[: max(int(finite.max(initial=-1)) + 1, 2 * lag)]
    n = len(x)
    if n < MIN_PERIODS * lag or lag < 1 or finite.size == 0:
        return _NO_REPETITION
    residual = detrend_repetitions(x, lag).ravel() if n >= 2 * lag else _detrend(x, lag)
    rho = autocorrelation(residual)
    P = len(residual) // lag
    result = Repetition(0.0, float(lag), 0.0, _remainder_is_noise(rho, lag, sign))
    for repeats in sorted({1, max(1, P // 2)}):
        middle = repeats * lag
        near = sign**repeats * rho[max(1, middle - lag // 2) : middle + lag // 2 + 1]
        correlation = sign**repeats * float(rho[middle]) if middle < len(rho) else 0.0
        result = replace(result, correlation=correlation, best_correlation=float(near.max(initial=0.0)))
        if not result.matches_stated_period:
            # Estimators discard the first repetition if it differs.
            later = _repetition(x[lag:], lag, sign, starts=False) if starts and n >= 3 * lag else _NO_REPETITION
            if later.matches_stated_period:
                return later
            period = max((_shortest_period(residual), _find_lag(x)), key=lambda result: result.rank)
            return replace(period, correlation=correlation)
    return result


def _find_lag(x: FloatArray) -> Repetition:
    """Find the lag at which a signal (n,) repeats, with or without a drift."""
    candidates = (x - np.nanmean(x), detrend_repetitions(x, len(x)).ravel())
    best = max((_shortest_period(signal) for signal in candidates), key=lambda result: result.rank)
    return _shortest_period(_detrend(x, round(best.best_samples))) if best.best_samples else best


def _detrend(x: FloatArray, lag: int) -> FloatArray:
    """Remove the mean and the drift of a signal (n,); the drift is the mean change after `lag` samples."""
    change = x[lag:] - x[:-lag]
    residual = x - (float(np.nanmean(change)) / lag if np.isfinite(change).any() else 0.0) * np.arange(len(x))
    return np.asarray(residual - np.nanmean(residual))


def _is_as_good(correlation: float, best: float) -> bool:
    return 1 - correlation <= MAX_UNEXPLAINED_RATIO * (1 - best) + UNEXPLAINED_MARGIN


def _remainder_is_noise(rho: FloatArray, lag: float, sign: int = 1) -> bool:
    """Test if correlations after one, two, ... periods are equal up to half of the log, and if the remainder is noise.

    Remainder: d(t) = x(t + T) - x(t); its autocorrelation is 2 rho(l) - rho(T + l) - rho(T - l), relative to x(t)^2.
    """
    n = len(rho) * 8 / 7
    if n < MIN_NOISY_PERIODS * lag:
        return False
    repeats = np.arange(1, int(n / lag) // 2 + 1)
    # A lag that is not whole has its peak at one of two samples.
    near = np.clip(np.round(repeats * lag).astype(int) + np.array([-1, 0, 1])[:, None], 0, len(rho) - 1)
    peaks = np.max((float(sign) ** repeats) * rho[near], axis=0)
    if np.any(np.abs(peaks / max(peaks[0], 1e-300) - 1) > MAX_CORRELATION_CHANGE):
        return False
    T = max(1, round(lag))
    later = np.arange(max(1, round(MIN_REST_LAG * T)), T // 2 + 1)
    remainder = 2 * rho[later] - sign * (rho[T + later] + rho[T - later])
    return bool(np.all(np.abs(remainder) <= MAX_REST_CORRELATION * 2 * max(1 - sign * rho[T], 1e-3)))


def _shortest_period(x: FloatArray) -> Repetition:
    """Find the shortest period of a signal (n,) that repeats as well as any other, also after half of the log."""
    all_lags = autocorrelation(x)
    rho = all_lags[: int(len(x) / MIN_PERIODS) + 1]
    beyond_first_lobe = np.flatnonzero(rho < 0.5)
    if beyond_first_lobe.size == 0:
        return _NO_REPETITION
    start = int(beyond_first_lobe[0])
    highest = float(rho[start:].max())
    inner = rho[start + 1 : -1]
    peaks = start + 1 + np.flatnonzero((inner >= rho[start:-2]) & (inner > rho[start + 2 :]))
    peaks = peaks[rho[peaks] > max(MIN_FRACTION_OF_BEST * highest, MIN_DELAY_CORRELATION)]
    if peaks.size == 0:
        return Repetition(0.0, 0.0, highest)
    best = max(highest, _refine(all_lags, int(peaks[np.argmax(rho[peaks])]))[1])
    for peak in peaks:
        period, correlation = _refine(all_lags, int(peak))
        if not _is_as_good(correlation, best):
            continue
        if correlation < MIN_CORRELATION and not _remainder_is_noise(all_lags, period):
            continue
        period = _refine_by_later_peaks(all_lags, period)
        # Steps of a reference correlate after one or a few steps, but not after half of the log.
        middle_lag = round(max(1, len(x) / period // 2) * period)
        if np.max(all_lags[middle_lag - 1 : middle_lag + 2]) >= (1 - MAX_CORRELATION_CHANGE) * correlation:
            return Repetition(0.0, period, correlation)
    return Repetition(0.0, 0.0, best)


def _refine(rho: FloatArray, peak: int) -> tuple[float, float]:
    """Interpolate lag and height of a peak of rho between samples by a grid of 0.02 samples and a parabola."""
    step = 0.02
    first, last = max(0, peak - 64), min(len(rho), peak + 65)
    times = np.arange(-1, 1 + step / 2, step) + (peak - first)
    fine = resample_at(rho[first:last, None], times)[:, 0]
    i = int(np.clip(np.argmax(fine), 1, len(fine) - 2))
    curvature, tilt = fine[i - 1] - 2 * fine[i] + fine[i + 1], fine[i - 1] - fine[i + 1]
    offset = float(np.clip(tilt / (2 * curvature), -1, 1)) if curvature < 0 else 0.0
    # An interpolated peak can exceed 1, the limit of a correlation.
    return first + float(times[i]) + offset * step, min(float(fine.max()), 1.0)


def _refine_by_later_peaks(rho: FloatArray, period: float) -> float:
    for repeats in range(2, int(len(rho) / period) + 1):
        around = np.arange(-3, 4) + round(repeats * period)
        if around[0] <= 0 or around[-1] >= len(rho) - 1:  # the peak may lie beyond the last lag
            break
        period = _refine(rho, int(around[np.argmax(rho[around])]))[0] / repeats
    return period


def autocorrelation(x: FloatArray) -> FloatArray:
    """Compute rho (n - n // 8,) of x (n,) at lags 0, 1, ...; missing samples (NaN) and partners do not count."""
    n = len(x)
    n_fft = 1 << (2 * n - 1).bit_length()
    valid = np.isfinite(x)
    product = np.fft.irfft(np.abs(np.fft.rfft(np.where(valid, x, 0.0), n_fft)) ** 2, n_fft)[:n]
    if valid.all():
        power = np.cumsum(x**2)
        first, last = power[::-1], power[-1] - np.concatenate([[0.0], power[:-1]])
    else:
        squares, counts = np.fft.rfft(np.where(valid, x, 0.0) ** 2, n_fft), np.fft.rfft(valid.astype(float), n_fft)
        first, last = (np.fft.irfft(c, n_fft)[:n] for c in (squares.conj() * counts, counts.conj() * squares))
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(np.maximum(first, 0.0) * np.maximum(last, 0.0))
        # Rounding in parts that are nothing relative to the signal correlates with anything.
        rho = np.where(size > 1e-12 * max(float(size[0]), 1e-300), product / size, 0.0)
    return np.asarray(np.nan_to_num(rho, posinf=0.0, neginf=0.0)[: n - n // 8], np.float64)


NO_LINES = "For an aperiodic record set period: none, and estimator.method to local_rational, local_polynomial or h1"


def check_complete(excitation: FloatArray, place: object) -> None:
    """Raise DataError for an excitation (n, d) with so many missing samples (NaN) that no period can be judged."""
    fraction = float(np.mean(~np.isfinite(excitation).all(axis=1)))
    if fraction > MAX_MISSING_FRACTION:
        text = f"{fraction:.1%} of the excitation's samples are missing (limit {MAX_MISSING_FRACTION:.1%})"
        raise DataError("records/missing-samples", f"{text}. {CHECK_CELLS}", place)


def period_samples(recorded: RecordedSpec, file: FileSpec, rate_hz: float, drivers: FloatArray) -> float | None:
    """Return samples of the period at rate_hz, not always whole; None without one.

    drivers (n, d): torques at that rate, NaN where missing, to be searched if the study says so; DataError without one.
    """
    period = recorded.period_of(file)
    if period is None:
        return None
    if period != "find":
        return round_samples(period * rate_hz / recorded.known_rate_hz)
    best = find_period(drivers)
    if not best.best_samples:
        text = f"no period was detected (best correlation {best.best_correlation:.2f}; at least {MIN_CORRELATION:g}"
        raise DataError("records/period-mismatch", f"{text} with two periods). {NO_LINES}", file.path)
    N = round(best.best_samples)
    # The generator's clock is right where its periods are whole: the log is then resampled to it.
    is_whole = len(drivers) >= 2 * N and abs(best.best_samples - N) <= MAX_CLOCK_ERROR * N
    return float(N) if is_whole else round_samples(best.best_samples)


def report_unstated_period(drivers: FloatArray, log: LogReport) -> None:
    """Report a period of the drivers (n, d) that the study does not state."""
    best = find_period(drivers)
    if best.best_correlation < MIN_CORRELATION or not best.best_samples:
        return
    text = f"no period is stated, but the torques repeat every {round(best.best_samples, 2):.8g} samples. Set period:"
    advice = "find to estimate the noise from the periods, or period: none for one transient"
    log.note("records/period-mismatch", f"{text} {advice}")


def grid_samples(period: float, half_wave: bool) -> int:
    """Return the whole number of samples nearest to a period; an even one where half of it counts."""
    return 2 * round(period / 2) if half_wave and period != round(period) else round(period)


def round_samples(samples: float) -> float:
    """Return samples of a period, whole where they are within one millionth of it."""
    N = round(samples)
    return float(N) if abs(samples - N) <= 1e-6 * samples else samples


def check_repeat(excitation: FloatArray, N: int, half_wave: bool, log: LogReport, has_others: bool = False) -> None:
    """Raise DataError where the excitation (n, n_u), NaN where missing, does not repeat as stated, or not often enough.

    has_others: another log shows if one period repeats.
    """
    n = len(excitation)
    repeat, sign = (N // 2, -1) if half_wave else (N, 1)
    if has_others and N <= n < MIN_PERIODS * repeat:
        return
    if n < MIN_PERIODS * repeat:
        minimum = "one is" if half_wave else "two are"
        text = f"{_samples_text(n, log)} are {n / N:.3g} periods of {_samples_text(N, log)}; at least"
        raise log.error("records/period-mismatch", f"{text} {minimum} needed. {NO_LINES}")
    result = repetition(excitation, repeat, sign)
    shift = _sample_shift(excitation, repeat, sign)
    if result.matches_stated_period and shift is None:
        return
    pairs = "second half minus first" if half_wave else "one period to the next"
    problem = f"the excitation does not repeat with the stated period of {_samples_text(N, log)} (correlation"
    problem += f" {result.correlation:.3f}, {pairs})"
    if shift is not None:
        loss = f"{abs(shift[0])} samples are {'missing' if shift[0] < 0 else 'duplicated'} near {log.time_of(shift[1])}"
        advice = "Measure again, or exclude the shorter part by samples"
        text = f"{loss}; before and after, the excitation repeats. {advice}"
    elif result.best_samples:
        lag = f"it repeats every {_samples_text(result.best_samples, log)} (correlation {result.best_correlation:.3f})"
        text = f"{lag}. Correct the period or the rate"
    elif not half_wave and repetition(excitation[: 2 * repeat], repeat, sign=-1).matches_stated_period:
        text = f"the second half of {_samples_text(2 * N, log)} is minus the first. Set period_samples: {2 * N}"
        text += ", half_wave: true"
    else:
        text = f"nor at any other lag (best correlation {result.best_correlation:.3f}); a stated period needs a"
        text += f" periodic excitation. {NO_LINES}"
    raise log.error("records/period-mismatch", f"{problem}; {text}")


def _sample_shift(excitation: FloatArray, N: int, sign: int) -> tuple[int, int] | None:
    """Find change and place of a shift by whole samples between parts that repeat after N samples; None without one.

    Each eighth of a period is looked for one period later: after N samples, or by one other lag across the shift.
    """
    L, max_shift = max(N // 8, 1), int(np.clip(MAX_SHIFT * N, 2, MAX_SHIFT_SAMPLES))
    x = excitation[:, [c for c in range(excitation.shape[1]) if _varies(excitation[:, c])]]
    if not np.isfinite(x).all():
        return None
    power = np.mean((x[N:] - sign * x[:-N]) ** 2, axis=1)
    change = np.array([*fold_periods(power, N).mean(axis=1), power[-N:].mean()])
    if len(x) >= 4 * N and change.max() < MIN_OVER_USUAL * np.median(change):
        return None
    lags, starts = list[int](), range(0, len(x) - N - L - max_shift, L)
    for start in starts:
        window = x[start : start + L] - x[start : start + L].mean(axis=0)
        shifted = np.stack([x[start + N + k : start + N + k + L] for k in range(-max_shift, max_shift + 1)])
        shifted = sign * (shifted - shifted.mean(axis=1, keepdims=True))
        inner = np.einsum("nc,knc->k", window, shifted)
        rho = inner / np.maximum(np.linalg.norm(window) * np.linalg.norm(shifted, axis=(1, 2)), 1e-300)
        lag = int(np.argmax(rho)) - max_shift if (1 - rho.max() < MAX_REMAINING_FRACTION * (1 - rho[max_shift])) else 0
        lags.append(lag if rho.max() > MIN_CORRELATION else max_shift + 1)
    valid = [lag for lag in lags if lag <= max_shift]
    shifts, changes = set(valid) - {0}, np.count_nonzero(np.diff(valid))
    if not (len(shifts) == 1 and 0 < changes <= 2 and changes < len(valid) - 1 and len(lags) - len(valid) <= 3):
        return None
    shift = shifts.pop()
    return shift, lags.index(shift) * L + N if lags[0] == 0 else starts[len(lags) - 1 - lags[::-1].index(shift)] + L


def _samples_text(samples: float, log: LogReport) -> str:
    rounded = round(samples, 2)
    seconds = "" if log.rate_hz is None else f" ({rounded / log.rate_hz:.6g} s)"
    return f"{rounded:.8g} samples{seconds}"
