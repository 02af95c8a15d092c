"""The period of one file's excitation: stated, found in its torques, or none; and its grid of whole samples."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.recorded.periodicity import MIN_CORRELATION, find_period
from elastid.recorded.repair.clock import MAX_CLOCK_ERROR
from elastid.recorded.repair.finding import Finding, Repaired
from elastid.recorded.repair.sample_times import at_times

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
