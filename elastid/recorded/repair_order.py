r"""The order in which the faults of a log are repaired, and the screen that shows that a piece of it needs none.

whole samples in a period -> dropouts -> stops -> stuck channels -> clock -> lost samples -> check of the period ->
missing samples -> spikes; limits and steps are reported of the samples as they were logged.  Without a period: missing
samples, limits and steps only.

Screen of a piece of a large log: quick tests that every repair would leave it as it is, from a few sums.

With m the mean repetition of the piece, without its drift, and e = x - m what does not repeat, a piece passes where

.. math:: |e(t) - \tfrac14 [e(t-3) + e(t-2) + e(t+2) + e(t+3)]| \le 6 \sigma

(or as much around it: no lone sample is a spike), where the power of e is that of the first piece (no samples are lost
and no repetition stops), where m lags that of the first piece by no more than its noise, and e has no part that grows
along dm/dt (the clock).  A piece that does not pass is repaired as a log of its own; so is the first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.statistics import STD_OVER_MAD
from elastid.recorded.link_side import MAX_COMPUTABLE
from elastid.recorded.periodicity import LIMITS, grid_samples, repetition
from elastid.recorded.repair import LIMITS as DRIFT
from elastid.recorded.repair import Finding, Log, Repaired, blocks, find_drift
from elastid.recorded.repair.clock import CLOCK, at_times, resampled
from elastid.recorded.repair.converter import LIMITS as CONVERTER
from elastid.recorded.repair.converter import find_clipping, find_steps
from elastid.recorded.repair.missing import bridged_gaps, filled, realigned, without_dropouts
from elastid.recorded.repair.spikes import despiked
from elastid.recorded.repair.stops import may_stop, without_stops, without_stuck


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
    valid = without_dropouts(start.signals, L, log)
    going = without_stops(valid.signals, roles, L, lambda x: repetition(x, L, sign).is_as_stated, log)
    moving = without_stuck(going.signals, L, log)
    clock = _at_the_clock(moving.signals, drivers, N, log)
    in_step = realigned(clock.signals, _bridged(clock.signals)[:, drivers], N, log)
    check(in_step.signals[:, drivers])
    full = filled(in_step.signals, L, sign, log)
    is_reported = len(start.signals) > len(signals) * N / period or bool(going.findings)
    if np.isfinite(signals).all() and is_reported and not in_step.findings:
        # All that is missing is the end of the second repetition, or repetitions with a stop.
        full = replace(full, findings=())
    repeating = replace(log, names=log.names[: sum(map(len, roles.values()))])
    clean = despiked(full.signals, L, sign, repeating)
    as_logged = _bridged(going.signals) if clock.findings else clean.signals
    reported = (*find_clipping(as_logged, L, repeating), *find_steps(as_logged, L, sign, repeating))
    reported += find_drift(clean.signals[:, : len(repeating.names)], drivers, L, sign, repeating)
    steps = (start, valid, going, moving, clock, in_step, full, clean)
    return Repaired(clean.signals, (*(f for step in steps for f in step.findings), *reported), full.left_out)


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


@dataclass(frozen=True)
class ScreenLimits:
    """Limits of the tests, below those of the repairs that they stand for.

    80 clean pieces all pass (tests/recorded/test_screen.py); one that does not is repaired, which costs time alone.
    """

    # A sample of more sigmas is a spike unless others around it reach this part of it (the rule asks for a sixth).
    min_sigmas: float = 6.0
    min_neighbour_share: float = 0.25
    # Power of a torque that does not repeat, over that of the first piece, and over that of the torque.
    max_power_ratio: float = 1.5
    min_power_share: float = 1e-6
    # Lag behind the first piece in samples; parts of the limits of drift and of the clock.
    max_lag: float = 0.05
    safety: float = 0.5


SCREEN = ScreenLimits()
# Samples that the scale of a noise is taken from; values of e on each side of a sample in its filter.
_SCALE_SAMPLES, _REACH = 4096, 12


@dataclass(frozen=True)
class Repetitions:
    """Of a signal (n,): e (P, L), its power (P,) without means and slopes, and m (L,) likewise, with its derivative."""

    e: FloatArray
    power: FloatArray
    m: FloatArray
    slope: FloatArray

    @property
    def size(self) -> float:
        """Power of the mean repetition."""
        return float(self.m @ self.m)


@dataclass(frozen=True)
class Screen:
    """Tests of the pieces of a log against its first one; `repetition` is None without a period.

    repetition: samples and sign.  drivers, torques: columns of r (else u), and of u.  jumps: of each column, the
    largest change from sample to sample that is no turn.  first: of each column that moves, in the first piece.
    """

    repetition: tuple[int, int] | None
    drivers: tuple[int, ...]
    torques: tuple[int, ...]
    jumps: tuple[float, ...]
    levels: tuple[float, ...]
    first: tuple[Repetitions | None, ...]

    def passes(self, columns: Sequence[FloatArray]) -> bool:
        """True if repairs would leave a piece as it is; columns (n,): whole repetitions, as they stand in the file."""
        return all(self._passes(c, x) for c, x in enumerate(columns))

    def _passes(self, c: int, x: FloatArray) -> bool:
        if x[0] == self.levels[c] and not np.any(x != x[0]):
            return True
        if not _is_plain(x, self.jumps[c]):
            return False
        if self.repetition is None:
            return True
        L, sign = self.repetition
        now, first = repetitions(x, L, sign), self.first[c]
        if first is None or _has_spike(now.e, sign):
            return False
        if c in self.torques and may_stop(x, L):
            return False
        if c in self.drivers:
            return _is_in_step(now, first)
        return float(now.power.mean()) <= SCREEN.safety * DRIFT.min_drift_power * now.size


def screen(
    columns: Sequence[FloatArray],
    repetition: tuple[int, int] | None,
    drivers: Sequence[int],
    torques: Sequence[int],
    jumps: Sequence[float],
) -> Screen:
    """The screen of a log from the columns (n,) of its first piece."""
    if repetition is not None and len(columns[0]) > 3 * repetition[0]:
        # The first repetition may hold the start from rest; the sign of half a wave stays with two.
        columns = [x[(3 - repetition[1]) // 2 * repetition[0] :] for x in columns]
    moving = [bool(np.any(x != x[0])) for x in columns]
    levels = tuple(np.nan if moves else float(x[0]) for x, moves in zip(columns, moving, strict=True))
    first = tuple(
        repetitions(x, *repetition) if repetition is not None and moves else None
        for x, moves in zip(columns, moving, strict=True)
    )
    return Screen(repetition, tuple(drivers), tuple(torques), tuple(jumps), levels, first)


def _is_plain(x: FloatArray, jump: float) -> bool:
    """True if all of a signal (n,) is known, it moves, keeps away from its limits, and no angle starts again."""
    low, high = float(x.min()), float(x.max())
    if not (np.isfinite(high - low) and high > low) or max(-low, high) > MAX_COMPUTABLE:
        return False
    near = CONVERTER.equal_tolerance * (high - low)
    at_limits = np.count_nonzero(x >= high - near) + np.count_nonzero(x <= low + near)
    if at_limits >= CONVERTER.min_clipped_share * len(x):
        return False
    return high - low <= jump or float(np.abs(np.diff(x)).max()) <= jump


def repetitions(x: FloatArray, L: int, sign: int) -> Repetitions:
    """The parts of a signal (n,) that repeat, with a sign, after L samples, and that do not."""
    X = x.reshape(-1, L) if sign > 0 else blocks(x, L, sign)
    t = np.arange(L) - (L - 1) / 2
    mean = X.mean(axis=0)
    if sign > 0 and len(X) > 1:  # a position that drifts still repeats
        mean -= (X[-1].mean() - X[0].mean()) / ((len(X) - 1) * L) * t
    e = X - mean
    unit = t / np.linalg.norm(t)
    power = np.einsum("pl,pl->p", e, e) - L * e.mean(axis=1) ** 2 - (e @ unit) ** 2
    m = mean - mean.mean()
    m -= (m @ unit) * unit
    after, before = np.roll(m, -1), np.roll(m, 1)
    after[-1] *= sign
    before[0] *= sign
    return Repetitions(e, power, m, (after - before) / 2)


def _has_spike(e: FloatArray, sign: int) -> bool:
    """True if a sample of e (P, L), or two, may stand out from those around it."""
    x = (e if sign > 0 else e * float(sign) ** np.arange(len(e))[:, None]).ravel()
    d = x[2:-4] + x[4:-2]
    d += x[1:-5]
    d += x[5:-1]
    d *= -0.25
    d += x[3:-3]
    np.abs(d, out=d)
    sigma = STD_OVER_MAD * float(np.median(d[:: max(1, len(d) // _SCALE_SAMPLES)]))
    candidates = np.flatnonzero(d > SCREEN.min_sigmas * sigma)
    if len(candidates) > len(d) // 1000:
        return True
    offsets = np.array([*range(-_REACH, -3), *range(4, _REACH + 1)])
    inside = candidates[(candidates >= _REACH) & (candidates < len(d) - _REACH)]
    around = d[inside[:, None] + offsets].max(axis=1)
    return bool(np.any(around < SCREEN.min_neighbour_share * d[inside]))


def _is_in_step(now: Repetitions, first: Repetitions) -> bool:
    """True if a torque repeats as it did in the first piece, without a lag and at the same clock."""
    noise = max(float(np.median(first.power)), SCREEN.min_power_share * now.size)
    if not float(now.power.max()) <= SCREEN.max_power_ratio * noise:
        return False
    steepness = float(first.slope @ first.slope)
    difference = now.m - first.m
    lag = float(difference @ first.slope) / steepness
    remainder = float(difference @ difference) - lag**2 * steepness
    P = len(now.e)
    if abs(lag) > SCREEN.max_lag or remainder > 4 * SCREEN.max_power_ratio * noise / min(P, len(first.e)):
        return False
    lags = now.e @ first.slope / steepness
    growth = abs(float(np.polyfit(np.arange(P), lags, 1)[0])) * P
    is_clock = float(lags @ lags) * steepness > SCREEN.safety**2 * float(now.power.sum())
    return growth < SCREEN.safety * CLOCK.min_shift or not is_clock
