"""Stops within a record, and channels that are stuck, where other repetitions move.

An emergency stop has no torque and no motion. An encoder or a converter that hangs repeats its last value exactly; a
joint that stands has noise, or stands in every repetition, and where all channels are at one value the robot stops.

A stop shorter than a tenth of a repetition counts where the torques lack what other repetitions have there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError
from elastid.recorded.repair import Finding, Log, Repaired, in_runs, runs
from elastid.recorded.repair.converter import step

STOPPED = "stops"


@dataclass(frozen=True)
class StopLimits:
    """Limits that distinguish a stop from motion."""

    # Windows of a repetition for long stops and for short ones, samples of one at least; so many in a row stand still.
    windows: int = 20
    short_windows: int = 100
    min_window: int = 8
    min_still_windows: int = 2
    # A signal stands still where it scatters by less than this part of its scatter at that phase in other repetitions.
    max_still_share: float = 0.1
    min_moving_share: float = 0.2  # a signal moves at a phase where it scatters by this part of its median scatter
    # A torque is absent where it differs from that of other repetitions by this part of its rms.
    min_absent_share: float = 0.3
    start_windows: int = 200  # of a log, among which its start is found


LIMITS = StopLimits()


def rest_before(torques: FloatArray) -> int:
    """Samples of torques (n, d), NaN where missing, before the first window in which one of them moves."""
    width = max(LIMITS.min_window, len(torques) // LIMITS.start_windows)
    if len(torques) < 3 * width:
        return 0
    scatter = np.stack([_scatter(x[: len(x) // width * width].reshape(-1, width)) for x in torques.T])
    # The largest may be a spike.
    usual = np.sort(np.where(np.isfinite(scatter), scatter, 0.0), axis=1)[:, -2, None]
    moves = np.any((scatter > LIMITS.max_still_share * usual) & (usual > 0), axis=0)
    return int(np.argmax(moves)) * width


def without_stops(
    signals: FloatArray, roles: Mapping[str, Sequence[int]], L: int, repeats: Callable[[FloatArray], bool], log: Log
) -> Repaired:
    """Signals (n, c), NaN in the repetitions of L samples with a stop, and cut where the last stop has no end.

    roles: the columns of u and y, which stand still together in a stop.  repeats: true if signals (n, d), NaN where
    missing, repeat as stated; unchanged where the rest does not.  DataError where fewer than two repetitions are left.
    """
    P = len(signals) // L
    if P < 2 or LIMITS.min_window * LIMITS.min_still_windows > L:
        return Repaired(signals)
    width = max(LIMITS.min_window, L // LIMITS.windows)
    flat = _stop_windows(signals, roles, P, L, width)
    if not flat.any():
        width = max(LIMITS.min_window, L // LIMITS.short_windows)
        # In short windows chance and rounding look still: only those without their torques, after the start, count.
        flat = _stop_windows(signals, roles, P, L, width) & _absent(signals, roles["u"], P, L, width)
        flat = in_runs(flat, LIMITS.min_still_windows)
        flat[: len(flat) // P] = False
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
    event = f"the torques and the robot stand still from {log.time_of(start)} on"
    good = P - len(bad)
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


def _stop_windows(signals: FloatArray, roles: Mapping[str, Sequence[int]], P: int, L: int, width: int) -> BoolArray:
    """Flags (P W,) of the windows that belong to stops."""
    still = np.all(_still(signals, roles["u"], P, L, width), axis=0)
    if not still.any():
        return np.asarray(still.ravel())
    still &= np.any(_still(signals, roles["y"], P, L, width), axis=0)
    flat = in_runs(still.ravel(), LIMITS.min_still_windows)
    # A robot that has not started yet does not stop.
    flat[: int(np.argmin(flat))] = False
    return flat


def may_stop(torque: FloatArray, L: int) -> bool:
    """True if a torque (n,) of whole repetitions stands still in enough windows for a stop, long or short."""
    widths = [max(LIMITS.min_window, L // count) for count in (LIMITS.windows, LIMITS.short_windows)]
    return any(_may_stop(torque.reshape(-1, L), width) for width in widths if width * LIMITS.min_still_windows <= L)


def _may_stop(repetitions: FloatArray, width: int) -> bool:
    """The same for one width of window, from the power less that of mean and slope."""
    P, W = len(repetitions), repetitions.shape[1] // width
    windows = repetitions[:, : W * width].reshape(P, W, width)
    t = np.linspace(-1.0, 1.0, width)
    means, slopes = windows.mean(axis=2), windows @ (t / np.linalg.norm(t))
    power = np.einsum("pwt,pwt->pw", windows, windows) - width * means**2 - slopes**2
    usual = np.sort(power, axis=0)[-2 if P > 2 else -1]
    moves = usual > LIMITS.min_moving_share**2 * np.median(usual)
    still = (power < LIMITS.max_still_share**2 * usual) & moves
    return bool(in_runs(still.ravel(), LIMITS.min_still_windows).any())


def _absent(signals: FloatArray, columns: Sequence[int], P: int, L: int, width: int) -> BoolArray:
    """Flags (P W,) of the windows in which some column differs from its median repetition by much of its rms."""
    W = L // width
    repetitions = signals[: P * L, list(columns)].reshape(P, L, -1)[:, : W * width]
    away = repetitions - np.median(repetitions, axis=0)
    rms = np.sqrt(np.nanmean((repetitions - np.nanmean(repetitions, axis=(0, 1))) ** 2, axis=(0, 1)))
    mean_square = np.mean(away.reshape(P, W, width, -1) ** 2, axis=2)
    return np.asarray(np.any(mean_square > (LIMITS.min_absent_share * rms) ** 2, axis=2).ravel())


def _still(signals: FloatArray, columns: Sequence[int], P: int, L: int, width: int) -> list[BoolArray]:
    """Flags (P, W) of the windows in which each of the moving columns stands still; none set without such columns."""
    W = L // width
    flags = []
    for c in columns:
        scatter = _scatter(signals[: P * L, c].reshape(P, L)[:, : W * width].reshape(P, W, width))
        # The largest may be that of the start; a stop may be longer than the rest.
        usual = np.sort(np.where(np.isfinite(scatter), scatter, 0.0), axis=0)[-2 if P > 2 else -1]
        level = float(np.median(usual))
        if level == 0:
            continue
        flags.append((scatter < LIMITS.max_still_share * usual) & (usual > LIMITS.min_moving_share * level))
    return flags or [np.zeros((P, W), dtype=np.bool_)]


def _scatter(windows: FloatArray) -> FloatArray:
    """Rms (...) of windows (..., width) without mean and slope; infinite where a sample is missing."""
    t = np.linspace(-1.0, 1.0, windows.shape[-1])
    away = windows - windows.mean(axis=-1, keepdims=True)
    away = away - (away @ t / (t @ t))[..., None] * t
    return np.where(np.isfinite(away).all(axis=-1), np.sqrt(np.mean(away**2, axis=-1)), np.inf)


@dataclass(frozen=True)
class StuckLimits:
    """Limits of a channel that is stuck."""

    min_run: int = 20  # samples with one value
    # Range of the other repetitions there: over the scatter of the channel, and in its steps.
    min_range: float = 0.25
    min_steps: float = 4.0


STUCK = StuckLimits()


def without_stuck(signals: FloatArray, L: int, log: Log) -> Repaired:
    """Signals (n, c), some samples NaN, with NaN for samples that are stuck, where repetitions of L samples move."""
    result, findings = signals.copy(), []
    hold = np.diff(signals, axis=0) == 0
    for c, x in enumerate(signals.T):
        least = max(STUCK.min_range * float(np.nanstd(x)), STUCK.min_steps * step(x[np.isfinite(x)]))
        stuck = np.zeros(len(x), dtype=np.bool_)
        for start, end in runs(hold[:, c] & ~hold.all(axis=1), STUCK.min_run - 1):
            others = [x[a : a + end + 1 - start] for a in range(start % L, len(x) - end + start, L) if a != start]
            if len(others) and min(float(np.ptp(other)) for other in others) > least:
                # The first value may be a measured one.
                stuck[start + 1 : end + 1] = True
        if not stuck.any():
            continue
        result[stuck, c] = np.nan
        text = f"{log.names[c]} is stuck for {stuck.sum()} samples from {log.time_of(np.flatnonzero(stuck)[0])} on"
        findings.append(Finding("stuck samples", int(stuck.sum()), f"{text}, while other periods move: not used"))
    return Repaired(result, tuple(findings))
