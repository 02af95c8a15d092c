"""Which periods of a record can be trusted: transients at its start and single bad periods are left out with a word.

Each channel of each period has a distance from the other periods, relative to the size of its spectrum,

    D_p = median over q of ||X_p - X_q|| / ||X||,   ||X||^2 = sum_k |X(k)|^2

and is far where D_p exceeds the median distance by outlier_sigma robust standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.errors import DataError
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra

# Fewer periods do not tell which of them is the odd one out.
_FEWEST_FOR_OUTLIERS = 5
# A period this close to the others is as good as they are, however exactly they agree.
_NEGLIGIBLE = 1e-4
# Distances scatter at least by this part of their median; few periods alone would sometimes say less by chance.
_LEAST_SPREAD = 0.1
# So many lines, evenly taken, tell a distance as well as all.
_ENOUGH_LINES = 500


@dataclass(frozen=True)
class Distances:
    """D (P, c) of every period and channel, what is typical (c,) of good periods, and the limit (c,) for far ones."""

    D: FloatArray
    typical: FloatArray
    limit: FloatArray

    @property
    def far(self) -> BoolArray:
        """Periods (P,) that are far in any channel."""
        far: BoolArray = np.any(np.maximum(self.limit, _NEGLIGIBLE) < self.D, axis=1)
        return far


def trusted(spectra: PeriodSpectra, spec: EstimatorSpec) -> PeriodSpectra:
    """The periods that can be used, at least two; notes say which were left out and by how much they differ.

    Raises DataError where transient_periods leaves fewer than two.
    """
    spectra = _without_left_out(spectra)
    P = len(spectra.periods)
    if spec.transient_periods != "auto":
        if P - spec.transient_periods < 2:
            raise DataError(
                f"record {spectra.record.name}: transient_periods {spec.transient_periods} leaves "
                f"{max(0, P - spec.transient_periods)} of {P} periods; at least two are needed for the noise level"
            )
        settled = _only(spectra, np.arange(spec.transient_periods, P), ())
    else:
        settled = _without_transient(spectra, spec.outlier_sigma)
    return _without_outliers(settled, spec.outlier_sigma)


def _without_left_out(spectra: PeriodSpectra) -> PeriodSpectra:
    """What the repair of the log could not save; it has said so."""
    keep = ~np.isin(spectra.periods, spectra.record.left_out)
    if keep.sum() < 2:
        raise DataError(f"record {spectra.record.name}: fewer than two periods are left after its repair")
    return spectra if keep.all() else _only(spectra, np.flatnonzero(keep), ())


def distances(Z: ComplexArray, good: IntArray, outlier_sigma: float) -> Distances:
    """Distances of all periods of Z (P, F, c) from the good ones (indices), of a good one from the other good ones.

    Their spread is the median absolute deviation of D over the good periods, but at least what as many lines as
    carry the noise would show.
    """
    X = np.moveaxis(Z, 2, 0)
    products = (X @ np.swapaxes(X, 1, 2).conj()).real
    power = np.einsum("cpp->cp", products)
    size = np.maximum(np.median(power[:, good], axis=1), 1e-300)[:, None, None]
    apart = np.sqrt(np.maximum(power[:, :, None] + power[:, None, :] - 2 * products, 0.0) / size)
    apart[:, np.arange(len(Z)), np.arange(len(Z))] = np.nan
    D = np.nanmedian(apart[:, :, good], axis=2).T
    typical = np.median(D[good], axis=0)
    spread = 1.4826 * np.median(np.abs(D[good] - typical), axis=0)
    noise = np.sum(np.abs(Z[good] - Z[good].mean(axis=0)) ** 2, axis=0)
    share = noise / np.maximum(noise.sum(axis=0), 1e-300)
    # A noise that only few lines carry scatters more: 1 / sum of share^2 is their number.
    least = typical * np.maximum(_LEAST_SPREAD, 0.5 * np.linalg.norm(share, axis=0))
    return Distances(D, typical, typical + outlier_sigma * np.maximum(spread, least))


def _without_transient(spectra: PeriodSpectra, outlier_sigma: float) -> PeriodSpectra:
    P = len(spectra.periods)
    later = np.arange(P - max(2, -(-P // 2)), P)
    if later[0] == 0:
        return spectra
    found = distances(_channels(spectra), later, outlier_sigma)
    leading = int(np.argmin(np.append(found.far[: later[0]], False)))
    if leading == 0:
        return spectra
    word = _word(spectra, np.arange(leading), found, "a transient")
    if leading == later[0]:
        word += "; it may last longer than half of the record: measure more periods"
    return _only(spectra, np.arange(leading, P), (word,))


def _without_outliers(spectra: PeriodSpectra, outlier_sigma: float) -> PeriodSpectra:
    P = len(spectra.periods)
    if P < _FEWEST_FOR_OUTLIERS:
        return spectra
    found = distances(_channels(spectra), np.arange(P), outlier_sigma)
    if not found.far.any():
        return spectra
    word = _word(spectra, np.flatnonzero(found.far), found, "no repetition of the others")
    return _only(spectra, np.flatnonzero(~found.far), (word,))


def _channels(spectra: PeriodSpectra) -> ComplexArray:
    step = -(-spectra.Z.shape[1] // _ENOUGH_LINES)
    return spectra.Z[:, ::step]


def _only(spectra: PeriodSpectra, keep: IntArray, words: tuple[str, ...]) -> PeriodSpectra:
    return replace(
        spectra,
        periods=spectra.periods[keep],
        Z=spectra.Z[keep],
        notes=spectra.notes + words,
    )


def _word(spectra: PeriodSpectra, left_out: IntArray, found: Distances, what: str) -> str:
    record = spectra.record
    kind = "half period" if record.half_wave else "period"
    channels = [f"y {name}" for name in record.outputs] + [f"u {name}" for name in record.inputs]
    worst = int(np.argmax((found.D[left_out] / np.maximum(found.limit, _NEGLIGIBLE)).max(axis=0)))
    numbers = spectra.periods[left_out] + 1
    total = record.n_samples // record.repeat_samples
    when = ""
    if record.rate_is_known:
        length = record.repeat_samples / record.rate_hz
        when = f" (from {_listed([f'{(n - 1) * length:.6g} s' for n in numbers])})"
    by = _listed([f"{100 * d:.2g} %" for d in found.D[left_out, worst]])
    return (
        f"record {record.name}: {kind}{'s' if len(numbers) > 1 else ''} {_listed([str(n) for n in numbers])} of {total}"
        f"{when} left out as {what}: {by} away from the other periods in {channels[worst]}, "
        f"where {100 * found.typical[worst]:.2g} % is usual"
    )


def _listed(items: Sequence[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
