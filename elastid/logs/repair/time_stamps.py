r"""Time stamps of a log: judged, and its samples brought from their instants to an even grid.

The signal is the band-limited one that fits all samples in the sense of least squares,

.. math:: \min_x \sum_i w_i \Bigl(s(t_i) - \sum_j x_j \varphi(t_i / T_k - j)\Bigr)^2, \quad
    w_i = \tfrac12 (t_{i+1} - t_{i-1})

with phi a windowed sinc (`resampling`) and T_k the longest mean of some steps in a row, so that samples are nowhere
fewer than knots (Feichtinger, Groechenig and Strohmer, Numer. Math. 69, 1995); it holds frequencies up to 0.45 / T_k.
LSMR solves for x (Fong and Saunders, SIAM J. Sci. Comput. 33, 2011).
"""

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.logs.repair import MAX_WRONG_FRACTION, Log
from elastid.logs.repair.clock_drift import MAX_CLOCK_ERROR, MAX_GRID_DEVIATION
from elastid.logs.repair.interpolation import MAX_BRIDGED
from elastid.logs.repair.resampling import HALF_WIDTH, PASSBAND, RESAMPLED, at_times, kernel

JITTER = "time stamps with jitter"
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


def on_grid(
    time_s: FloatArray, signals: FloatArray, rate_hz: float, log: Log, begin_s: float | None = None
) -> FloatArray:
    """Bring signals (n, c) to rate_hz from the first stamp on, with rows of NaN for gaps of the stamps (n,).

    Samples on an even grid at rate_hz, within the tolerance of quartz clocks, are returned unchanged. begin_s: common
    start of all clocks of a file; the error of the grid must then stay small up to the last sample.
    Rows in another order than their stamps are sorted.  A clock that was set back leaves a gap of unknown length.
    Raises DataError where stamps are missing, where many fall, and where long steps leave too little of the band.
    """
    time_s, signals = rising(time_s, signals, log)
    if len(time_s) < 3 or time_s[-1] == time_s[0]:
        raise log.error("records/clock", "its time does not increase. Name another channel as time, or omit time")
    begin, time_s = 0.0 if begin_s is None else begin_s - float(time_s[0]), time_s - time_s[0]
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
        first = 0.0 if begin_s is None else (begin - float(np.mean(time_s - rows / grid_hz))) * grid_hz
        is_whole = abs(first - round(first)) <= MAX_GRID_DEVIATION
        allowed = MAX_CLOCK_ERROR if begin_s is None else MAX_GRID_DEVIATION / len(rows)
        if abs(grid_hz / rate_hz - 1) <= allowed and is_whole:
            count, result = int(rows[-1]) + 1 - len(signals), np.full((int(rows[-1]) + 1, signals.shape[1]), np.nan)
            result[rows] = signals
            _report_gaps(count, np.flatnonzero(np.diff(rows) > 1), log)
            return result[round(first) :]
        time_s, begin = rows / grid_hz, first / grid_hz
    return _at_instants(time_s - begin, signals, rate_hz, log)


def rising(time_s: FloatArray, signals: FloatArray, log: Log) -> tuple[FloatArray, FloatArray]:
    """Sort stamps (n,) and their signals (n, c).

    Raises DataError for missing stamps, and for more falling steps than of single faults.
    """
    if not np.isfinite(time_s).all():
        place = log.time_of(np.flatnonzero(~np.isfinite(time_s))[0])
        raise log.error("records/clock", f"the time is missing at {place}. Exclude that part by samples")
    twice = np.flatnonzero(np.diff(time_s) == 0) + 1
    is_copy = len(twice) > 0 and np.array_equal(signals[twice], signals[twice - 1], equal_nan=True)
    if is_copy or (0 < len(twice) <= max(1.0, MAX_WRONG_FRACTION * len(time_s)) and even_grid(time_s) is None):
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
    return time_s[0] + np.cumsum(rises), signals


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
    at_stamps, on_rows = (_fit(t[some], signals[some], t[:1], knot_hz)[1] for t in (time_s, step * rows))
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
    if not np.median(steps_s) > 0:
        text = f"{int((steps_s <= 0).sum())} of {len(time_s)} rows are not after the previous row"
        raise log.error("records/clock", f"{text}. Log each sample once")
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
    result, ratio = _fit(time_s, signals, grid_s, knot_hz)
    in_gaps = np.isin(np.searchsorted(time_s, grid_s, side="right") - 1, gaps)
    result[in_gaps] = np.nan
    text = (
        f"its time has {steps}; resampled to {rate_hz:g} Hz, exact up to {PASSBAND * knot_hz:.3g} Hz. "
        f"Residual/signal rms = {ratio.max(initial=0.0):.2g} (noise, or faster motion)"
    )
    log.report(RESAMPLED, len(result), text)
    _report_gaps(int(in_gaps.sum()), gaps, log)
    return result


def _fit(time_s: FloatArray, signals: FloatArray, grid_s: FloatArray, knot_hz: float) -> tuple[FloatArray, FloatArray]:
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
    nearest, weights = kernel(t - low)
    columns = np.clip(nearest[:, None] + np.arange(-HALF_WIDTH, HALF_WIDTH + 1), 0, high - low)
    row_starts = np.arange(0, columns.size + 1, columns.shape[1])
    K = csr_array((weights.ravel(), columns.ravel(), row_starts), shape=(len(t), high - low + 1))
    w = np.sqrt(np.clip(np.gradient(t), 1e-3, 1.0))
    correction = lsmr(K * w[:, None], w * (s - K @ start), _DAMPING, _TOLERANCE, _TOLERANCE, maxiter=60)[0]
    return np.asarray(start + correction)
