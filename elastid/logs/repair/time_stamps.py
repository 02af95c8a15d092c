r"""Check of the time stamps of a log, and resampling of its signals to a uniform grid.

With uniform sampling, the stamps are on a line over the sample numbers, plus a delay by transport and queues,

.. math:: s_k = s_0 + T n_k + d_k, \quad d_k \ge 0, \qquad n_{k+1} - n_k - 1 \text{ samples lost}

with s_0 from the earliest stamps (Moon, Skelly and Towsley, INFOCOM 1999). T is the period at which the phases of the
stamps are most alike, also if samples are lost (Bartlett, J. R. Stat. Soc. B 25, 1963).

With non-uniform sampling, the signal is the band-limited signal that fits all samples by weighted least squares,

.. math:: \min_x \sum_i w_i \Bigl(s(t_i) - \sum_j x_j \varphi(t_i / T_k - j)\Bigr)^2, \quad
    w_i = \tfrac12 (t_{i+1} - t_{i-1})

with phi a windowed sinc (`resampling`). T_k is the longest moving average of the steps, so that samples are nowhere
sparser than knots (Feichtinger, Groechenig and Strohmer, Numer. Math. 69, 1995). The band ends at 0.45 / T_k.
LSMR solves for x (Fong and Saunders, SIAM J. Sci. Comput. 33, 2011).
"""

from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.logs.repair import MAX_WRONG_FRACTION, LogReport
from elastid.logs.repair.clock_drift import MAX_CLOCK_ERROR, MAX_GRID_DEVIATION
from elastid.logs.repair.interpolation import MAX_BRIDGED
from elastid.logs.repair.missing import resampled_with_gaps
from elastid.logs.repair.resampling import HALF_WIDTH, PASSBAND, RESAMPLED, resample_at, sinc_weights

JITTER, GAPS, SET_BACK = "time stamps with jitter", "samples missing in time", "clock set"
# Half the last digit of rounded stamps, and the tilt of the fitted line where halves are rounded up, then down.
MAX_ROUNDING = 0.8
# Longer steps, in medians, are gaps.
MIN_GAP = 1.9
# Knots per sample at rate_hz, at least; fewer leave too little of the band that the rate promises.
MIN_RATE_FRACTION = 0.75
# Residuals at the stamps over residuals on an even grid, below which the samples were taken at the stamps; knots per
# sample of this test: with fewer, the error of the band limit exceeds the effect of the jitter.
MAX_ROUGHNESS, TEST_FRACTION = 0.8, 0.9
# Samples at rate_hz over those of the log, or the inverse: beyond, stamps are not in s, or jump.
MAX_RATE_RATIO = 20.0
# Smallest mean resultant length of the phases of uniform stamps (1: no jitter); stamps for the first period estimate.
MIN_CONCENTRATION, FIRST_STAMPS = 0.25, 512
# Knots that are solved for together, and those beyond either end that are solved for and not used.
_KNOTS, _OVERLAP = 16384, 4 * HALF_WIDTH
_TOLERANCE = 1e-8  # below the noise of any sensor
# Damping of the least squares: knots beyond the ends are barely constrained by any sample, and noise of 1e-3 would
# become more than the signal in the last samples. Within the record it costs the square of it, 1e-6 of a signal.
_DAMPING = 1e-3
# Stamps among which the last digit of one is nonzero.
LAST_STAMPS = 20


@dataclass(frozen=True)
class StampLine:
    """Line through stamps over the sample numbers rows (n,): its start, and the delays (n,) of the stamps, in s.

    rounding_s: decimal resolution of the stamps, 0 for more than nine decimals.
    """

    rows: IntArray
    rate_hz: float
    start_s: float
    delays_s: FloatArray
    rounding_s: float

    @property
    def times_s(self) -> FloatArray:
        """Instants (n,) of the samples."""
        return self.start_s + self.rows / self.rate_hz

    @property
    def is_exact(self) -> bool:
        """True if no stamp is off the line by more than its rounding, or by a deviation that does no harm."""
        return bool(np.ptp(self.delays_s) <= 2 * max(MAX_GRID_DEVIATION / self.rate_hz, MAX_ROUNDING * self.rounding_s))

    @property
    def concentration(self) -> float:
        """Mean resultant length of the phases of the stamps."""
        return float(np.abs(np.exp(2j * np.pi * self.rate_hz * self.delays_s).mean()))

    @property
    def is_even(self) -> bool:
        """True if the sampling may be even: stamps jitter by less than a sample, or are late by whole samples."""
        is_near = float(np.ptp(self.delays_s)) * self.rate_hz < 2
        return self.is_exact or is_near or self.concentration > MIN_CONCENTRATION


