"""The repairs of a log: its period in whole samples, its clock, and missing samples (NaN), which are filled.

Samples that other repetitions contradict are missing, too (`repair.outliers`). They are interpolated from other
repetitions and from the samples beside the gap, without a period from the latter alone (`repair.interpolation`). A
signal that does not repeat is refused; limits and steps are reported as logged.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, true_runs
from elastid.logs.repair import MAX_WRONG_FRACTION, LogReport, interpolate_linearly
from elastid.logs.repair.clock_drift import resample_to_generator
from elastid.logs.repair.interpolation import MAX_BRIDGED, interpolations, period_noise
from elastid.logs.repair.masks import (
    CHECK_CELLS,
    MAX_MISSING_FRACTION,
    MAX_STATIONARY_FRACTION,
    report_clipping,
    report_steps,
    step,
    without_standstill,
    without_stops,
)
from elastid.logs.repair.outliers import outlier_count_text, without_spikes
from elastid.logs.repair.periodicity import MIN_PERIODS, grid_samples
from elastid.logs.repair.resampling import resample_at

MAX_ERROR_OVER_NOISE = 5.0  # of the interpolation of a gap, else its repetition is left out
FILLED = "missing samples filled"
REPLACED = "interpolated from other periods and adjacent samples"
INTERPOLATED = "missing samples interpolated"


def fill_gaps(signals: FloatArray, L: int, sign: int, log: LogReport) -> FloatArray:
    """Interpolate the missing samples (NaN) of the whole repetitions of signals (n, c).

    A repetition that lacks more than a tenth of a channel, or whose gap no interpolation predicts to within its noise,
    is left out.  Raises DataError where more than a third of a channel, or a phase in all repetitions, is missing, or
    fewer than two repetitions remain.
    """
    P = len(signals) // L
    periodic = signals[: P * L]
    good = np.isfinite(periodic)
    if good.all():
        return periodic
    result, unpredictable = np.copy(periodic), set[int]()
    for c in np.flatnonzero(~good.all(axis=0)):
        count, text = _missing_samples(good[:, c], log, int(c))
        if count > MAX_MISSING_FRACTION * len(good):
            raise log.error("records/missing-samples", f"{text}. {CHECK_CELLS}, or exclude them with samples")
        result[:, c], further = _interpolate(periodic[:, c], L, sign, log, text)
        unpredictable |= further
        outliers = outlier_count_text(log.names[c], count, len(good))
        is_reported = any(note.text.startswith(outliers) for note in log.findings.notes)
        log.report(FILLED, count, "" if is_reported else f"{text}; {REPLACED}")
    fraction = (~good).reshape(P, L, -1).mean(axis=1).max(axis=1)
    discarded = sorted(unpredictable.union(np.flatnonzero(fraction > MAX_STATIONARY_FRACTION).tolist()))
    if not discarded:
        return result
    numbers = ", ".join(str(p + 1) for p in discarded)
    text = f"repetitions {numbers} of {P} lack more than 10 % of a channel, or noise prevents interpolation"
    if P - len(discarded) < 2:
        text += ", and two complete repetitions are needed. Measure again, or exclude the faulty part with samples"
        raise log.error("records/missing-samples", text)
    log.report("repetitions left out", len(discarded), f"{text}. They are discarded")
    log.findings.discarded_periods += discarded
    return result


def _interpolate(x: FloatArray, L: int, sign: int, log: LogReport, text: str) -> tuple[FloatArray, set[int]]:
    """Interpolate a signal (P L,); return also repetitions with a long gap that is not predictable within noise."""
    result, noisy = np.copy(x), set[int]()
    limit = MAX_ERROR_OVER_NOISE * np.hypot(period_noise(x, L, sign), step(x) / np.sqrt(12))
    for at, gap in interpolations(x, L, sign):
        n = at.stop - at.start
        if gap is None:
            text += f", and no other period has the {n} from {log.time_of(at.start)} on"
            raise log.error("records/missing-samples", f"{text}. Measure again, or exclude them with samples")
        result[at] = gap.values
        if n > MAX_BRIDGED and gap.error > limit:
            noisy |= set(range(at.start // L, (at.stop - 1) // L + 1))
    return result, noisy


def _missing_samples(good: BoolArray, log: LogReport, c: int) -> tuple[int, str]:
    """Return the number of missing samples of a channel, and a text that describes them."""
    gaps = np.flatnonzero(~good)
    text = f"{log.names[c]}: {gaps.size} of {len(good)} samples {'is' if gaps.size == 1 else 'are'} missing"
    return gaps.size, f"{text}, the first is {log.time_of(gaps[0])}"


def bridge_short_gaps(signals: FloatArray, log: LogReport, straight: Mapping[int, int] | None = None) -> FloatArray:
    """Interpolate short gaps (NaN), apart from the ends, in signals (n, c) without a period.

    straight: longest gap, in samples, for linear interpolation by column.  Channels with more than a third missing
    samples are unchanged.
    """
    result = np.copy(signals)
    for c in np.flatnonzero(np.isnan(signals).mean(axis=0) <= MAX_MISSING_FRACTION).tolist():
        x = signals[:, c]
        for at, gap in interpolations(x, len(x), 1):
            if at.start > 1 and at.stop < len(x) - 1 and (gap or at.stop - at.start <= (straight or {}).get(c, 0)):
                result[at, c] = gap.values if gap else interpolate_linearly(x)[at]
        bridged_rows = np.isfinite(result[:, c]) & ~np.isfinite(x)
        if bridged_rows.any():
            count, text = _missing_samples(~bridged_rows, log, c)
            log.report(INTERPOLATED, count, f"{text}: interpolated between their neighbours")
    return result


def bridge_gaps(signals: FloatArray, log: LogReport, max_fraction: float = MAX_WRONG_FRACTION) -> FloatArray:
    """Interpolate short gaps (NaN) of signals (n, c) without a period.

    Raises DataError for long or many gaps; the error states the longest range of the log without gaps.
    """
    result, good = bridge_short_gaps(signals, log), np.isfinite(signals)
    is_refused = ~np.isfinite(result).all(axis=0) | (np.mean(~good, axis=0) > max_fraction)
    for c in np.flatnonzero(is_refused)[:1]:
        _, text = _missing_samples(good[:, c], log, int(c))
        first, last = map(log.number, max(true_runs(np.asarray(good.all(axis=1))), key=np.ptp, default=(0, 0)))
        text += ", and a record without a period cannot be interpolated. Use the longest range without gaps"
        raise log.error("records/missing-samples", f"{text} (samples: [{first}, {last}])" + ", or measure again")
    return result


def resampled_with_gaps(signals: FloatArray, times: FloatArray, band: float, log: LogReport) -> FloatArray:
    """Resample signals (n, c) without a period at times (m,) in samples; NaN near gaps that are not short."""
    return _with_missing(resample_at(_with_flags(bridge_short_gaps(signals, log)), times, None, band), signals.shape[1])


def repair(
    signals: FloatArray, roles: Mapping[str, Sequence[int]], period: float, half_wave: bool, log: LogReport,
    check: Callable[[FloatArray], None],
) -> FloatArray:  # fmt: skip
    """Repair signals (n, c), some samples NaN, to whole repetitions of a period, of half of one if half_wave.

    roles: the columns of r, u and y, before all others, which need not repeat.  check: refuses drivers (n, d) that are
    not periodic.  DataError without a repair.
    """
    N, drivers = grid_samples(period, half_wave), np.array(roles["r"] or roles["u"])
    L, sign = (N // 2, -1) if half_wave else (N, 1)
    complete = without_stops(_with_integer_period(signals, period, N, L, log), roles["u"], L, log)
    with_gaps = without_standstill(complete, L, log)
    stack = _with_flags(with_gaps)
    clock = resample_to_generator(stack, stack[:, drivers], N, log)
    on_clock = with_gaps if clock is stack else _with_missing(clock, signals.shape[1])
    check(on_clock[:, drivers])
    repeating = replace(log, names=log.names[: sum(map(len, roles.values()))])
    full = fill_gaps(without_spikes(on_clock, L, sign, repeating), L, sign, log)
    as_logged = full if clock is stack else _fill_linearly(complete)
    report_clipping(as_logged, L, repeating)
    report_steps(as_logged, L, sign, repeating)
    return full


def repair_without_period(signals: FloatArray, log: LogReport) -> FloatArray:
    """Interpolate single gaps of signals (n, c), some samples NaN; DataError where gaps are longer."""
    full, n = bridge_gaps(signals, log), len(signals)
    report_clipping(full, n, log)
    report_steps(full, n, 1, log)
    return full


def _with_integer_period(signals: FloatArray, period: float, N: int, L: int, log: LogReport) -> FloatArray:
    """Resample to N samples in a period; complete a second repetition of L that lacks its end only."""
    result = signals
    if period != N:
        # A period of a fraction of samples is interpolated so that it has N of them.
        times = np.arange(int((len(signals) - 1) * N / period) + 1, dtype=np.float64) * (period / N)
        result = _with_missing(resample_at(_with_flags(signals), times, period, min(1.0, N / period)), signals.shape[1])
        log.report("periods brought to whole samples", 1, f"a period of {period:.8g} samples is brought to {N}")
    n, n_missing = len(result), 2 * L - len(result)
    if n < MIN_PERIODS * L or n_missing <= 0:
        return result
    text = f"{n} samples are {n / L:.2f} repetitions of {L}. The {n - L} repeated samples give the noise; the missing"
    end = np.full((n_missing, signals.shape[1]), np.nan)
    log.report("incomplete periods", 1, f"{text} {n_missing}" + " are copied from repetition 1")
    return np.concatenate([result, end])


def _with_flags(signals: FloatArray) -> FloatArray:
    """Bridge missing samples of signals (n, c), and append flags (n, c) of them; whole signals remain alone."""
    valid = np.isfinite(signals)
    return signals if valid.all() else np.concatenate([_fill_linearly(signals), ~valid], axis=1)


def _with_missing(stack: FloatArray, c: int) -> FloatArray:
    """Invert `_with_flags` after interpolation: a sample is missing where missing ones have 2 % in it."""
    return stack if stack.shape[1] == c else np.where(np.abs(stack[:, c:]) > 0.02, np.nan, stack[:, :c])


def _fill_linearly(signals: FloatArray) -> FloatArray:
    return np.stack([interpolate_linearly(x) for x in signals.T], axis=1)
