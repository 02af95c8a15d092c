r"""Masks of samples that were not measured: stops, channels that hang or drop out, limits and steps of a converter.

A repetition whose torques stand still where those of others move, as at a stop, is left out.  A channel that hangs
repeats its last value exactly where others move, and one that drops out is exactly 0 where they are far from it.

Limits and steps of a converter are reported: clipping at the highest or lowest value, and quantisation with its noise.

.. math:: \sigma_q = q / \sqrt{12}

Where other noise is below half a step the error repeats with the signal, so that the scatter from period to period
does not show it (Widrow and Kollar, Quantization Noise, 2008).
"""

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, fold_periods, true_runs
from elastid.logs.repair import LogReport, detrend_repetitions, without_line

MASKED, STOPPED = "samples taken as missing", "stops"
CHECK_CELLS = "Check the column for empty cells and error values such as #N/A, or measure again"


# Limits that distinguish rest, constant or clipped channels, dropouts, quantisation and spikes from a signal.
WINDOWS, MIN_WINDOW = 20, 8  # windows in a repetition, least samples in a window
START_WINDOWS = 200  # windows in a log for the search of its first motion
# Least number of equal samples; least range of the other repetitions there, in scatters and in steps of the channel.
MIN_RUN, MIN_RANGE, MIN_STEPS = 20, 0.25, 4.0
LEAP = 10.0  # least leap to or from 0, relative to the 99 % quantile of the steps between samples
MIN_MOVING_FRACTION = 0.2  # least scatter of a moving signal at a phase, relative to its median scatter
# Largest scatter of a signal at rest relative to its typical scatter; fraction of a repetition that may be at rest.
MAX_STATIONARY_FRACTION = 0.1
# Fraction of outliers above which they are part of the signal; ratio to a typical distance, to the range of most
# samples, or to the median change between periods, above which a distance, a value or a change is a fault.
MAX_FRACTION, MIN_OVER_USUAL = 0.02, 3.0
MAX_MISSING_FRACTION = 1 / 3  # largest fraction of missing samples in a channel
# Limits of clipping and quantisation.
# Least quantisation noise relative to the signal, and least fraction of clipped samples, that are reported.
MIN_REPORTED_FRACTION = 2e-3
STEP_SAMPLES = 20_000  # samples for the search of the step
STEP_CANDIDATES = 5  # number of smallest differences of values, one of which is one to three steps
MAX_OFF_GRID = 0.05  # largest fraction of differences that are no whole number of steps
MIN_VALUES = 4  # fewer values are a commanded torque: a hammer, a binary or a ternary sequence
STEP_TOLERANCE = 0.02  # largest distance of a value from a whole number of steps, in steps
# Steps above this fraction of the range make flat peaks that are indistinguishable from clipped peaks.
MAX_STEP_FRACTION = 0.01
MIN_EQUAL = 2  # least number of equal consecutive samples at a limit; a peak has fewer
MIN_DEPARTURE = 0.05  # least distance from a limit between two visits, relative to the range
MIN_PLACES = 3  # least visits to a limit per period; a single peak of a period may be flat
MAX_CLIPPED_FRACTION = 0.05  # largest fraction of clipped samples for a usable response
EQUAL_TOLERANCE = 1e-9  # largest difference of equal values, relative to the range


