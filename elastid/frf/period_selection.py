r"""Selection of the usable periods of a record: transients and single outliers are discarded.

Each channel of each period has a distance from the other periods, relative to the norm of its spectrum,

    D_p = median over q of ||X_p - X_q|| / ||X||,   ||X||^2 = sum_k |X(k)|^2

and is far if D_p exceeds the median distance by outlier_sigma robust standard deviations.  A transient is also searched
for in spectra relative to the noise at each line, estimated from the periods in the second half of the log, because the
noise of accelerations would hide a slow transient.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, starmap

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray, mean_of_neighbours
from elastid.base.errors import DataError, Note
from elastid.base.statistics import STD_OVER_MAD
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra
from elastid.record import Record

# Limits of the selection.
MAX_ASYMMETRY = 1.5  # ratio of the distances of the first and the last period from the other half of the log
MIN_PERIODS = 5  # least number of periods for the detection of an outlier
NEGLIGIBLE_DISTANCE = 1e-4  # distance that is never far
MIN_SPREAD = 0.1  # least std of the distances relative to their median, since few periods can have less by chance
LOG_SCATTER = 0.8  # std of ln D times sqrt(n_noisy): 1/2 for independent lines, more for a slow drift
MIN_DISTANCE = 4.0  # least far distance relative to the typical one, in units of the noise; 2.6 in 90 clean sets
DISTANCE_LINES = 120  # number of evenly spaced lines for a distance
MAX_PAIRS = 1 << 19  # largest number of compared pairs of periods; each period is compared with fewer others,
MIN_COMPARED = 32  # but at least with this number
PREDICTION_ORDER = 8  # order of the linear prediction of noise
# Largest ratio of the prediction errors in the first eighth and the second half of a difference: 1 for noise and drift,
# 42 in 16 clean sets, 700 to 1e7 for a log that began with its excitation.
MAX_SETTLING = 300.0
MIN_UNSETTLED = 1e-3  # least std of a difference in the first eighth, relative to the signal
TRANSIENT_DISCARDED = "frf/transient-discarded"


@dataclass(frozen=True)
class Distances:
    """Distances D (P, c) of periods and channels, their typical value (c,) for good periods, and the limit (c,)."""

    D: FloatArray
    typical: FloatArray
    limit: FloatArray

    @property
    def far(self) -> BoolArray:
        """True for periods (P,) that are far in any channel."""
        return np.asarray(np.any(np.maximum(self.limit, NEGLIGIBLE_DISTANCE) < self.D, axis=1))


@dataclass(frozen=True)
class ComparedPeriods:
    """Spectra X (c, P, 2 K) of channels and periods at K lines, real and imaginary parts, with their distances.

    power (c, P): sums of squares.  distance (c, P, Q): of each period from Q reference periods, mostly all.
    references (Q,): their indices.  outlier_sigma: limit in standard deviations.  is_weighed: True for X relative to
    the noise.
    """

    X: FloatArray
    power: FloatArray
    distance: FloatArray
    references: IntArray
    outlier_sigma: float
    is_weighed: bool = False

    @classmethod
    def from_spectra(cls, spectra: PeriodSpectra, outlier_sigma: float) -> "ComparedPeriods":
        """Compare all periods of a record with each other, or, for many periods, with some of them."""
        some_lines = spectra.on(slice(None, None, -(-len(spectra.scale) // DISTANCE_LINES)))
        amplitudes = np.empty((some_lines.z.shape[2], *some_lines.z.shape[:2]), np.complex128)
        np.multiply(np.moveaxis(some_lines.z, 2, 0), some_lines.scale.T[:, None], out=amplitudes)
        return cls._from_amplitudes(amplitudes.view(np.float64), outlier_sigma)

    @classmethod
    def _from_amplitudes(cls, X: FloatArray, outlier_sigma: float) -> "ComparedPeriods":
        P = X.shape[1]
        references = np.linspace(0, P - 1, min(P, max(MIN_COMPARED, MAX_PAIRS // P))).round().astype(int)
        power = np.einsum("cpk,cpk->cp", X, X)
        squares = power[:, :, None] + power[:, None, references] - 2 * X @ np.swapaxes(X[:, references], 1, 2)
        return cls(X, power, np.sqrt(np.maximum(squares, 0.0)), references, outlier_sigma)

    def weigh(self, good: IntArray) -> "ComparedPeriods":
        """Return the spectra relative to the smoothed noise of the good periods at each line; good (k,): indices."""
        c, _, n = self.X.shape
        of_good = self.X[:, good]
        V = of_good - of_good.mean(axis=1, keepdims=True)
        noise = np.einsum("cpk,cpk->kc", V, V).reshape(n // 2, 2, c).sum(axis=1)
        smooth = mean_of_neighbours(noise) + NEGLIGIBLE_DISTANCE**2 * (self.power[:, good].sum(axis=1) / (n // 2))
        weight = np.repeat(1 / np.sqrt(np.maximum(smooth, 1e-300)), 2, axis=0).T
        return replace(self._from_amplitudes(self.X * weight[:, None], self.outlier_sigma), is_weighed=True)

    @cached_property
    def agree(self) -> bool:
        """True if no period can be far for any choice of good ones: all distances are within the smallest limit."""
        is_other = np.arange(self.distance.shape[1])[:, None] != self.references
        min_distance = np.min(self.distance, axis=(1, 2), where=is_other, initial=np.inf)
        ratio = float(np.max(self.distance.max(axis=(1, 2)) / np.maximum(min_distance, 1e-300)))
        return ratio < 1 + self.outlier_sigma * MIN_SPREAD


def select_periods(spectra: PeriodSpectra, spec: EstimatorSpec) -> PeriodSpectra:
    """Return at least two usable periods; notes report discarded periods and their distances.

    Raises DataError if transient_periods leaves fewer than two.
    """
    record = spectra.record
    spectra = spectra.only(
        np.array([i for i, p in enumerate(spectra.periods) if p not in record.discarded_periods], int)
    )
    P = len(spectra.periods)
    if P < 2:
        raise DataError(
            "frf/periods", "fewer than two periods remain after its correction. Measure more", f"record {record.name}"
        )
    comparable = ComparedPeriods.from_spectra(spectra, spec.outlier_sigma)
    logs = list(starmap(np.arange, pairwise([0, *np.searchsorted(spectra.periods, record.starts).tolist(), P])))
    if spec.transient_periods == "auto":
        leading, notes = _transient_periods(spectra, comparable, logs)
    else:
        leading, notes = _flags(P, [log[: spec.transient_periods] for log in logs]), ()
    steady = np.flatnonzero(~leading)
    if len(steady) < 2:
        raise DataError(
            "frf/periods",
            f"transient_periods {spec.transient_periods} leaves {len(steady)} of {P} periods; at least two are "
            "needed to estimate the noise. Lower transient_periods",
            f"record {record.name}",
        )
    far = steady[:0]
    further_notes: tuple[Note, ...] = ()
    if len(steady) >= MIN_PERIODS and not comparable.agree:
        measured = distances(comparable, steady)
        far = steady[measured.far[steady]]
        further_notes = (_note(spectra, far, measured, "the other periods"),) if len(far) else ()
    selection = spectra.only(np.setdiff1d(steady, far) if len(far) else steady)
    return replace(selection, notes=(*spectra.notes, *notes, *further_notes))


def without_transient(record: Record) -> Record:
    """Return the second period of a log with two periods if the first begins with a transient; else the log.

    With two periods no outlier can be identified, but the difference of the periods decays.
    """
    L = record.period_samples
    if record.n_repeats != 2 or record.half_wave or record.starts:
        return record
    signals = np.concatenate([record.u, record.y], axis=1)
    if not any(map(_decays, (signals[:L] - signals[L : 2 * L]).T, signals.std(axis=0))):
        return record
    return record.part(slice(L, 2 * L), discarded_periods=())


def _decays(difference: FloatArray, size: float) -> bool:
    """Return True if the linear prediction of the second half of a difference (n,) fails at its beginning.

    False for signals that are too short for a prediction.  size: std of the signal of which it is a difference.
    """
    if len(difference) < 32 * PREDICTION_ORDER or difference[: len(difference) // 8].std() <= MIN_UNSETTLED * size:
        return False
    rows = np.lib.stride_tricks.sliding_window_view(difference, PREDICTION_ORDER + 1)
    X, half = np.column_stack([rows[:, :-1], np.ones(len(rows))]), len(rows) // 2
    power = (rows[:, -1] - X @ np.linalg.lstsq(X[half:], rows[half:, -1], rcond=None)[0]) ** 2
    late_power = float(power[half:].mean())
    return late_power > 0 and float(power[: len(power) // 8].mean()) > MAX_SETTLING * late_power


def distances(compared: ComparedPeriods, good: IntArray) -> Distances:
    """Return the distances of all periods from the good ones (indices), of a good period from the other good ones.

    The limit follows from the median absolute deviation of D over the good periods. If a period is far by this limit,
    the deviation is at least the deviation of noise with the same number of noisy lines.
    """
    size = np.sqrt(np.maximum(np.median(compared.power[:, good], axis=1), 1e-300))
    D = _leave_one_out_median(compared, good) / size
    typical = np.median(D[good], axis=0)
    spread = STD_OVER_MAD * np.median(np.abs(D[good] - typical), axis=0)
    distant = Distances(D, typical, typical + compared.outlier_sigma * np.maximum(spread, MIN_SPREAD * typical))
    if not distant.far.any():
        return distant
    # Noise on few lines, such as a slow drift, has a larger scatter: ln D has the std 0.8 / sqrt(n_noisy).
    V = compared.X[:, good] - compared.X[:, good].mean(axis=1, keepdims=True)
    noise = np.einsum("cpk,cpk->ck", V, V).reshape(len(V), -1, 2).sum(axis=2)
    fraction = noise / np.maximum(noise.sum(axis=1, keepdims=True), 1e-300)
    n_noisy, sigmas = 1 / np.maximum(np.sum(fraction**2, axis=1), 1e-300), compared.outlier_sigma
    if compared.is_weighed:
        n_noisy = np.full(len(V), fraction.shape[1])
    scatter = LOG_SCATTER * np.sqrt((1 + 2 / len(good)) / n_noisy)
    least = typical * np.maximum(MIN_SPREAD, np.expm1(sigmas * scatter) / sigmas)
    return replace(distant, limit=typical + sigmas * np.maximum(spread, least))


def _leave_one_out_median(compared: ComparedPeriods, good: IntArray) -> FloatArray:
    """Return the median distance (P, c) of each period from the other good reference periods."""
    columns = np.flatnonzero(np.isin(compared.references, good))
    of_good = compared.distance[:, :, columns]
    of_good[:, compared.references[columns], np.arange(len(columns))] = np.nan
    return np.nanmedian(of_good, axis=2).T


def _flags(P: int, indices: Sequence[IntArray]) -> BoolArray:
    flags = np.zeros(P, np.bool_)
    flags[np.concatenate(indices)] = True
    return flags


def _transient_periods(
    spectra: PeriodSpectra, compared: ComparedPeriods, logs: Sequence[IntArray]
) -> tuple[BoolArray, tuple[Note, ...]]:
    """Flag the periods (P,) of a transient at the start of each log; logs: indices of their periods."""
    P = len(spectra.periods)
    halves = [log[: len(log) - max(2 if len(logs) == 1 else 1, -(-len(log) // 2))] for log in logs]
    later = np.flatnonzero(~_flags(P, halves))
    if len(later) == P:
        return np.zeros(P, np.bool_), ()
    leading, notes = _leading_periods(spectra, compared, logs, halves, later)
    return (leading, notes) if leading.any() else _leading_periods(spectra, compared.weigh(later), logs, halves, later)


def _leading_periods(
    spectra: PeriodSpectra, compared: ComparedPeriods, logs: Sequence[IntArray], halves: Sequence[IntArray],
    later: IntArray,
) -> tuple[BoolArray, tuple[Note, ...]]:  # fmt: skip
    """Flag transient periods from their distances. halves: first half of each log. later: all other periods."""
    P = len(spectra.periods)
    none = np.zeros(P, np.bool_)
    if compared.agree:
        return none, ()
    measured = distances(compared, later)
    if compared.is_weighed:
        measured = replace(measured, limit=np.maximum(measured.limit, MIN_DISTANCE * measured.typical))
    if len(logs) == 1:  # a slow drift has equal distances at both ends
        backwards = MAX_ASYMMETRY * distances(compared, P - 1 - later).D[-1]
        if not np.any(replace(measured, limit=np.maximum(measured.limit, backwards)).far & _flags(P, halves)):
            return none, ()
    lengths = [int(np.argmin(np.append(measured.far[half], False))) for half in halves]
    leading = _flags(P, [half[:n] for half, n in zip(halves, lengths, strict=True)])
    if not leading.any():
        return leading, ()
    halves_later = f"the periods in the second half of {'the log' if len(logs) == 1 else 'each log'}"
    note = _note(spectra, np.flatnonzero(leading), measured, halves_later, " as the transient")
    note = replace(note, code=TRANSIENT_DISCARDED, severity="information")
    return leading, (note,)


def _note(spectra: PeriodSpectra, rows: IntArray, measured: Distances, others: str, reason: str = "") -> Note:
    """Return the note on discarded periods (rows of spectra).  others: name of the periods that they differ from."""
    record = spectra.record
    kind = ("half period" if record.half_wave else "period") + "s" * (len(rows) > 1)
    channels = [f"output {name}" for name in record.outputs] + [f"input {name}" for name in record.inputs]
    D, limit = measured.D[rows].max(axis=0), np.maximum(measured.limit, NEGLIGIBLE_DISTANCE)
    worst = int(np.argmax(D / limit))
    numbers = [str(n) for n in spectra.periods[rows] + 1]
    return Note(
        "frf/periods-discarded",
        f"{kind} {', '.join(numbers)} of {record.n_repeats} discarded{reason}: {channels[worst]} deviates from "
        f"{others} by up to {100 * D[worst]:.2g} % of its rms (limit {100 * limit[worst]:.2g} %; median deviation of "
        f"the other periods from each other {100 * measured.typical[worst]:.2g} %)",
        f"record {record.name}",
    )
