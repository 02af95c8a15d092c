"""The check that an excitation repeats as the study states, and the words where it does not."""

from __future__ import annotations

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.recorded.period import NO_LINES
from elastid.recorded.periodicity import MIN_PERIODS, find_period, repetition
from elastid.recorded.repair.finding import Log


def check_repeat(excitation: FloatArray, N: int, half_wave: bool, log: Log) -> None:
    """DataError where the excitation (n, n_u), NaN where missing, does not repeat as stated, or hardly once."""
    n, path = len(excitation), log.where
    repeat, sign = (N // 2, -1) if half_wave else (N, 1)
    if n < MIN_PERIODS * repeat:
        needed = "one period is" if half_wave else "two periods are"
        raise DataError(
            f"{path}: {_span(n, log)} are {n / N:.3g} periods of {_span(N, log)}; at least "
            f"{needed} needed{_half_wave_hint(excitation, N, half_wave, log) or _shorter(excitation, log)}"
        )
    found = repetition(excitation, repeat, sign)
    if found.is_as_stated:
        return
    stated = "second half minus first" if half_wave else "one period to the next"
    problem = (
        f"{path}: the excitation does not repeat with the period of {_span(N, log)} that the study states "
        f"(correlation {found.correlation:.3f}, {stated})"
    )
    if found.best_samples:
        raise DataError(
            f"{problem}; it repeats every {_span(found.best_samples, log)} (correlation "
            f"{found.best_correlation:.3f}): correct the period or the rate"
        )
    hint = _half_wave_hint(excitation, 2 * repeat, half_wave, log)
    raise DataError(
        f"{problem}, nor at any other lag (best correlation {found.best_correlation:.3f}){hint}; with a period elastid "
        f"needs a periodic excitation{'' if hint else f'; {NO_LINES}'}"
    )


def _shorter(excitation: FloatArray, log: Log) -> str:
    """The end of a message on too few periods: a shorter period that fits, or what can be had without one."""
    found = find_period(excitation)
    if found.best_samples:
        return f". It repeats every {_span(found.best_samples, log)}: correct the period or the rate"
    return f", and {NO_LINES}"


def _half_wave_hint(excitation: FloatArray, N: int, half_wave: bool, log: Log) -> str:
    """The end of a message where the second half of a period is minus its first, so that one period is enough."""
    if half_wave or N % 2 or len(excitation) < N:
        return ""
    if not repetition(excitation[:N], N // 2, sign=-1).is_as_stated:
        return ""
    return (
        f". The second half of {_span(N, log)} is minus the first: with period_samples: {N} and "
        "half_wave: true one period is enough"
    )


def _span(samples: float, log: Log) -> str:
    shown = round(samples, 2)
    seconds = "" if log.rate_hz is None else f" ({shown / log.rate_hz:.6g} s)"
    return f"{shown:.8g} samples{seconds}"