def without_dropouts(signals: FloatArray, log: LogReport) -> FloatArray:
    """Mask (NaN) runs in which a channel of signals (n, c) is 0 after a leap, or constant while others move.

    A leap is longer than LEAP times the 99 % quantile of the steps between nonzero samples. Zeros begin and end with a
    leap; a constant run ends with a leap. Zeros without leaps are also dropouts if they are more frequent than by
    chance and the samples next to them have typical size: a signal that crosses 0 is small on both sides.
    """
    result, steps = np.copy(signals), np.abs(np.diff(signals, axis=0))
    moves = np.abs(signals[MIN_RUN:] - signals[:-MIN_RUN])  # changes over MIN_RUN samples: noise contributes little
    for c, (x, changes) in enumerate(zip(signals.T, steps.T, strict=True)):
        usual = changes[np.isfinite(changes) & (x[1:] != 0) & (x[:-1] != 0)]
        if not usual.size:
            continue
        q = step(x)
        min_leap = max(LEAP * float(np.quantile(usual, 0.99)), MIN_STEPS * q)
        beside = _leaps_of_zeros(x, q, max(float(np.median(usual)), 1e-300), min_leap)
        constant = [(a, b + 1) for a, b in true_runs(changes == 0, MIN_RUN - 1).tolist() if a > 0 and b < len(changes)]
        speed = np.nansum(np.delete(moves, c, axis=1), axis=0) / max(len(moves), 1) / MIN_RUN
        if sum(b - a for a, b in constant) > MAX_MISSING_FRACTION * len(x):  # piecewise constant torque
            constant, beside = [], {(a, b): leap for (a, b), leap in beside.items() if b - a < MIN_RUN}
        gaps = [(a, b) for (a, b), leap in beside.items() if leap > min_leap and (b - a < MIN_RUN or leap < np.inf)]
        for a, b in constant:
            travel = np.ptp(np.delete(signals[a + 2 : b - 2], c, axis=1), axis=0)
            if max(changes[b - 1], beside.get((a, b), 0)) > min_leap and np.any(travel > MIN_RANGE * (b - a) * speed):
                gaps.append((a + (x[a] != 0), b))
        gaps += true_runs(far_outside(x)).tolist()
        _mask_constant(result, c, gaps, "channels", log)
    return result


def _leaps_of_zeros(x: FloatArray, q: float, usual: float, min_leap: float) -> dict[tuple[int, int], float]:
    """Return the smaller leap at the ends of each run (start, end) of zeros of a signal (n,); infinite for dropouts.

    q: step of the converter.  usual: median step of the signal.  min_leap: smallest leap.
    """
    zeros, size = [(a, b) for a, b in true_runs(x == 0).tolist()], np.abs(x[np.isfinite(x) & (x != 0)])
    leaps = {(a, b): min(abs(x[a - 1]), abs(x[b])) for a, b in zeros if a > 0 and b < len(x)}
    by_chance = np.sum(size <= usual) * q / (2 * usual)
    min_size = max(MIN_RANGE * float(np.median(size)), MIN_STEPS * q)  # largest sample next to a zero crossing
    if len(leaps) >= MIN_PLACES * (1 + by_chance) and np.nanmedian([*leaps.values(), 0.0]) > min_size:
        return dict.fromkeys(zeros, np.inf) | {run: leap for run, leap in leaps.items() if leap > min_leap}
    return leaps


def far_outside(x: FloatArray) -> BoolArray:
    """Flag (n,) short runs of a signal (NaN if missing) far outside the range of the middle 96 % of its samples."""
    low, middle, high = np.nanquantile(x, [MAX_FRACTION, 0.5, 1 - MAX_FRACTION])
    limit = MIN_OVER_USUAL * (high - low) or np.inf  # no limit for a constant channel
    result = np.asarray(np.abs(x - middle) > limit)
    for start, end in true_runs(result, MIN_RUN):
        result[start:end] = False
    return result


def _mask_constant(signals: FloatArray, c: int, ranges: Iterable[tuple[int, int]], others: str, log: LogReport) -> None:
    """Mask (NaN) ranges of channel c of signals (n, c), and report them; others: the signals that vary there."""
    gaps = np.unique([i for start, end in ranges for i in range(start, end)]).astype(int)
    if gaps.size:
        signals[gaps, c] = np.nan
        text = f"{log.names[c]} is 0, constant or out of range for {gaps.size} samples while other {others} vary"
        log.report(MASKED, gaps.size, f"{text}, first at {log.time_of(gaps[0])}; treated as missing")