def describe_steps(time_s: FloatArray) -> str:
    """Describe shortest, median and longest step between stamps (n,), and the mean rate."""
    shortest, median, longest = (f"{1e3 * f(np.diff(time_s)):.6g}" for f in (np.min, np.median, np.max))
    mean_hz = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    return f"steps of {shortest} to {longest} ms, median {median} ms, mean rate {mean_hz:.6g} Hz"


def stamp_line(time_s: FloatArray) -> StampLine | None:
    """Fit the line of rising stamps (n,) of an even sampling, of which samples may be lost; None without one."""
    t, lag = time_s - time_s[0], min(FIRST_STAMPS, len(time_s) // 2)  # seconds since 1970 leave no digits
    step_s = float(np.median(t[lag:] - t[: len(t) - lag])) / max(lag, 1)
    if not step_s > 0 or np.any(np.diff(t) < 0):
        return None
    line = _fit_line(t, np.arange(len(t)))
    if not line.is_exact:
        other = _fit_line(t, _number_samples(t, _find_period(t, step_s)))
        line = other if other.concentration > max(line.concentration, MIN_CONCENTRATION) else line
    return replace(line, start_s=line.start_s + float(time_s[0])) if line.is_even else None


def even_grid(time_s: FloatArray) -> tuple[IntArray, float] | None:
    """Return the grid row of each stamp (n,) and the rate, Hz, of their uniform grid; None without such a grid.

    Rounded stamps, such as alternating steps of 2 and 3 ms at 400 Hz, have a grid.
    """
    line = stamp_line(time_s)
    return (line.rows, line.rate_hz) if line is not None and line.is_exact else None


def _fit_line(t: FloatArray, rows: IntArray) -> StampLine:
    step, rounding_s = float(np.polyfit(rows.astype(np.float64), t, 1)[0]), _resolution(t)
    late = t - step * rows
    start, end = np.quantile(late, [MAX_WRONG_FRACTION, 1 - MAX_WRONG_FRACTION]).tolist()
    mean, spread = float(late.mean()), float(np.ptp(late))
    # Queues cause skewed delays: the grid starts at the earliest stamps. It starts at the mean if jitter is symmetric.
    start = mean if spread < step and 2 * (mean - start) > end - mean else start + min(rounding_s, spread) / 2
    return StampLine(rows, 1 / step, start, late - start, rounding_s)


def _find_period(t: FloatArray, step_s: float) -> float:
    """Find the period at which the phases of stamps (n,) are most alike: at most their mean step, and near it."""
    first = min(FIRST_STAMPS, len(t))
    ratio = np.arange(0.95, 2.2, 0.25 / first)
    concentration = np.abs(np.exp(2j * np.pi * np.outer(ratio / step_s, t[:first])).mean(axis=1))
    period_s = step_s / float(ratio[np.argmax(concentration - 0.2 * np.abs(ratio - 1))])
    for n in np.minimum(first * 2 ** np.arange(int(np.log2(len(t) / first)) + 2), len(t)).tolist():
        halves = t[: n // 2], t[n // 2 : n]
        phase_1, phase_2 = (np.exp(2j * np.pi / period_s * half).mean() for half in halves)
        turns = float(np.angle(phase_2 * phase_1.conj())) / (2 * np.pi)
        period_s *= 1 + turns * period_s / float(halves[1].mean() - halves[0].mean())
    return period_s


def _number_samples(t: FloatArray, period_s: float) -> IntArray:
    """Number the samples of stamps (n,): a sample is lost where all later stamps are late by a period."""
    k = np.arange(len(t))
    phase = float(np.angle(np.exp(2j * np.pi / period_s * t).mean())) / (2 * np.pi)
    n_missing = np.minimum.accumulate(np.round(t / period_s - phase - k)[::-1])[::-1]
    return np.asarray(k + (n_missing - n_missing[0]), np.int64)


def _resolution(time_s: FloatArray) -> float:
    """Find the decimal step of the last stamps; 0 where they have more than nine digits.

    It is the coarsest: loggers with a fixed number of significant digits write fewer decimals as time goes on.
    """
    last = time_s[-LAST_STAMPS:, None] * 10.0 ** np.arange(10)
    is_whole = np.all(np.abs(last - np.round(last)) < 1e-3, axis=0)
    return 10.0 ** -int(np.argmax(is_whole)) if is_whole.any() else 0.0


def sampling_times(
    time_s: FloatArray, signals: FloatArray, log: LogReport, has_clocks: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return the instants (n,) of the samples of signals (n, c) by their stamps (n,), and the samples in their order.

    The instants are on the line of uniform stamps if these are exact, or if the signals are not smoother at stamps with
    jitter or bursts.  has_clocks: rounded stamps delay the signals relative to other signals.  Rows are sorted by their
    stamps.  DataError for missing stamps and for many that decrease.
    """
    time_s, signals = sort_stamps(time_s, signals, log, has_clocks)
    line = stamp_line(time_s) if len(time_s) > 2 else None
    if line is None or not (line.is_exact or _is_smoother_on(line, time_s, signals)):
        return time_s, signals
    text, away_ms = f"time stamps of {', '.join(log.names)}", 1e3 * float(np.ptp(line.delays_s))
    if not line.is_exact:
        text += f" jitter by up to {away_ms:.3g} ms about a uniform {line.rate_hz:.6g} Hz grid"
        text += "; the signals are smoother on this grid, so that elastid assumes uniform sampling"
        log.report(JITTER, len(time_s), text)
    elif has_clocks and away_ms * line.rate_hz > 2e3 * MAX_GRID_DEVIATION:
        text += f" are rounded: the delay to other clocks is uncertain by +-{away_ms / 2:.2g} ms, "
        text += "an error that the intervals of inertia and viscous friction do not include. Log more decimals"
        log.note("records/clock", text)
    return line.times_s, signals


def resample_to_rate(
    time_s: FloatArray, signals: FloatArray, rate_hz: float, log: LogReport, begin_s: float | None = None
) -> FloatArray:
    """Bring signals (n, c) at instants (n,) to rate_hz from the first one on, with rows of NaN for gaps.

    Samples on an even grid at rate_hz, within the tolerance of quartz clocks, are returned unchanged. begin_s: common
    start of all clocks of a file; the error of the grid must then stay small up to the last sample.
    Raises DataError where the time does not increase, and where long steps leave too little of the band.
    """
    if len(time_s) < 3 or time_s[-1] == time_s[0]:
        raise log.error("records/clock", "its time does not increase. Name another channel as time, or omit time")
    begin, time_s = 0.0 if begin_s is None else begin_s - float(time_s[0]), time_s - time_s[0]
    if not 1 / MAX_RATE_RATIO < (len(time_s) - 1) / (time_s[-1] * rate_hz) < MAX_RATE_RATIO:
        name = log.time_of(int(np.argmax(np.diff(time_s))))
        text = f"its {len(time_s)} time stamps have {describe_steps(time_s)}, the longest after {name}; rate_hz is"
        advice = "Give the time in s, correct rate_hz, or exclude a jump by samples"
        raise log.error("records/clock", f"{text} {rate_hz:g}. {advice}")
    if (grid := even_grid(time_s)) is None:
        return _at_instants(time_s - begin, signals, rate_hz, log)
    rows, grid_hz = grid
    _check_band(grid_hz, rate_hz, time_s, log)
    first = 0.0 if begin_s is None else (begin - float(np.mean(time_s - rows / grid_hz))) * grid_hz
    tolerance = MAX_CLOCK_ERROR if begin_s is None else MAX_GRID_DEVIATION / len(rows)
    result = np.full((int(rows[-1]) + 1, signals.shape[1]), np.nan)
    result[rows] = signals
    _report_gaps(len(result) - len(signals), np.flatnonzero(np.diff(rows) > 1), log)
    if abs(grid_hz / rate_hz - 1) <= tolerance and abs(first - round(first)) <= MAX_GRID_DEVIATION:
        return result[round(first) :]
    _report_resampling(time_s, len(result), rate_hz, grid_hz, log)
    n = int((len(result) - 1 - first) * rate_hz / grid_hz + 1e-6) + 1
    times = first + np.arange(n, dtype=np.float64) * (grid_hz / rate_hz)
    return resampled_with_gaps(result, times, min(1.0, rate_hz / grid_hz), log)


def sort_stamps(
    time_s: FloatArray, signals: FloatArray, log: LogReport, has_clocks: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Sort stamps (n,) and their signals (n, c).

    A jump of a clock that was set becomes a gap of unknown length, or no gap with has_clocks, because the signals of
    other clocks continue.  Raises DataError for missing stamps and for too many decreasing steps.
    """
    if not np.isfinite(time_s).all():
        name = log.time_of(np.flatnonzero(~np.isfinite(time_s))[0])
        raise log.error("records/clock", f"the time is missing at {name}. Exclude that part by samples")
    twice = np.flatnonzero(np.diff(time_s) == 0) + 1
    if len(twice) > 0 and np.array_equal(signals[twice], signals[twice - 1], equal_nan=True):
        text = f"{len(twice)} rows repeat the time of the previous row, the first at {log.time_of(twice[0])}; discarded"
        log.report("rows with the stamp of another", len(twice), text)
        time_s, signals = np.delete(time_s, twice), np.delete(signals, twice, axis=0)
    jumps = without_jumps(time_s)[1]
    if not len(jumps):
        return time_s, signals
    name = log.time_of(jumps[0])
    if len(jumps) > max(1.0, MAX_WRONG_FRACTION * len(time_s)):
        text = f"the time runs backwards or jumps in {len(jumps)} of {len(time_s) - 1} steps, the first at {name}"
        raise log.error("records/clock", f"{text}. Sort the rows by time, or exclude that part by samples")
    order = np.argsort(time_s, kind="stable")
    steps = np.diff(time_s[order])
    if steps.min() > np.median(steps) / 2 and np.sum(steps > MIN_GAP * np.median(steps)) < len(jumps):
        text = f"{len(jumps)} rows were not in time order, the first at {name}; sorted"
        log.report("rows sorted by time", len(jumps), text)
        return time_s[order], signals[order]
    gap = "elastid assumes no lost message" if has_clocks else "treated as a gap"
    log.report(SET_BACK, len(jumps), f"the time jumps at {name}, as if the clock was set; {gap}")
    return without_jumps(time_s, 1 if has_clocks else MAX_BRIDGED + 2)[0], signals


def without_jumps(t: FloatArray, gap: int = 1) -> tuple[FloatArray, IntArray]:
    """Return stamps (n,) without jumps of the clock, and the index (k,) of the sample after each jump.

    A jump is a decrease, or an increase by more than MAX_RATE_RATIO times the sum of all other increases.  gap: length
    of a jump after the correction, in median steps.
    """
    rises = np.diff(t, prepend=t[:1])
    other_rises = rises[rises > 0].sum() - rises
    is_jump = (rises < 0) | ((rises > MAX_RATE_RATIO * other_rises) & (other_rises > 0))
    steps = rises[(rises > 0) & ~is_jump]
    rises[is_jump] = gap * float(np.median(steps)) if steps.size else 0.0
    return t[:1] + np.cumsum(rises), np.flatnonzero(is_jump)


def _is_smoother_on(line: StampLine, time_s: FloatArray, signals: FloatArray) -> bool:
    """Return False if signals (n, c) are clearly smoother at their stamps (n,), because their sampling was uneven."""
    some = slice(0, _KNOTS // 4)  # each channel takes seconds
    rows_s, knot_hz = line.times_s[some], TEST_FRACTION * line.rate_hz
    at_stamps, on_rows = (_fit_knots(t - t[0], signals[some], np.zeros(1), knot_hz)[1] for t in (time_s[some], rows_s))
    # Mean over all channels: a torque with power above the band is equally rough at both.
    return bool(np.exp(np.mean(np.log(np.maximum(at_stamps, 1e-12) / np.maximum(on_rows, 1e-12)))) > MAX_ROUGHNESS)


def _report_gaps(count: int, gaps: IntArray, log: LogReport) -> None:
    if count:
        text = f"{count} samples are missing in {gaps.size} gaps of the stamps of {', '.join(log.names)}"
        log.report(GAPS, count, f"{text}, the first after {log.time_of(gaps[0])}")


def _report_resampling(
    time_s: FloatArray, n: int, rate_hz: float, knot_hz: float, log: LogReport, error: str = ""
) -> None:
    text = f"the time of {', '.join(log.names)} has {describe_steps(time_s)}; resampled to {rate_hz:g} Hz, exact up to"
    log.report(RESAMPLED, n, f"{text} {PASSBAND * min(knot_hz, rate_hz):.3g} Hz{error}")


def _check_band(knot_hz: float, rate_hz: float, time_s: FloatArray, log: LogReport) -> None:
    """Raise DataError if the rate of the knots of stamps (n,) is too low for the band of rate_hz."""
    if knot_hz < MIN_RATE_FRACTION * rate_hz:
        unit = 10.0 ** (np.floor(np.log10(knot_hz)) - 1)
        advised_hz = np.floor(knot_hz / unit + 1e-9) * unit
        text = f"time stamps have {describe_steps(time_s)}, sufficient up to {PASSBAND * knot_hz:.3g} Hz; rate_hz"
        remedy = f"{rate_hz:g} needs {PASSBAND * rate_hz:.3g} Hz"
        raise log.error("records/clock", f"{text} {remedy}. Set rate_hz: {advised_hz:g}")


def _at_instants(time_s: FloatArray, signals: FloatArray, rate_hz: float, log: LogReport) -> FloatArray:
    """Resample signals from instants (n,) in s to a grid from 0 on."""
    steps_s = np.diff(time_s)
    if not np.median(steps_s) > 0:
        text = f"{int((steps_s <= 0).sum())} of {len(time_s)} time stamps do not increase"
        raise log.error("records/clock", f"{text}. Log each sample once")
    gaps = np.flatnonzero(steps_s > MIN_GAP * np.median(steps_s))
    knot_steps = np.delete(steps_s, gaps)
    row = min(8, len(knot_steps))  # steps, whose mean no knots are closer than
    knot_hz = 1 / float(np.convolve(knot_steps, np.full(row, 1 / row), mode="valid").max())
    _check_band(knot_hz, rate_hz, time_s, log)
    grid_s = np.arange(int(time_s[-1] * rate_hz + 1e-6) + 1) / rate_hz
    result, ratio = _fit_knots(time_s, signals, grid_s, min(knot_hz, rate_hz))
    in_gaps = np.isin(np.searchsorted(time_s, grid_s, side="right") - 1, gaps)
    result[in_gaps] = np.nan
    error = f". Residual/signal rms = {ratio.max(initial=0.0):.2g} (noise, or higher frequencies)"
    _report_resampling(time_s, len(result), rate_hz, knot_hz, log, error)
    _report_gaps(int(in_gaps.sum()), gaps, log)
    return result


def _fit_knots(
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
            result[rows, i] = resample_at(knots[:, None], grid[rows] - low)[:, 0]
            squares[i] += float(np.nansum((s[inside] - resample_at(knots[:, None], t[inside] - low)[:, 0]) ** 2))
    has_samples = np.isfinite(signals).any(axis=0)
    size = np.maximum(np.nanstd(signals[:, has_samples], axis=0), 1e-300)
    ratio = np.zeros(signals.shape[1])
    ratio[has_samples] = np.sqrt(squares[has_samples] / len(signals)) / size
    return result, ratio


def _knots(t: FloatArray, s: FloatArray, low: int, high: int) -> FloatArray:
    """Solve for x (high - low + 1,) at whole t from low to high, of samples s (n,) at instants t (n,)."""
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import lsmr

    start = np.interp(np.arange(low, high + 1.0), t, s)
    nearest, weights = sinc_weights(t - low)
    columns = np.clip(nearest[:, None] + np.arange(-HALF_WIDTH, HALF_WIDTH + 1), 0, high - low)
    row_starts = np.arange(0, columns.size + 1, columns.shape[1])
    K = csr_array((weights.ravel(), columns.ravel(), row_starts), shape=(len(t), high - low + 1))
    w = np.sqrt(np.clip(np.gradient(t), 1e-3, 1.0))
    correction = lsmr(K * w[:, None], w * (s - K @ start), _DAMPING, _TOLERANCE, _TOLERANCE, maxiter=60)[0]
    return np.asarray(start + correction)
