r"""Periods of a record that can be used: transients and single bad periods are left out where they matter.

Each channel of each period has a distance from the other periods, relative to the size of its spectrum,

    D_p = median over q of ||X_p - X_q|| / ||X||,   ||X||^2 = sum_k |X(k)|^2

and is far where D_p exceeds the median distance by outlier_sigma robust standard deviations.  A transient is looked for
in units of the noise, too, which periods in the second half of the log have at each line: it is slow, and the noise of
an acceleration fast.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, starmap

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.base.errors import DataError, Note
from elastid.base.statistics import STD_OVER_MAD, mean_of_neighbours
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra
from elastid.record import Record

# Limits of periods left out.
MAX_ASYMMETRY = 1.5  # distance of the first period from the second half over that of the last from the first
MIN_PERIODS = 5  # an outlier cannot be identified among fewer
NEGLIGIBLE_DISTANCE = 1e-4  # of a period that is as good as the others, however exactly they agree
MIN_SPREAD = 0.1  # of distances over their median, at least; few periods would sometimes show less by chance
LOG_SCATTER = 0.8  # of ln D sqrt(n_noisy): 1/2 where lines are independent, which those of a wander are not
MIN_DISTANCE = 4.0  # typical distances in units of the noise, at least; two of 90 clean sets have 2.6
DISTANCE_LINES = 120  # evenly taken, that give a distance as well as all
MAX_PAIRS = 1 << 19  # of periods that are compared; of more, each with fewer others, down to
MIN_COMPARED = 32
PREDICTION_ORDER = 8  # of the prediction of noise from its samples before
# Power of what it does not predict, in the first eighth of a difference over that in the second half: 1 of noise
# and wander, 42 in one of 16 clean sets, 700 to 1e7 where a log began with its excitation.
MAX_SETTLING = 300.0
MIN_UNSETTLED = 1e-3  # of a signal, that its difference between two periods has in the first eighth, at least
TRANSIENT_DISCARDED = "frf/transient-discarded"


@dataclass(frozen=True)
class Distances:
    """D (P, c) of every period and channel, its typical value (c,) in good periods, and the limit (c,) of far ones."""

    D: FloatArray
    typical: FloatArray
    limit: FloatArray

    @property
    def far(self) -> BoolArray:
        """Periods (P,) that are far in any channel."""
        return np.asarray(np.any(np.maximum(self.limit, NEGLIGIBLE_DISTANCE) < self.D, axis=1))


@dataclass(frozen=True)
class ComparedPeriods:
    """X (c, P, 2 K): real and imaginary parts of each channel at up to 500 lines.

    power (c, P): sums of its squares; distance (c, P, Q): the distance of each period from Q of them, in general all.
    references (Q,): their indices.  outlier_sigma: threshold of far ones, in standard deviations.  is_weighed: X is in
    units of its noise.
    """

    X: FloatArray
    power: FloatArray
    distance: FloatArray
    references: IntArray
    outlier_sigma: float
    is_weighed: bool = False

    @classmethod
    def from_spectra(cls, spectra: PeriodSpectra, outlier_sigma: float) -> "ComparedPeriods":
        """Return all periods of a record with each other, or of a long one with some."""
        some_lines = spectra.on(slice(None, None, -(-len(spectra.scale) // DISTANCE_LINES)))
        amplitudes = np.empty((some_lines.z.shape[2], *some_lines.z.shape[:2]), dtype=np.complex128)
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
        """Divide spectra by the noise of the good periods at each line and its neighbours; good (k,): their indices."""
        c, _, n = self.X.shape
        of_good = self.X[:, good]
        V = of_good - of_good.mean(axis=1, keepdims=True)
        noise = np.einsum("cpk,cpk->kc", V, V).reshape(n // 2, 2, c).sum(axis=1)
        smooth = mean_of_neighbours(noise) + NEGLIGIBLE_DISTANCE**2 * (self.power[:, good].sum(axis=1) / (n // 2))
        weight = np.repeat(1 / np.sqrt(np.maximum(smooth, 1e-300)), 2, axis=0).T
        return replace(self._from_amplitudes(self.X * weight[:, None], self.outlier_sigma), is_weighed=True)

    @cached_property
    def agree(self) -> bool:
        """True if none can be far, whichever are good: the largest distance is within the limit of the smallest."""
        is_other = np.arange(self.distance.shape[1])[:, None] != self.references
        min_distance = np.min(self.distance, axis=(1, 2), where=is_other, initial=np.inf)
        ratio = float(np.max(self.distance.max(axis=(1, 2)) / np.maximum(min_distance, 1e-300)))
        return ratio < 1 + self.outlier_sigma * MIN_SPREAD


def select_periods(spectra: PeriodSpectra, spec: EstimatorSpec) -> PeriodSpectra:
    """Return the periods that can be used, at least two; notes report those left out and their distances.

    Raises DataError where transient_periods leaves fewer than two.
    """
    record = spectra.record
    spectra = spectra.only(
        np.array([i for i, p in enumerate(spectra.periods) if p not in record.discarded_periods], dtype=int)
    )
    P = len(spectra.periods)
    if P < 2:
        raise DataError(
            "frf/periods", "fewer than two periods remain after its correction. Measure more", f"record {record.name}"
        )
    comparable = ComparedPeriods.from_spectra(spectra, spec.outlier_sigma)
    logs = list(starmap(np.arange, pairwise([0, *np.searchsorted(spectra.periods, record.starts).tolist(), P])))
    if spec.transient_periods == "auto":
        leading, notes = _transient(spectra, comparable, logs)
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
    """Return the second period of a log of two whose first begins with a transient; else the log.

    Of two periods none is far from the others, but their difference decays.
    """
    L = record.period_samples
    if record.n_repeats != 2 or record.half_wave or record.starts:
        return record
    signals = np.concatenate([record.u, record.y], axis=1)
    if not any(map(_decays, (signals[:L] - signals[L : 2 * L]).T, signals.std(axis=0))):
        return record
    return record.part(slice(L, 2 * L), discarded_periods=())


def _decays(difference: FloatArray, size: float) -> bool:
    """Return True for a signal (n,) whose beginning no linear prediction explains that explains its second half.

    False of signals that are too short for a prediction.
    size: of the signal whose difference between two periods it is.
    """
    if len(difference) < 32 * PREDICTION_ORDER or difference[: len(difference) // 8].std() <= MIN_UNSETTLED * size:
        return False
    rows = np.lib.stride_tricks.sliding_window_view(difference, PREDICTION_ORDER + 1)
    X, half = np.column_stack([rows[:, :-1], np.ones(len(rows))]), len(rows) // 2
    power = (rows[:, -1] - X @ np.linalg.lstsq(X[half:], rows[half:, -1], rcond=None)[0]) ** 2
    late_power = float(power[half:].mean())
    return late_power > 0 and float(power[: len(power) // 8].mean()) > MAX_SETTLING * late_power


def distances(compared: ComparedPeriods, good: IntArray) -> Distances:
    """Return distances of all periods from the good ones (indices), of a good one from the other good ones.

    Their spread is the median absolute deviation of D over the good periods, but at least that of a noise on as many
    lines as carry it, which are counted only where a period is far without them.
    """
    size = np.sqrt(np.maximum(np.median(compared.power[:, good], axis=1), 1e-300))
    D = _leave_one_out_median(compared, good) / size
    typical = np.median(D[good], axis=0)
    spread = STD_OVER_MAD * np.median(np.abs(D[good] - typical), axis=0)
    limit = typical + compared.outlier_sigma * np.maximum(spread, MIN_SPREAD * typical)
    distant = Distances(D, typical, limit)
    if not distant.far.any():
        return distant
    # Noise on few lines, such as a slow wander, scatters more: the logarithms of distances by 0.8 / sqrt(n_noisy).
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
    """Return the median (P, c), over good periods that are references, of each period's distances to these."""
    columns = np.flatnonzero(np.isin(compared.references, good))
    of_good = compared.distance[:, :, columns]
    of_good[:, compared.references[columns], np.arange(len(columns))] = np.nan
    return np.nanmedian(of_good, axis=2).T


