"""The period of one file's excitation: stated, found in its torques, or none; and the check that it repeats."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.recorded.periodicity import MIN_CORRELATION, MIN_PERIODS, find_period, repetition
from elastid.recorded.repair import Finding, Log, Repaired
from elastid.recorded.repair.clock import MAX_CLOCK_ERROR, at_times

FOUND = "periods found"
# Samples of a period are whole to this part of them.
_WHOLE_TOLERANCE = 1e-6
# A resampled sample counts as missing where missing ones have this part in it.
_MAX_MISSING_SHARE = 0.02
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
        return _rounded(stated * rate_hz / recorded.known_rate_hz)
    found = find_period(drivers)
    if not found.best_samples:
        raise DataError(
            f"{file.path}: no period was found in it (best correlation {found.best_correlation:.2f}, "
            f"{MIN_CORRELATION:g} is needed, where two periods fit): {NO_LINES}"
        )
    whole = round(found.best_samples)
    # The generator's clock is right where its periods are whole: the log is then resampled to it.
    is_whole = len(drivers) >= 2 * whole and abs(found.best_samples - whole) <= MAX_CLOCK_ERROR * whole
    return float(whole) if is_whole else _rounded(found.best_samples)


def advised_period(drivers: FloatArray) -> float | None:
    """The period of drivers (n, d) of a record that was stated without one; None where they have none."""
    found = find_period(drivers)
    return found.best_samples if found.best_correlation >= MIN_CORRELATION and found.best_samples else None


def grid_samples(period: float, half_wave: bool) -> int:
    """The whole number of samples nearest to a period; an even one where half of it counts."""
    return 2 * round(period / 2) if half_wave and period != round(period) else round(period)


def at_whole_samples(signals: FloatArray, period: float, N: int) -> FloatArray:
    """Signals (n, c), NaN where missing, interpolated so that a period of a fraction of samples has N of them."""
    if period == N:
        return signals
    missing = ~np.isfinite(signals)
    rows = np.arange(len(signals), dtype=np.float64)
    known = [np.flatnonzero(good) for good in (~missing).T]
    bridged = [np.interp(rows, k, x[k]) if k.size else np.zeros(len(x)) for k, x in zip(known, signals.T, strict=True)]
    times = np.arange(int((len(signals) - 1) * N / period) + 1, dtype=np.float64) * (period / N)
    both = at_times(np.concatenate([np.stack(bridged, axis=1), missing], axis=1), times, period, min(1.0, N / period))
    values, touched = np.split(both, 2, axis=1)
    return np.where(np.abs(touched) > _MAX_MISSING_SHARE, np.nan, values)


def with_whole_end(signals: FloatArray, L: int) -> Repaired:
    """Signals (n, c) of fewer than two whole repetitions, the missing end of the second as missing samples (NaN)."""
    lacking = 2 * L - len(signals)
    if not 0 < lacking < L:
        return Repaired(signals)
    text = (
        f"{len(signals)} samples are {len(signals) / L:.2f} repetitions of {L}: {len(signals) - L} of them repeat and "
        f"give the noise, the last {lacking} are taken from the first repetition"
    )
    end = np.full((lacking, signals.shape[1]), np.nan)
    return Repaired(np.concatenate([signals, end]), (Finding("incomplete periods", 1, text),))


def found_period(period: float, rate_hz: float | None) -> Finding:
    """The period that the study left to be found, as a finding."""
    seconds = "" if rate_hz is None else f" ({period / rate_hz:.8g} s)"
    return Finding(FOUND, 1, f"the torques repeat every {period:.8g} samples{seconds}: taken as the period")


def _rounded(samples: float) -> float:
    whole = round(samples)
    return float(whole) if abs(samples - whole) <= _WHOLE_TOLERANCE * samples else samples


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
