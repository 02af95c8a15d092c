"""Samples that are no measured ones: what other repetitions contradict becomes missing (NaN).

A stop has no torque and no motion, in windows in which other repetitions move.  A channel that hangs repeats its last
value exactly, and one that drops out leaps to exactly 0 and back, where others do neither.  A spike is one sample or
two (Hampel's rule across periods):

    e = x - median over the other periods,   d = |e - running median of e| > 8 sigma

only where e is as far from the parabola through its neighbours, six times as far as each of those, and d six times as
large as at its neighbours and three times as at all but 2 % of the samples of most parts of the log: drift, transients,
steps and bursts of oscillation are no spikes, nor is what recurs, as the pulse of a controller at an encoder's count.
With its own period in the median e would be 0 at a third of the samples of three periods, a lone other one then a
spike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.base.statistics import STD_OVER_MAD
from elastid.recorded.repair import Finding, Log, Repaired, blocks, expected, in_runs, runs
from elastid.recorded.repair.converter import step

MASKED, STOPPED = "samples taken as missing", "stops"


@dataclass(frozen=True)
class StillLimits:
    """Limits that distinguish a stop, a channel that hangs, and one that drops out, from motion."""

    windows: int = 20  # of a repetition, samples of one at least, and so many in a row stand still
    min_window: int = 8
    min_still_windows: int = 2
    # A signal stands still where it scatters by less than this part of its scatter at that phase in other repetitions.
    max_still_share: float = 0.1
    min_moving_share: float = 0.2  # a signal moves at a phase where it scatters by this part of its median scatter
    start_windows: int = 200  # of a log, among which its start is found
    # Samples with one value; range of the other repetitions there, over the scatter of the channel and in its steps.
    min_run: int = 20
    min_range: float = 0.25
    min_steps: float = 4.0
    # A leap to 0, over the step that 99 % of the samples stay below; longest one as a part of the repetition.
    leap: float = 10.0
    max_dropout: float = 0.1


@dataclass(frozen=True)
class SpikeLimits:
    """Limits that distinguish a spike from a signal."""

    min_sigmas: float = 8.0
    min_periods: int = 3
    # Spikes of more than this part of a channel are no single ones.
    max_share: float = 0.01
    # Samples: of the running median, of a spike at most, and of its neighbours on each side.
    median_window: int = 11
    max_run: int = 2
    neighbours: int = 6
    # Distance of a spike over that of its neighbours, at least.
    min_ratio: float = 6.0
    # And over the distance of this share of the samples, in the median of parts of the log.
    usual_share: float = 0.98
    parts: int = 20
    min_over_usual: float = 3.0
    # Of the quick test: sigmas, below those of the rule, and the part of a sample that others around it reach.
    quick_sigmas: float = 6.0
    quick_share: float = 0.25


STILL, SPIKE = StillLimits(), SpikeLimits()


def rest_before(torques: FloatArray) -> int:
    """Samples of torques (n, d), NaN where missing, before the first window in which one of them moves."""
    width = max(STILL.min_window, len(torques) // STILL.start_windows)
    if len(torques) < 3 * width:
        return 0
    scatter = np.stack([_scatter(x[: len(x) // width * width].reshape(-1, width)) for x in torques.T])
    # The largest may be a spike.
    usual = np.sort(np.where(np.isfinite(scatter), scatter, 0.0), axis=1)[:, -2, None]
    moves = np.any((scatter > STILL.max_still_share * usual) & (usual > 0), axis=0)
    return int(np.argmax(moves)) * width


def without_stops(
    signals: FloatArray, roles: Mapping[str, Sequence[int]], L: int, repeats: Callable[[FloatArray], bool], log: Log
) -> Repaired:
    """Signals (n, c), NaN in the repetitions of L samples with a stop, and cut where the last stop has no end.

    roles: the columns of u and y, which stand still together in a stop.  repeats: true if signals (n, d), NaN where
    missing, repeat as stated; unchanged where the rest does not.  DataError where fewer than two repetitions are left.
    """
    P, width = len(signals) // L, max(STILL.min_window, L // STILL.windows)
    if P < 2 or width * STILL.min_still_windows > L:
        return Repaired(signals)
    still = np.all(_still(signals, roles["u"], P, L, width), axis=0)
    still &= np.any(_still(signals, roles["y"], P, L, width), axis=0) if still.any() else still
    flat = in_runs(still.ravel(), STILL.min_still_windows)
    flat[: int(np.argmin(flat))] = False  # a robot that has not started yet does not stop
    if not flat.any():
        return Repaired(signals)
    stopped = flat.reshape(P, -1)
    bad = np.flatnonzero(stopped.any(axis=1))
    row = int(bad[0])
    start = row * L + int(np.argmax(stopped[row])) * width
    result = signals.copy()
    for p in bad:
        # After a repetition with a stop the next one with a stop has not begun to move.
        first = p * L + (0 if p - 1 in bad else int(np.argmax(stopped[p])) * width)
        result[first : (p + 1) * L] = np.nan
    if not repeats(result[:, list(roles["u"])]):
        return Repaired(signals)
    event, good = f"the torques and the robot stand still from {log.time_of(start)} on", P - len(bad)
    if good < 2:
        raise DataError(
            "records/stopped",
            f"{event}, as after an emergency stop, and {good} of {P} repetitions is whole, where two are "
            f"needed: measure again, or take samples: [{log.first}, {log.first + start}] with period: none and "
            "estimator.method local_rational",
            log.where,
        )
    numbers = ", ".join(str(p + 1) for p in bad)
    text = f"{event}, as after an emergency stop or at the end of the excitation"
    finding = Finding(STOPPED, len(bad), f"{text}: repetitions {numbers} of {P} are left out")
    if good == row:  # the last stop has no end
        return Repaired(signals[: row * L], (finding,))
    for p in bad:
        result[p * L : (p + 1) * L] = np.nan
    return Repaired(result, (finding,))


def _still(signals: FloatArray, columns: Sequence[int], P: int, L: int, width: int) -> list[BoolArray]:
    """Flags (P, W) of the windows in which each of the moving columns stands still; none set without such columns."""
    W, flags = L // width, []
    for c in columns:
        scatter = _scatter(signals[: P * L, c].reshape(P, L)[:, : W * width].reshape(P, W, width))
        # The largest may be that of the start; a stop may be longer than the rest.
        usual = np.sort(np.where(np.isfinite(scatter), scatter, 0.0), axis=0)[-2 if P > 2 else -1]
        if (level := float(np.median(usual))) > 0:
            flags.append((scatter < STILL.max_still_share * usual) & (usual > STILL.min_moving_share * level))
    return flags or [np.zeros((P, W), dtype=np.bool_)]


def _scatter(windows: FloatArray) -> FloatArray:
    """Rms (...) of windows (..., width) without mean and slope; infinite where a sample is missing."""
    t = np.linspace(-1.0, 1.0, windows.shape[-1])
    away = windows - windows.mean(axis=-1, keepdims=True)
    away = away - (away @ t / (t @ t))[..., None] * t
    return np.where(np.isfinite(away).all(axis=-1), np.sqrt(np.mean(away**2, axis=-1)), np.inf)


def without_standstill(signals: FloatArray, L: int, log: Log) -> Repaired:
    """Signals (n, c), some samples NaN, with NaN where a channel hangs, or drops to 0, and other repetitions do not."""
    result, findings = signals.copy(), []
    hold = np.diff(signals, axis=0) == 0
    alike = hold.all(axis=1)
    for c, x in enumerate(signals.T):
        lost = [(a, b) for a, b in runs(np.asarray(x == 0)) if a > 0 and b < len(x)]
        least = STILL.leap * float(np.nanquantile(np.abs(np.diff(x)), 0.99)) if lost else 0.0
        lost = [(a, b) for a, b in lost if _is_dropout(x, a, b, least, L)]
        stuck = runs(hold[:, c] & ~alike, STILL.min_run - 1).tolist()
        moving = max(STILL.min_range * float(np.nanstd(x)), STILL.min_steps * step(x)) if stuck else 0.0
        # The first value may be a measured one.
        lost += [(a + 1, b + 1) for a, b in stuck if min(map(np.ptp, _elsewhere(x, a, b + 1, L)), default=0) > moving]
        if lost:
            missing = np.unique(np.concatenate([np.arange(a, b) for a, b in lost]))
            result[missing, c] = np.nan
            text = f"{log.names[c]} stands still or at 0 for {missing.size} samples from {log.time_of(missing[0])} on"
            findings.append(Finding(MASKED, missing.size, f"{text}, while other periods move: taken as missing"))
    return Repaired(result, tuple(findings))


def _elsewhere(x: FloatArray, start: int, end: int, L: int) -> list[FloatArray]:
    """The samples of the other repetitions at the phases from a start to an end."""
    return [x[a : a + end - start] for a in range(start % L, len(x) - end + start + 1, L) if a != start]


def _is_dropout(x: FloatArray, start: int, end: int, least: float, L: int) -> bool:
    """True of zeros in x (n,) between two values of one sign beyond `least`, where no other repetition has any."""
    before, after = float(x[start - 1]), float(x[end])
    is_leap = before * after > 0 and min(abs(before), abs(after)) > least
    is_short = end - start <= STILL.max_dropout * L
    return is_leap and is_short and all(other.all() for other in _elsewhere(x, start, end, L))


def without_spikes(signals: FloatArray, L: int, sign: int, log: Log) -> Repaired:
    """Signals (P L, c), finite, NaN at spikes of one or two samples; unchanged for fewer than three repetitions."""
    if len(signals) // L < SPIKE.min_periods:
        return Repaired(signals)
    apart = [_from_others(x, L, sign) if _may_have_spike(x, L, sign) else None for x in signals.T]
    return _without(signals, apart, L, "the other periods", log)[0]


def despiked_without_period(signals: FloatArray, log: Log) -> Repaired:
    """Signals (n, c), finite, with the parabola through the neighbours at spikes that these alone show."""
    repaired, values = _without(signals, list(signals.T), len(signals), "their neighbours", log)
    result = repaired.signals.copy()
    for c, usual in values.items():
        result[np.isnan(result[:, c]), c] = usual
    return Repaired(result, repaired.findings)


def _may_have_spike(x: FloatArray, L: int, sign: int) -> bool:
    """True if a sample of x (n,), or two, may stand out from the mean repetition and from those around it."""
    X = blocks(x, L, sign)
    e = ((X - X.mean(axis=0)) * float(sign) ** np.arange(len(X))[:, None]).ravel()
    d = np.abs(e[3:-3] - (e[2:-4] + e[4:-2] + e[1:-5] + e[5:-1]) / 4)
    sigma = STD_OVER_MAD * float(np.median(d[:: max(1, len(d) // 4096)]))
    candidates = np.flatnonzero(d > SPIKE.quick_sigmas * sigma)
    if len(candidates) > len(d) // 1000:
        return True
    reach = 2 * SPIKE.neighbours
    inside = candidates[(candidates >= reach) & (candidates < len(d) - reach)]
    around = d[inside[:, None] + [*range(-reach, -3), *range(4, reach + 1)]].max(axis=1)
    return bool(np.any(around < SPIKE.quick_share * d[inside]))


def _from_others(x: FloatArray, L: int, sign: int) -> FloatArray:
    """e (n,): each sample less the median of the other repetitions, from their order with this one."""
    E = blocks(x - expected(x, L, sign, np.ones(len(x), dtype=np.bool_), robust=True), L, sign)
    ordered, middle = np.sort(E, axis=0), len(E) // 2
    below, centre = ordered[middle - 1], ordered[middle]
    if len(E) % 2:
        above = ordered[middle + 1]
        E = E - np.where(centre > E, centre + above, np.where(centre < E, below + centre, below + above)) / 2
    else:
        E = E - np.where(centre > E, centre, below)
    return np.asarray((E * float(sign) ** np.arange(len(E))[:, None]).ravel())


def _without(
    signals: FloatArray, apart: Sequence[FloatArray | None], L: int, reference: str, log: Log
) -> tuple[Repaired, dict[int, FloatArray]]:
    """Signals (n, c), NaN at the spikes of each channel, and usual values there.  apart: e (n,) of each."""
    result, findings, values = signals.copy(), [], {}
    for c, e in enumerate(apart):
        x = signals[:, c]
        spikes, usual = (np.arange(0), x[:0]) if e is None else _spikes(x, e, L)
        if spikes.size == 0:
            continue
        text = f"{log.names[c]}: {spikes.size} of {len(x)} samples differ from {reference}"
        if spikes.size > SPIKE.max_share * len(x):
            findings.append(Finding("spikes left", spikes.size, f"{text}: too many for spikes, left unchanged"))
            continue
        order = np.argsort(spikes)
        result[spikes, c], values[c] = np.nan, usual[order]
        text += f", the first is {log.time_of(spikes[order[0]])}: spikes, taken as missing"
        findings.append(Finding(MASKED, spikes.size, text))
    return Repaired(result, tuple(findings)), values


def _spikes(x: FloatArray, e: FloatArray, L: int) -> tuple[IntArray, FloatArray]:
    """Samples (k,) of the spikes, and their usual values (k,)."""
    from scipy.ndimage import median_filter

    d = np.abs(e - median_filter(e, SPIKE.median_window, mode="mirror"))
    sigma = STD_OVER_MAD * float(np.median(d))
    if sigma == 0:  # most samples agree exactly: from the smaller 99 %
        sigma = float(np.sqrt(np.mean(np.sort(d)[: int(0.99 * len(d))] ** 2)))
    least = max(SPIKE.min_sigmas * sigma, 2 * step(x), 1e-9 * np.ptp(x))
    parts = d[: len(d) // SPIKE.parts * SPIKE.parts].reshape(SPIKE.parts, -1)
    beyond_usual = SPIKE.min_over_usual * float(np.median(np.quantile(parts, SPIKE.usual_share, axis=1)))
    spikes, usual = [np.arange(0)], [x[:0]]
    for first, end in runs(np.asarray(d > least)):
        run = np.arange(first, end)
        # Near an end a spike cannot be distinguished from a bend.
        inside = first > SPIKE.neighbours and end <= len(e) - SPIKE.neighbours
        if inside and len(run) <= SPIKE.max_run and _is_alone(d, run):
            local, scatter = _parabola(e, run)
            distance = np.abs(e[run] - local).max()
            if distance > max(least, SPIKE.min_ratio * scatter) and distance >= _in_others(e, run, L):
                spikes.append(run)
                usual.append(x[run] - e[run] + local)
    found, values = np.concatenate(spikes), np.concatenate(usual)
    if found.size > SPIKE.max_share * len(x):
        return found, values
    is_rare = np.repeat([d[run].max(initial=0.0) > beyond_usual for run in spikes], [len(run) for run in spikes])
    return found[is_rare], values[is_rare]


def _parabola(e: FloatArray, run: IntArray) -> tuple[FloatArray, float]:
    """The parabola through the neighbours of a run, at the run, and the largest distance of those from it."""
    first, last, n = int(run[0]), int(run[-1]), SPIKE.neighbours
    sides = np.r_[max(0, first - 1 - n) : max(0, first - 1), last + 2 : min(len(e), last + 2 + n)]
    middle = (first + last) / 2
    powers = np.vander((sides - middle) / n, 3)
    coefficients = np.linalg.lstsq(powers, e[sides], rcond=None)[0]
    scatter = float(np.abs(e[sides] - powers @ coefficients).max())
    return np.asarray(np.vander((run - middle) / n, 3) @ coefficients), scatter


def _in_others(e: FloatArray, run: IntArray, L: int) -> float:
    """Largest distance from the parabola in the two other periods of three, whose e have half of a spike in one."""
    if len(e) != 3 * L:
        return 0.0
    others = [(run + p * L) % len(e) for p in (1, 2)]
    if any(other[0] <= SPIKE.neighbours or other[-1] >= len(e) - SPIKE.neighbours for other in others):
        return np.inf
    return max(float(np.abs(e[other] - _parabola(e, other)[0]).max()) for other in others)


def _is_alone(d: FloatArray, run: IntArray) -> bool:
    first, last, n = int(run[0]), int(run[-1]), 2 * SPIKE.neighbours
    sides = np.concatenate([d[max(0, first - n) : first - 1], d[last + 2 : last + 2 + n]])
    return bool(d[run].max() > SPIKE.min_ratio * sides.max())
