"""One configuration's records, one at a time, to what its estimators need: mean spectra and the scatter of periods."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.frf.periods import trusted
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import period_spectra, reference_spectrum
from elastid.record import Record


@dataclass(frozen=True)
class Block:
    """The E experiments of one realisation (or of several), as means over their periods.

    U (F, n_u, E), Y (F, n_y, E).  R (F, n_u, E): the torque that was injected, or None.  periods (E,): how many.
    """

    U: ComplexArray
    Y: ComplexArray
    R: ComplexArray | None
    periods: FloatArray

    def on(self, lines: BoolArray) -> Block:
        """The same on some of its lines (F,)."""
        if lines.all():
            return self
        return Block(self.U[lines], self.Y[lines], None if self.R is None else self.R[lines], self.periods)


@dataclass(frozen=True)
class Scatter:
    """S_Z (F, n_y + n_u, n_y + n_u): sum over periods of (Z - mean)(Z - mean)^H, Z = [Y; U]; expectation dof C_Z."""

    S_Z: ComplexArray
    dof: int

    def on(self, lines: BoolArray) -> Scatter:
        """The same on some of its lines (F,)."""
        return self if lines.all() else Scatter(self.S_Z[lines], self.dof)

    @property
    def C_Z(self) -> ComplexArray:
        """Covariance of [Y; U] in one period."""
        return self.S_Z / self.dof


@dataclass(frozen=True)
class Gathered:
    """A block for each realisation with the scatter of its periods, at the excited and at the detection lines."""

    blocks: tuple[Block, ...]
    scatters: tuple[Scatter, ...]
    detection: tuple[Block, ...]
    detection_scatter: Scatter
    notes: tuple[str, ...]


@dataclass
class _Sums:
    """What is added up over the experiments of one realisation."""

    S_Z: ComplexArray | float = 0.0
    dof: int = 0

    def add(self, Z: ComplexArray) -> ComplexArray:
        """Adds the scatter of Z (P, F, n); returns the mean (F, n)."""
        mean: ComplexArray = Z.mean(axis=0)
        V = np.moveaxis(Z - mean, 0, 2)
        self.S_Z = self.S_Z + V @ np.swapaxes(V, 1, 2).conj()
        self.dof += len(Z) - 1
        return mean

    def scatter(self) -> Scatter:
        return Scatter(np.asarray(self.S_Z), self.dof)


def gathered(
    realisations: Iterable[Sequence[Record]],
    lines: IntArray,
    detection: IntArray,
    spec: EstimatorSpec,
    with_reference: bool = False,
) -> Gathered:
    """Mean spectra at lines (F,) and at detection lines (K,), of one record after another; of r too if asked for."""
    everywhere = np.union1d(lines, detection)
    is_excited = np.isin(everywhere, lines)
    blocks: list[Block] = []
    detected: list[Block] = []
    scatters: list[Scatter] = []
    notes: list[str] = []
    at_detection = _Sums()
    for group in realisations:
        at_lines, means, more, R, periods = _Sums(), [], [], [], []
        for record in group:
            spectra = period_spectra(record, everywhere, spec.quantity)
            kept = trusted(spectra.on(is_excited), spec)
            notes += kept.notes
            periods.append(len(kept.periods))
            means.append(at_lines.add(np.concatenate([kept.Y, kept.U], axis=2)))
            if detection.size:
                rest = spectra.on(~is_excited)
                more.append(at_detection.add(np.concatenate([rest.Y, rest.U], axis=2)[kept.periods]))
            R.append(reference_spectrum(record, lines) if with_reference else None)
        n_y = len(group[0].outputs)
        blocks.append(_block(means, R, periods, n_y))
        scatters.append(at_lines.scatter())
        if detection.size:
            detected.append(_block(more, [None], periods, n_y))
    return Gathered(tuple(blocks), tuple(scatters), tuple(detected), at_detection.scatter(), tuple(notes))


def _block(means: Sequence[ComplexArray], R: Sequence[ComplexArray | None], periods: Sequence[int], n_y: int) -> Block:
    Z = np.stack(means, axis=2)
    known = [each for each in R if each is not None]
    reference = np.stack(known, axis=2) if len(known) == len(means) else None
    return Block(
        np.ascontiguousarray(Z[:, n_y:]), np.ascontiguousarray(Z[:, :n_y]), reference, np.array(periods, dtype=float)
    )


def pooled(blocks: Sequence[Block]) -> Block:
    """All experiments of all realisations as one block."""
    R = [each.R for each in blocks if each.R is not None]
    return Block(
        np.concatenate([each.U for each in blocks], axis=2),
        np.concatenate([each.Y for each in blocks], axis=2),
        np.concatenate(R, axis=2) if len(R) == len(blocks) else None,
        np.concatenate([each.periods for each in blocks]),
    )
