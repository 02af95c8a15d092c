"""The period of one file's excitation: stated, found in its torques, or none; and the check that it repeats."""

from __future__ import annotations

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.recorded.periodicity import LIMITS, find_period, repetition
from elastid.recorded.repair import Finding, Log
from elastid.recorded.repair.clock import CLOCK

NO_LINES = (
    "it does not repeat: there is no FRF of lines in it. With period: none the whole record is one transient, of which "
    "estimator.method local_rational, local_polynomial or h1 make a response where the torque has power"
)


def period_samples(recorded: RecordedSpec, file: FileSpec, rate_hz: float, drivers: FloatArray) -> float | None:
    """Samples of the period at rate_hz, not always whole; None without one.

    drivers (n, d): torques at that rate, NaN where missing, in which a period is searched for where the study says so.
    Raises DataError where none is found.
    """
    stated = recorded.period_of(file)
    if stated is None:
        return None
    if stated != "find":
        return rounded_samples(stated * rate_hz / recorded.known_rate_hz)
    best = find_period(drivers)
    if not best.best_samples:
        raise DataError(
            f"{file.path}: no period was found in it (best correlation {best.best_correlation:.2f}, "
            f"{LIMITS.min_correlation:g} is needed, where two periods fit): {NO_LINES}"
        )
    N = round(best.best_samples)
    # The generator's clock is right where its periods are whole: the log is then resampled to it.
    is_whole = len(drivers) >= 2 * N and abs(best.best_samples - N) <= CLOCK.max_error * N
    return float(N) if is_whole else rounded_samples(best.best_samples)


def advised_period(drivers: FloatArray) -> float | None:
    """The period of drivers (n, d) of a record that was stated without one; None where they have none."""
    best = find_period(drivers)
    return best.best_samples if best.best_correlation >= LIMITS.min_correlation and best.best_samples else None


def grid_samples(period: float, half_wave: bool) -> int:
    """The whole number of samples nearest to a period; an even one where half of it counts."""
    return 2 * round(period / 2) if half_wave and period != round(period) else round(period)


def found_period(period: float, rate_hz: float | None) -> Finding:
    """The period that the study left to be found, as a finding."""
    seconds = "" if rate_hz is None else f" ({period / rate_hz:.8g} s)"
    return Finding("periods found", 1, f"the torques repeat every {period:.8g} samples{seconds}: taken as the period")


def rounded_samples(samples: float) -> float:
    """Samples of a period, whole where they are within one millionth of it."""
    N = round(samples)
    return float(N) if abs(samples - N) <= 1e-6 * samples else samples


def check_repeat(excitation: FloatArray, N: int, half_wave: bool, log: Log) -> None:
    """DataError where the excitation (n, n_u), NaN where missing, does not repeat as stated, or not often enough."""
    n, path = len(excitation), log.where
    repeat, sign = (N // 2, -1) if half_wave else (N, 1)
    if n < LIMITS.min_periods * repeat:
        needed = "one period is" if half_wave else "two periods are"
        raise DataError(
            f"{path}: {_span(n, log)} are {n / N:.3g} periods of {_span(N, log)}; at least "
            f"{needed} needed{_half_wave_hint(excitation, N, half_wave, log) or _shorter(excitation, log)}"
        )
    result = repetition(excitation, repeat, sign)
    if result.is_as_stated:
        return
    stated = "second half minus first" if half_wave else "one period to the next"
    problem = (
        f"{path}: the excitation does not repeat with the period of {_span(N, log)} that the study states "
        f"(correlation {result.correlation:.3f}, {stated})"
    )
    if result.best_samples:
        raise DataError(
            f"{problem}; it repeats every {_span(result.best_samples, log)} (correlation "
            f"{result.best_correlation:.3f}): correct the period or the rate"
        )
    hint = _half_wave_hint(excitation, 2 * repeat, half_wave, log)
    raise DataError(
        f"{problem}, nor at any other lag (best correlation {result.best_correlation:.3f}){hint}; with a period "
        f"elastid needs a periodic excitation{'' if hint else f'; {NO_LINES}'}"
    )


def _shorter(excitation: FloatArray, log: Log) -> str:
    """The end of a message on too few periods: a shorter period that fits, or the ways to do without one."""
    period = find_period(excitation).best_samples
    return f". It repeats every {_span(period, log)}: correct the period or the rate" if period else f", and {NO_LINES}"


def _half_wave_hint(excitation: FloatArray, N: int, half_wave: bool, log: Log) -> str:
    """The end of a message where the second half of a period is minus its first, so that one period is enough."""
    if half_wave or N % 2 or len(excitation) < N or not repetition(excitation[:N], N // 2, sign=-1).is_as_stated:
        return ""
    return (
        f". The second half of {_span(N, log)} is minus the first: with period_samples: {N} and "
        "half_wave: true one period is enough"
    )


def _span(samples: float, log: Log) -> str:
    shown = round(samples, 2)
    seconds = "" if log.rate_hz is None else f" ({shown / log.rate_hz:.6g} s)"
    return f"{shown:.8g} samples{seconds}"
