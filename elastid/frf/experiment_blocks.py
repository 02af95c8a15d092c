"""Mean spectra of a configuration's experiments and the scatter of their periods, the input of every estimator."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.errors import Note
from elastid.base.kernels import call, is_compiled
from elastid.base.matrices import added_cross_products, inverse
from elastid.frf.period_selection import select_periods
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import (
    PeriodSpectra,
    RecordSpectra,
    amplitude_scale,
    period_groups,
    period_spectra,
    reference_spectrum,
)

BATCH = 8  # of `scatter.c`
# Periods of a large record are compared in so many values: 32 MB.
_MAX_COMPARED_VALUES = 1 << 21


class FullSum:
    """Sum S (F, n, n) of the scatter of periods over experiments, in NumPy; scale (F, n): applied at the end."""

    # The spectra of this number of lines, in all periods of a record, fit into the processor's cache.
    lines_at_once = 256

    def __init__(self, scale: ComplexArray) -> None:
        self.scale, self.dof = scale, 0
        self.S: ComplexArray = np.zeros((*scale.shape, scale.shape[1]), np.complex128)

    def add(self, batch: slice, z: ComplexArray, mean: ComplexArray) -> None:
        """Add the scatter of z (P, f, n) at some lines; write its mean (f, n)."""
        z = np.ascontiguousarray(z)
        mean[:] = z.sum(axis=0) / len(z)
        V = np.moveaxis(z - mean, 0, 2)
        self.S[batch] += V @ V.mT.conj()

    def power(self) -> FloatArray:
        """Return sum (F, n) over periods of |Z - mean|^2."""
        return np.asarray(np.einsum("fii->fi", self.S).real * np.abs(self.scale) ** 2)

    def collect(self) -> ComplexArray:
        """Return sum (F, n, n) over periods of (Z - mean)(Z - mean)^H; S itself is overwritten."""
        self.S *= self.scale[:, :, None]
        self.S *= self.scale[:, None, :].conj()
        return self.S


class PackedSum:
    """S of the kernels in C: (batches, n (n + 1) / 2, 2, BATCH), the pairs on and above the diagonal of BATCH lines."""

    lines_at_once = 1 << 14

    def __init__(self, scale: ComplexArray) -> None:
        self.scale, self.dof, (F, n) = np.asfortranarray(scale), 0, scale.shape
        self.S: FloatArray = np.zeros((-(-F // BATCH), n * (n + 1) // 2, 2, BATCH))

    def add(self, batch: slice, z: ComplexArray, mean: ComplexArray) -> None:
        """Add as `FullSum.add`; the batch begins at a multiple of BATCH, and lines of the mean are contiguous."""
        strides = [stride // z.itemsize for stride in (*z.strides, mean.strides[1])]
        # Addresses, since z and mean may be views.
        call("add_scatter", *z.shape, z.ctypes.data, mean.ctypes.data, *strides, self.S[batch.start // BATCH :])

    def power(self) -> FloatArray:
        """Return the power as `FullSum.power` does."""
        F, n = self.scale.shape
        i = np.arange(n)
        diagonal = self.S[:, i * n - i * (i - 1) // 2, 0].transpose(0, 2, 1).reshape(-1, n)[:F]
        return np.asarray(diagonal * np.abs(self.scale) ** 2)

    def collect(self) -> ComplexArray:
        """Return the sum as `FullSum.collect` does."""
        S = np.empty((*self.scale.shape, self.scale.shape[1]), np.complex128)
        call("collect", *self.scale.shape, self.S, self.scale, S)
        return S


def add_periods(
    sums: FullSum | PackedSum, groups: Iterable[PeriodSpectra], out: ComplexArray | None = None
) -> ComplexArray:
    """Add the scatter of a record's periods, group by group; return their mean Z (F, n).

    out: memory for the mean, with contiguous lines.
    The scatters of two groups add up with the scatter of their means (Chan, Golub and LeVeque, 1979), which is added as
    the scatter of two periods.
    """
    mean, n = np.empty(sums.scale.shape, np.complex128, "F") if out is None else out, 0
    for spectra in groups:
        p = len(spectra.periods)
        for first in range(0, len(mean) if p else 0, sums.lines_at_once):
            batch = slice(first, first + sums.lines_at_once)
            group_mean = np.empty(mean[batch].shape, np.complex128, "F") if n else mean[batch]
            sums.add(batch, spectra.z[:, batch], group_mean)
            if n:
                difference = group_mean - mean[batch]
                side = np.sqrt(n * p / (n + p) / 2) * difference
                sums.add(batch, np.stack([side, -side]), group_mean)
                mean[batch] += p / (n + p) * difference
        n += p
    sums.dof += n - 1
    mean *= sums.scale
    return mean


@dataclass(frozen=True)
class Block:
    """The E experiments of one realisation (or of several), as means over their periods.

    U (F, n_u, E), Y (F, n_y, E).  R (F, n_u, E): injected torque, or None.  periods (E,): number of periods.
    input_noise (F, n_u): variance of U in one period, with dof degrees of freedom.
    """

    U: ComplexArray
    Y: ComplexArray
    R: ComplexArray | None
    periods: FloatArray
    input_noise: FloatArray
    dof: int

    @cached_property
    def W(self) -> ComplexArray:
        """(F, E, n_u) with U W = 1: U^-1, or with more experiments than inputs U^H (U U^H)^-1."""
        _, n_u, E = self.U.shape
        if n_u == E:
            return inverse(self.U)
        return self.U.mT.conj() @ inverse(self.U @ self.U.mT.conj())

    def on(self, lines: BoolArray) -> "Block":
        """Return spectra on some of the lines (F,)."""
        R = None if self.R is None else self.R[lines]
        return replace(self, U=self.U[lines], Y=self.Y[lines], R=R, input_noise=self.input_noise[lines])


@dataclass(frozen=True)
class MeanSpectra:
    """A block for each realisation, the scatter of all periods, and notes on discarded periods.

    S_Z (F, n_y + n_u, n_y + n_u): sum over periods of (Z - mean)(Z - mean)^H, Z = [Y; U], of expectation dof C_Z.
    scatter: Z - mean (P, F, n_y + n_u) of each record if there is one realisation; not for large records.
    """

    blocks: tuple[Block, ...]
    S_Z: ComplexArray
    dof: int
    notes: tuple[Note, ...] = ()
    scatter: tuple[ComplexArray, ...] = ()

    @cached_property
    def U(self) -> tuple[ComplexArray, ...]:
        """Spectra of the torques (F, n_u, E) of each block."""
        return tuple(block.U for block in self.blocks)

    @cached_property
    def Y(self) -> tuple[ComplexArray, ...]:
        """Spectra of the outputs (F, n_y, E) of each block."""
        return tuple(block.Y for block in self.blocks)

    @cached_property
    def periods(self) -> FloatArray:
        """Number of periods (K,) of each of the K experiments."""
        return np.concatenate([block.periods for block in self.blocks])

    @cached_property
    def YY(self) -> ComplexArray:
        """Y Y^H (F, n_y, n_y) of all experiments."""
        return added_cross_products(self.Y, self.Y)

    @cached_property
    def UU(self) -> ComplexArray:
        """U U^H (F, n_u, n_u) of all experiments."""
        return added_cross_products(self.U, self.U)

    def weighted_sum(self, X: Sequence[ComplexArray], Z: Sequence[ComplexArray]) -> ComplexArray:
        """Return sum (F, a, b) over experiments of P X Z^H, P periods each; X, Z: Y or U of each block."""
        if np.ptp(self.periods) > 0:
            return added_cross_products([x * block.periods for x, block in zip(X, self.blocks, strict=True)], Z)
        product = self.UU if X is self.U else self.YY if Z is self.Y else added_cross_products(X, Z)
        return np.asarray(self.periods[0] * product)

    @cached_property
    def all_experiments(self) -> Block:
        """All experiments of all realisations as one block."""
        if len(self.blocks) == 1:
            return self.blocks[0]
        R = [block.R for block in self.blocks if block.R is not None]
        dof = sum(block.dof for block in self.blocks)
        return Block(
            U=np.concatenate(self.U, axis=2),
            Y=np.concatenate(self.Y, axis=2),
            R=np.concatenate(R, axis=2) if len(R) == len(self.blocks) else None,
            periods=self.periods,
            input_noise=np.sum([block.dof / dof * block.input_noise for block in self.blocks], axis=0),
            dof=dof,
        )

    def on(self, lines: BoolArray) -> "MeanSpectra":
        """Return spectra on some of the lines (F,)."""
        if lines.all():
            return self
        blocks, scatter = tuple(block.on(lines) for block in self.blocks), tuple(Z[:, lines] for Z in self.scatter)
        return replace(self, blocks=blocks, S_Z=self.S_Z[lines], scatter=scatter)


def gather_spectra(
    realisations: Sequence[Sequence[RecordSpectra]], lines: IntArray, is_excited: BoolArray, spec: EstimatorSpec,
    with_reference: bool,
) -> MeanSpectra:  # fmt: skip
    """Return the mean spectra at DFT lines (F,), computed record by record.

    is_excited (F,): lines for the selection of periods.  with_reference: include the spectra of r.
    """
    sums = (PackedSum if is_compiled() else FullSum)(amplitude_scale(realisations[0][0].record, lines, spec.quantity))
    blocks: list[Block] = []
    notes: list[Note] = []
    scatter = []
    power, n_y = sums.power(), len(realisations[0][0].record.outputs)
    for group in realisations:
        Z, periods = np.empty((len(group), *sums.scale.shape[::-1]), np.complex128), np.zeros(len(group))
        for i, spectra in enumerate(group):
            selection, mean, every = _mean(spectra, lines, is_excited, spec, sums, Z[i].T)
            notes += selection.notes
            periods[i] = len(selection.periods)
            if every is not None and len(realisations) == 1:
                scatter.append(every.z * every.scale - mean)
        R = [reference_spectrum(spectra, lines) for spectra in group] if with_reference else []
        references = [spectrum for spectrum in R if spectrum is not None]
        previous_power, power, dof = power, sums.power(), sums.dof - sum(block.dof for block in blocks)
        block = Block(
            U=Z[:, n_y:].transpose(2, 1, 0),
            Y=Z[:, :n_y].transpose(2, 1, 0),
            R=np.stack(references, axis=2) if len(references) == len(group) else None,
            periods=periods,
            input_noise=(power - previous_power)[:, n_y:] / dof,
            dof=dof,
        )
        blocks.append(block)
    return MeanSpectra(tuple(blocks), sums.collect(), sums.dof, tuple(notes), tuple(scatter))


def _mean(
    spectra: RecordSpectra, lines: IntArray, is_excited: BoolArray, spec: EstimatorSpec, sums: FullSum | PackedSum,
    mean: ComplexArray,
) -> tuple[PeriodSpectra, ComplexArray, PeriodSpectra | None]:  # fmt: skip
    """Add the scatter of a record's usable periods to the sums.

    Return the usable periods, their mean Z (F, n) in the memory `mean`, and their spectra at all lines, None for a
    large record.
    """
    if not spectra.is_large:
        all_lines = period_spectra(spectra, lines, spec.quantity, sums.scale)
        selection = select_periods(all_lines.on(is_excited), spec)
        all_lines = all_lines.only(np.searchsorted(all_lines.periods, selection.periods))
        return selection, add_periods(sums, [all_lines], mean), all_lines
    # Select the periods at few lines; then add all lines, some periods at a time.
    values = spectra.record.n_repeats * sums.scale.shape[1]
    step = -(-int(is_excited.sum()) // max(20, _MAX_COMPARED_VALUES // values))
    selection = select_periods(period_spectra(spectra, lines[is_excited][::step], spec.quantity), spec)
    groups = period_groups(spectra, lines, spec.quantity, sums.scale)
    selected_groups = (group.only(np.flatnonzero(np.isin(group.periods, selection.periods))) for group in groups)
    return selection, add_periods(sums, selected_groups, mean), None
