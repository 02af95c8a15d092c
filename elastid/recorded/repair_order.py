"""The repairs of a log: its period in whole samples, its clock, and missing samples, which are filled.

Samples that other repetitions contradict are missing, too (`repair.masks`).  What then does not repeat is refused;
limits and steps are reported of the samples as they were logged.  Without a period: missing samples, limits and steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.recorded.periodicity import LIMITS, grid_samples
from elastid.recorded.repair import Finding, Log, Repaired
from elastid.recorded.repair.converter import find_clipping, find_steps
from elastid.recorded.repair.masks import without_spikes, without_standstill, without_stops
from elastid.recorded.repair.missing import bridged_gaps, filled
from elastid.recorded.repair.time_stamps import at_times, resampled


def repair(
    signals: FloatArray,
    roles: Mapping[str, Sequence[int]],
    period: float,
    half_wave: bool,
    log: Log,
    check: Callable[[FloatArray], None],
) -> Repaired:
    """Signals (n, c), some samples NaN, repaired: whole repetitions of a period, or of half of one where half_wave.

    roles: the columns of r, u and y, before all others, which need not repeat.  check: refuses drivers (n, d) that are
    not periodic.  DataError without a repair.
    """
    N, drivers = grid_samples(period, half_wave), np.array(roles["r"] or roles["u"])
    L, sign = (N // 2, -1) if half_wave else (N, 1)
    start = _in_whole_samples(signals, period, N, L)
    going = without_stops(start.signals, roles["u"], L, log)
    moving = without_standstill(going.signals, L, log)
    clock = _at_the_clock(moving.signals, drivers, N, log)
    check(clock.signals[:, drivers])
    full = filled(clock.signals, L, sign, log)
    is_reported = len(start.signals) > len(signals) * N / period or bool(going.findings)
    if np.isfinite(signals).all() and is_reported and not moving.findings:
        # All that is missing is the end of the second repetition, or repetitions with a stop.
        full = replace(full, findings=())
    repeating = replace(log, names=log.names[: sum(map(len, roles.values()))])
    lone = without_spikes(full.signals[:, : len(repeating.names)], L, sign, repeating)
    if lone.findings:
        again = filled(lone.signals, L, sign, repeating)
        full = replace(full, signals=np.concatenate([again.signals, full.signals[:, len(repeating.names) :]], axis=1))
    as_logged = _bridged(going.signals) if clock.findings else full.signals
    reported = (*find_clipping(as_logged, L, repeating), *find_steps(as_logged, L, sign, repeating))
    steps = (start, going, moving, clock, full, lone)
    return Repaired(full.signals, (*(f for step in steps for f in step.findings), *reported), full.left_out)


def repair_without_period(signals: FloatArray, log: Log) -> Repaired:
    """Signals (n, c), some samples NaN, with single gaps interpolated; DataError where gaps are longer."""
    full, n = bridged_gaps(signals, log), len(signals)
    reported = (*find_clipping(full.signals, n, log), *find_steps(full.signals, n, 1, log))
    return Repaired(full.signals, (*full.findings, *reported))


def _in_whole_samples(signals: FloatArray, period: float, N: int, L: int) -> Repaired:
    """Signals with N samples in a period, and two whole repetitions of L where the second one lacks its end only."""
    result, findings = signals, tuple[Finding, ...]()
    if period != N:
        # A period of a fraction of samples is interpolated so that it has N of them.
        times = np.arange(int((len(signals) - 1) * N / period) + 1, dtype=np.float64) * (period / N)
        result = _with_missing(at_times(_and_missing(signals), times, period, min(1.0, N / period)))
        text = f"a period of {period:.8g} samples is brought to {N}"
        findings = (Finding("periods brought to whole samples", 1, text),)
    n, lacking = len(result), 2 * L - len(result)
    if n < LIMITS.min_periods * L or lacking <= 0:
        return Repaired(result, findings)
    text = (
        f"{n} samples are {n / L:.2f} repetitions of {L}: {n - L} of them repeat and give the noise, the last "
        f"{lacking} are taken from the first repetition"
    )
    end = np.full((lacking, signals.shape[1]), np.nan)
    return Repaired(np.concatenate([result, end]), (*findings, Finding("incomplete periods", 1, text)))


def _at_the_clock(signals: FloatArray, drivers: IntArray, N: int, log: Log) -> Repaired:
    both = _and_missing(signals)
    result = resampled(both, both[:, drivers], N, log)
    return replace(result, signals=_with_missing(result.signals)) if result.findings else Repaired(signals)


def _and_missing(signals: FloatArray) -> FloatArray:
    """Signals (n, c) -> (n, 2 c): straight lines where samples are missing, and 1 where they are."""
    return np.concatenate([_bridged(signals), ~np.isfinite(signals)], axis=1)


def _with_missing(both: FloatArray) -> FloatArray:
    """The inverse after interpolation: a sample is missing where missing ones have 2 % in it."""
    values, touched = np.split(both, 2, axis=1)
    return np.where(np.abs(touched) > 0.02, np.nan, values)


def _bridged(signals: FloatArray) -> FloatArray:
    """Straight lines where samples are missing: good enough to compare periods with."""
    result, rows = signals.copy(), np.arange(len(signals))
    for c in np.flatnonzero(~np.isfinite(signals).all(axis=0)):
        known = np.isfinite(signals[:, c])
        result[:, c] = np.interp(rows, rows[known], signals[known, c]) if known.any() else 0.0
    return result