def samples_before_motion(torques: FloatArray) -> int:
    """Count samples of torques (n, d), NaN where missing, before the first window in which one of them moves."""
    width = max(MIN_WINDOW, len(torques) // START_WINDOWS)
    if len(torques) < 3 * width:
        return 0
    scatter = np.stack([_scatter(fold_periods(x, width)) for x in torques.T])
    # The largest may be a spike.
    scale = np.sort(np.where(np.isfinite(scatter), scatter, 0.0), axis=1)[:, -2, None]
    return int(np.argmax(np.any((scatter > MAX_STATIONARY_FRACTION * scale) & (scale > 0), axis=0))) * width


def _scatter(windows: FloatArray) -> FloatArray:
    """Compute the rms (...) of windows (..., width) without mean and slope; infinite where a sample is missing."""
    away = without_line(windows)
    return np.where(np.isfinite(away).all(axis=-1), np.sqrt(np.mean(away**2, axis=-1)), np.inf)


def without_standstill(signals: FloatArray, L: int, log: LogReport) -> FloatArray:
    """Mask (NaN) samples of signals (n, c) where a channel hangs, or drops to 0, and other repetitions do not."""
    result = np.copy(signals)
    is_constant = np.diff(signals, axis=0) == 0
    alike = is_constant.all(axis=1)
    for c, x in enumerate(signals.T):
        gaps = [(a, b) for a, b in true_runs(np.asarray(x == 0)) if a > 0 and b < len(x)]
        min_leap = LEAP * float(np.nanquantile(np.abs(np.diff(x)), 0.99)) if gaps else 0.0
        gaps = [(a, b) for a, b in gaps if min(abs(x[a - 1]), abs(x[b])) > min_leap]  # of many zeros few are leapt to
        gaps = [(a, b) for a, b in gaps if min((np.abs(o).min() for o in _repeats(x, a, b, L)), default=0) > min_leap]
        stops = true_runs(is_constant[:, c] & ~alike, MIN_RUN - 1).tolist()
        moving = max(MIN_RANGE * float(np.nanstd(x)), MIN_STEPS * step(x)) if stops else 0.0
        # The first value may be a measured one.
        gaps += [(a + 1, b + 1) for a, b in stops if min(map(np.ptp, _repeats(x, a, b + 1, L)), default=0) > moving]
        _mask_constant(result, c, gaps, "periods", log)
    return result


def _repeats(x: FloatArray, start: int, end: int, L: int) -> list[FloatArray]:
    return [x[a : a + end - start] for a in range(start % L, len(x) - end + start + 1, L) if a != start]


def without_stops(signals: FloatArray, torques: Sequence[int], L: int, log: LogReport) -> FloatArray:
    """Mask (NaN) each repetition of L samples of signals (n, c) whose torques are partly constant.

    torques: their columns.  The first repetition may hold the start; the last ones are cut off where they all stop.
    """
    P, width = len(signals) // L, min(L, max(MIN_WINDOW, L // WINDOWS))
    if P < 2:
        return signals
    u = signals[: P * L, list(torques)].T.reshape(-1, P, L)[:, :, : L // width * width]
    scatter = _scatter(u.reshape(*u.shape[:2], -1, width)).sum(axis=0)
    # The largest may be that of the start, or hold a spike.
    scale = np.sort(np.where(np.isfinite(scatter), scatter, 0.0), axis=0)[-2 if P > 2 else -1]
    moving = scale > MIN_MOVING_FRACTION * np.median(scale)
    bad = (scatter < MAX_STATIONARY_FRACTION * scale)[:, moving].sum(axis=1) > MAX_STATIONARY_FRACTION * moving.sum()
    bad[:1] = False
    if not bad.any():
        return signals
    numbers = ", ".join(str(p + 1) for p in np.flatnonzero(bad))
    text = f"repetitions {numbers} of {P} are discarded: their torques are partly constant, as at a stop"
    if P - bad.sum() < 2:
        samples = f"samples: [{log.first}, {log.first + int(np.argmax(bad)) * L}]"
        text += f"; two are needed. Measure again, or set {samples} with period: none"
        raise log.error("records/missing-samples", text)
    result, end = np.copy(signals), 1 + int(np.flatnonzero(~bad)[-1])
    for p in np.flatnonzero(bad):
        result[p * L : (p + 1) * L] = np.nan
    log.report(STOPPED, bad.sum(), text)
    return result if end == P else result[: end * L]


CLIPPED = "samples at a limit"


def step(x: FloatArray) -> float:
    """Return the step q of a signal (n,) whose finite values are whole steps apart but for spikes; else 0."""
    values, smallest_gap = np.unique(x[:: max(1, len(x) // STEP_SAMPLES)]), 1e-9 * np.nanmax(np.abs(x), initial=0)
    # Spikes off the grid are many among the different values of a coarse grid, but few among the changes. What is whole
    # steps of q is whole steps of a fraction of q, too.
    largest = 0.0
    for gaps in (np.diff(values), np.abs(np.diff(x[:STEP_SAMPLES]))):
        gaps = np.sort(gaps[gaps > smallest_gap])
        sizes = (map(partial(_exact_step, gaps), smallest / np.arange(1, 4)) for smallest in gaps[:STEP_CANDIDATES])
        largest = max([largest, *(next(filter(None, each), 0.0) for each in sizes)])
    return largest


def _exact_step(gaps: FloatArray, q: float) -> float:
    """Return the step near q of which almost all rising gaps (n,) are whole multiples; 0 without one."""
    for n_steps in (10, 100, 1000):  # text logs round each value: the sum of many steps is more exact
        near = gaps[: np.searchsorted(gaps, n_steps * q)]
        counts = np.round(near / q)
        q = float(near.sum() / counts.sum())
        if np.mean(np.abs(near / q - counts) < STEP_TOLERANCE) < 0.5:
            return 0.0
    counts = np.round(gaps / q)
    is_whole = np.abs(gaps / q - counts) < STEP_TOLERANCE
    return float(gaps[is_whole].sum() / counts[is_whole].sum()) if is_whole.mean() >= 1 - MAX_OFF_GRID else 0.0


def report_steps(signals: FloatArray, L: int, sign: int, log: LogReport) -> None:
    """Report each channel of signals (n, c) with a noise of steps that counts relative to its repeating part."""
    for c, name in enumerate(log.names):
        q, mean = step(signals[:, c]), detrend_repetitions(signals[:, c], L, sign).mean(axis=0)
        size, noise = float(mean.std()), q / np.sqrt(12)
        if q == 0 or np.ptp(mean) < (MIN_VALUES - 1.5) * q or noise < MIN_REPORTED_FRACTION * size:
            continue
        percent = f"{100 * noise / max(size, 1e-300):.2g} % of the signal"
        text = f"{name}: the resolution of {q:.4g} adds noise of {noise:.3g} rms, {percent}, which the scatter of the"
        log.report("quantised channels", 1, f"{text} periods can underestimate", "records/quantised")


def report_clipping(signals: FloatArray, L: int, log: LogReport) -> None:
    """Report each channel of finite signals (n, c) that meets its limits; DataError above 5 % of its samples."""
    for c, name in enumerate(log.names):
        x = signals[:, c]
        is_clipped = np.zeros(len(x), np.bool_)
        for start, end in true_runs(_at_limit(x), MIN_EQUAL):
            is_clipped[start:end] = True
        fraction, n_clipped = float(is_clipped.mean()), int(is_clipped.sum())
        if fraction < MIN_REPORTED_FRACTION or _count_visits(x, is_clipped) < MIN_PLACES * max(1, len(x) // L):
            continue
        text = f"{name}: {n_clipped} of {len(x)} samples ({100 * fraction:.2g} %) are at its limits of "
        text += f"{np.min(x):.4g} and {np.max(x):.4g}"
        if fraction > MAX_CLIPPED_FRACTION:
            text += "; it is clipped. Measure again with less torque or a wider range"
            raise log.error("records/clipped", text)
        log.report(CLIPPED, n_clipped, f"{text}; clipped there. Measure with less torque", "records/clipped")


def _at_limit(x: FloatArray) -> BoolArray:
    """Flag (n,) samples at a limit, none if they are too few to be reported or the steps too coarse."""
    low, high = np.min(x), np.max(x)
    near = EQUAL_TOLERANCE * (high - low)
    # Exactly 0 is rest, not a limit: of the force of a hammer under a force window.
    at_limit = (x != 0) & ((high - x <= near) | (x - low <= near))
    is_limit = at_limit.mean() >= MIN_REPORTED_FRACTION and step(x) <= MAX_STEP_FRACTION * (high - low)
    return np.asarray(at_limit & is_limit)


def _count_visits(x: FloatArray, is_clipped: BoolArray) -> int:
    span = np.ptp(x)
    is_away = (np.max(x) - x > MIN_DEPARTURE * span) & (x - np.min(x) > MIN_DEPARTURE * span)
    return int(np.sum(np.diff((is_clipped.astype(int) - is_away)[is_clipped | is_away]) == 2))