def _flags(P: int, indices: Sequence[IntArray]) -> BoolArray:
    flags = np.zeros(P, dtype=np.bool_)
    flags[np.concatenate(indices)] = True
    return flags


def _transient(
    spectra: PeriodSpectra, compared: ComparedPeriods, logs: Sequence[IntArray]
) -> tuple[BoolArray, tuple[Note, ...]]:
    """Return flags (P,) of the periods at the start of each log that are a transient; logs: their periods."""
    P = len(spectra.periods)
    halves = [log[: len(log) - max(2 if len(logs) == 1 else 1, -(-len(log) // 2))] for log in logs]
    later = np.flatnonzero(~_flags(P, halves))
    if len(later) == P:
        return np.zeros(P, dtype=np.bool_), ()
    leading, notes = _leading(spectra, compared, logs, halves, later)
    return (leading, notes) if leading.any() else _leading(spectra, compared.weigh(later), logs, halves, later)


def _leading(
    spectra: PeriodSpectra,
    compared: ComparedPeriods,
    logs: Sequence[IntArray],
    halves: Sequence[IntArray],
    later: IntArray,
) -> tuple[BoolArray, tuple[Note, ...]]:
    """Return the transient as `_transient` does, from compared distances. halves: per log. later: all others."""
    P = len(spectra.periods)
    none = np.zeros(P, dtype=np.bool_)
    if compared.agree:
        return none, ()
    measured = distances(compared, later)
    if compared.is_weighed:
        measured = replace(measured, limit=np.maximum(measured.limit, MIN_DISTANCE * measured.typical))
    if len(logs) == 1:  # a slow wander is as far from the other half at its end
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
