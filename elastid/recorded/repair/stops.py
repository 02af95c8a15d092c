"""A stop within a record, such as an emergency stop: no torque and no motion where other repetitions have both.

A repetition with a stop in it is missing (NaN), so that it is left out; what follows a stop for good is cut off.  A
stop shorter than a tenth of a repetition counts where the torques lack what other repetitions have there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError
from elastid.recorded.repair import Finding, Log, Repaired

STOPPED = "stops"
# Windows of a repetition for long stops and for short ones, samples of one at least; so many in a row stand still.
_N_WINDOWS = 20
_N_SHORT_WINDOWS = 100
_MIN_WINDOW = 8
_MIN_STILL_WINDOWS = 2
# A signal stands still where it scatters by less than this part of what it does at that phase in other repetitions.
_MAX_STILL_SHARE = 0.1
# A signal moves at a phase where it scatters by this part of its median there.
_MIN_MOVING_SHARE = 0.2
# A torque is absent where it differs from that of other repetitions by this part of its rms.
_MIN_ABSENT_SHARE = 0.3


def without_stops(
    signals: FloatArray, roles: Mapping[str, Sequence[int]], L: int, repeats: Callable[[FloatArray], bool], log: Log
) -> Repaired:
    """Signals (n, c), NaN in the repetitions of L samples with a stop, and cut where the last stop has no end.

    roles: the columns of u and y, which stand still together in a stop.  repeats: whether signals (n, d), NaN where
    missing, repeat as stated.  Unchanged where the rest does not.
    Raises DataError where fewer than two repetitions are left.
    """
    P = len(signals) // L
    if P < 2 or _MIN_WINDOW * _MIN_STILL_WINDOWS > L:
        return Repaired(signals)
    width = max(_MIN_WINDOW, L // _N_WINDOWS)
    flat = _stop_windows(signals, roles, P, L, width)
    if not flat.any():
        width = max(_MIN_WINDOW, L // _N_SHORT_WINDOWS)
        flat = _short_stop_windows(signals, roles, P, L, width)
    if not flat.any():
        return Repaired(signals)
    stopped = flat.reshape(P, -1)
    bad = np.flatnonzero(stopped.any(axis=1))
    row = int(bad[0])
    at = row * L + int(np.argmax(stopped[row])) * width
    good, ends = P - len(bad), len(bad) == P - row
    result = signals.copy()
    for p in bad:
        # After a repetition with a stop the next one with a stop has not begun to move.
        first = p * L + (0 if p - 1 in bad else int(np.argmax(stopped[p])) * width)
        result[first : (p + 1) * L] = np.nan
    if not repeats(result[:, list(roles["u"])]):
        return Repaired(signals)
    what = f"the torques and the robot stand still from {log.at(at)} on"
    if good < 2:
        raise DataError(
            f"{log.where}: {what}, as after an emergency stop, and {good} of {P} repetitions is whole, where two are "
            f"needed: measure again, or take samples: [{log.first}, {log.first + at}] with period: none and "
            "estimator.method local_rational"
        )
    numbers = ", ".join(str(p + 1) for p in bad)
    text = (
        f"{what}, as after an emergency stop or at the end of the excitation: repetitions {numbers} of {P} are left out"
    )
    if ends:
        return Repaired(signals[: row * L], (Finding(STOPPED, len(bad), text),))
    for p in bad:
        result[p * L : (p + 1) * L] = np.nan
    return Repaired(result, (Finding(STOPPED, len(bad), text),))


def _stop_windows(signals: FloatArray, roles: Mapping[str, Sequence[int]], P: int, L: int, width: int) -> BoolArray:
    """Flags (P W,) of the windows that belong to stops."""
    still = _still(signals, roles["u"], P, L, width, all_of_them=True)
    still &= _still(signals, roles["y"], P, L, width, all_of_them=False)
    flat = _in_rows(still.ravel(), _MIN_STILL_WINDOWS)
    # A robot that has not started yet does not stop.
    flat[: int(np.argmin(flat))] = False
    return flat


def _short_stop_windows(
    signals: FloatArray, roles: Mapping[str, Sequence[int]], P: int, L: int, width: int
) -> BoolArray:
    """The same in short windows, where chance and rounding look still: those without their torques after the start."""
    absent = _absent(signals, roles["u"], P, L, width)
    flat = _in_rows(_stop_windows(signals, roles, P, L, width) & absent, _MIN_STILL_WINDOWS)
    flat[: len(flat) // P] = False
    return flat


def _absent(signals: FloatArray, columns: Sequence[int], P: int, L: int, width: int) -> BoolArray:
    """Flags (P W,) of the windows in which some column differs from its median repetition by much of its rms."""
    W = L // width
    repetitions = signals[: P * L, list(columns)].reshape(P, L, -1)[:, : W * width]
    away = repetitions - np.median(repetitions, axis=0)
    rms = np.sqrt(np.nanmean((repetitions - np.nanmean(repetitions, axis=(0, 1))) ** 2, axis=(0, 1)))
    mean_square = np.mean(away.reshape(P, W, width, -1) ** 2, axis=2)
    return np.asarray(np.any(mean_square > (_MIN_ABSENT_SHARE * rms) ** 2, axis=2).ravel())


def _still(signals: FloatArray, columns: Sequence[int], P: int, L: int, width: int, all_of_them: bool) -> BoolArray:
    """Flags (P, W) of the windows in which all of the moving columns, or one of them, stand still."""
    W = L // width
    flags = []
    for c in columns:
        windows = signals[: P * L, c].reshape(P, L)[:, : W * width].reshape(P, W, width)
        t = np.linspace(-1.0, 1.0, width)
        away = windows - windows.mean(axis=2, keepdims=True)
        away = away - (away @ t / (t @ t))[:, :, None] * t
        scatter = np.where(np.isfinite(away).all(axis=2), np.sqrt(np.mean(away**2, axis=2)), np.inf)
        # The largest may be that of the start; a stop may be longer than the rest.
        usual = np.sort(np.where(np.isfinite(scatter), scatter, 0.0), axis=0)[-2 if P > 2 else -1]
        level = float(np.median(usual))
        if level == 0:
            continue
        flags.append((scatter < _MAX_STILL_SHARE * usual) & (usual > _MIN_MOVING_SHARE * level))
    if not flags:
        return np.zeros((P, W), dtype=np.bool_)
    return np.asarray(np.all(flags, axis=0) if all_of_them else np.any(flags, axis=0))


def _in_rows(flags: BoolArray, least: int) -> BoolArray:
    """The flags that stand in a row of at least so many."""
    edges = np.diff(np.concatenate([[0], flags.astype(int), [0]]))
    result = np.zeros(len(flags), dtype=np.bool_)
    for start, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        result[start:end] = end - start >= least
    return result
