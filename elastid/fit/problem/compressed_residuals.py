r"""Compressed residuals of one configuration: cost, J^T r and J^T J from the QR factors of each line's weights.

The weighted residuals of a line are q - R g, g: its modelled elements, R: triangular weights (F, n_e, n_e), or their
diagonal (F, n_e) for uncorrelated elements. `Full` computes the sums over lines with NumPy. `Packed` uses loops in C
(`base/kernels/line_loops.c`), which whiten and sum in one pass without storing the weighted columns of a block.

In `Packed`, BATCH lines are contiguous in memory, real and imaginary parts separate, for vector instructions. R
(batches, n_r, 2, BATCH) contains the rows of the triangle one after the other, each from its diagonal element, or the
diagonal alone. The last batch is filled with zeros.

In a symmetric response G_ij and G_ji are one number g. With the QR factors Q R of L^-1 S, computed once for each line,
the squared weighted residuals L^-1 (Ghat - S g) of a line are

.. math:: |L^{-1} \hat G|^2 - |q|^2 + |q - R g|^2, \qquad q = Q^H L^{-1} \hat G

with 21 residuals instead of 36 for six motors. The logarithmic criterion has the same R, and a q that depends on g.

The derivatives of g are few columns times powers of j omega (`Columns`).
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.kernels import call
from elastid.base.large_arrays import move_beside, release
from elastid.base.messages import WorkerConstant
from elastid.fit.problem.least_squares import ResidualKind
from elastid.fit.problem.weights import Whitening
from elastid.linear.response.derivatives import AnyComplex, Columns, Sensitivity

BATCH = 16
Precision: TypeAlias = type[np.floating[Any]]


class LineResiduals(NamedTuple):
    """Residuals r = q - R g of a block of lines, all (F, n_e); r = q without G.  slope: de/dg, by default 1."""

    q: ComplexArray
    G: ComplexArray | None = None
    slope: ComplexArray | None = None


class BlockSums(NamedTuple):
    """Sums of a block of lines, columns U (F, n_e, n_b), s = j omega, residuals r = q - R g of its elements.

    cost: sum |r|^2.  pull (3, n_b): sum over lines of s^p r^H R diag(slope) U, p = 0, 1, 2.
    moments (5, n_b, n_b): Re, for odd p Im, of sum omega^p V^H V, V = R diag(slope) U diag(scale), p = 0 ... 4, on and
    above the diagonal.
    """

    cost: float
    pull: ComplexArray
    moments: FloatArray


@dataclass(frozen=True, eq=False)
class Full:
    """R for sums with NumPy."""

    R: ComplexArray | FloatArray

    def sums(self, lines: Sensitivity, e: LineResiduals, scale: FloatArray, precision: Precision) -> BlockSums:
        """Return the sums of a block of lines. precision: data type of the moments."""
        R, slope = self.R[lines.block], e.slope
        r = e.q if e.G is None else e.q - _times(R, e.G[:, :, None])[:, :, 0]
        weight = R * r.conj() if R.ndim == 2 else (r.conj()[:, None, :] @ R)[:, 0]
        weight = weight if slope is None else weight * slope
        U = lines.columns(scale, precision)
        if slope is not None:
            U *= slope[:, :, None]
        V = _times(R.astype(U.dtype if R.ndim == 3 else U.real.dtype), U)
        gram = np.swapaxes(V.conj(), 1, 2) @ V
        powers = (lines.omega ** np.arange(5)[:, None]).astype(V.real.dtype)
        sums = (powers @ gram.reshape(len(V), -1).view(powers.dtype)).view(V.dtype).reshape(5, *gram.shape[1:])
        moments = np.stack([m.imag if p % 2 else m.real for p, m in enumerate(sums)]).astype(np.float64)
        return BlockSums(float(np.vdot(r, r).real), lines.pull(weight), moments)


@dataclass(frozen=True, eq=False)
class Packed:
    """R (batches, n_r, 2, BATCH) for sums in C."""

    R: FloatArray

    @classmethod
    def of(cls, R: ComplexArray | FloatArray) -> "Packed":
        """Return the packed form of R (F, n_e, n_e) or its diagonal (F, n_e)."""
        rows = R if R.ndim == 2 else R[:, *np.triu_indices(R.shape[1])]
        F, n_r = rows.shape
        padded_rows = np.zeros((-(-F // BATCH) * BATCH, n_r), complex)
        padded_rows[:F] = rows
        pairs = np.stack([padded_rows.real, padded_rows.imag], axis=2).reshape(-1, BATCH, n_r, 2)
        return cls(np.ascontiguousarray(pairs.transpose(0, 2, 3, 1)))

    def sums(self, lines: Sensitivity, e: LineResiduals, scale: FloatArray, precision: Precision) -> BlockSums:
        """Return the sums as `Full.sums`; requires the compiled kernels."""
        (F, n_y, _), n_u, (n_b, n_e) = lines.left.shape, lines.right.shape[1], (len(scale), len(lines.outputs))
        n_1, (_, n_2, r, _) = len(lines.sign), lines.S.shape
        sign = np.ones(n_b)
        sign[:n_1] = lines.sign
        cost, weight = np.zeros(1), np.empty((n_e, F), complex)
        pull, moments = np.zeros((3, n_b), complex), np.zeros((5, n_b, n_b))
        between = np.zeros((3, r, r), complex)
        sizes = F, n_y, n_u, n_1, n_2, r, n_b - n_1 - n_2, n_e, self.R.shape[1] == n_e
        right = None if lines.has_equal_sides else lines.right.T
        columns = lines.left.T, right, lines.gain, lines.S, lines.whole.T, lines.outputs, lines.inputs
        residuals = (None if values is None else values.T for values in e)
        weights = self.R[lines.block.start // BATCH :], lines.omega, sign, sign * scale
        name = "sums_float" if precision is np.float32 else "sums_double"
        call(name, *sizes, *columns, *residuals, *weights, cost, weight, pull, between, moments)
        pull[:, n_1 : n_1 + n_2] = lines.matrix_pull(between)
        return BlockSums(float(cost[0]), pull, moments)


def _times(R: npt.NDArray[np.inexact[Any]], U: AnyComplex) -> AnyComplex:
    if R.ndim == 2:
        return np.asarray((np.ascontiguousarray(U).view(R.dtype) * R[:, :, None]).view(U.dtype))
    return R @ U


@dataclass(frozen=True, eq=False)
class CompressedResiduals(WorkerConstant):
    """The residuals mixing (gain e) of one configuration; measured, gain, criterion and whitening as of `FrfResiduals`.

    elements: rows and columns (n_e,) of the elements g.  entries (n_y, n_u): index of each entry in elements.
    takes_compiled: True if the sums run in C.  precomputed: `compressed`, if already computed.
    """

    elements: tuple[IntArray, IntArray]
    entries: IntArray
    takes_compiled: bool
    measured: ComplexArray
    gain: FloatArray
    criterion: ResidualKind
    whitening: Whitening | None
    precomputed: "Compressed | None" = None

    def has_data_of(self, other: "CompressedResiduals") -> bool:
        """Return True if both have the same data and weights."""
        are_same = (np.array_equal(getattr(self, name), getattr(other, name)) for name in ("measured", "gain"))
        form = (self.whitening is other.whitening, self.criterion, len(self.elements[0]))
        return form == (True, other.criterion, len(other.elements[0])) and all(are_same)

    @property
    def without_whitening(self) -> "CompressedResiduals":
        """Residuals without the whitening matrices, which the complex criterion needs only for `compressed`."""
        if self.criterion != "complex":
            return self
        return replace(self, whitening=None, precomputed=self.compressed)

    def at(self, block: slice, G: ComplexArray) -> tuple[float, LineResiduals]:
        """Return the constant of V, and the residuals of a block of lines with modelled elements G (F, n_e)."""
        data = self.compressed
        if self.criterion == "complex":
            return float(data.constant[block].sum()), LineResiduals(data.q[block], G)
        with np.errstate(divide="ignore", invalid="ignore"):
            error = self._log_measured[block] - np.log(G).take(self.entries, axis=1)
            error.imag -= 2 * np.pi * np.rint(error.imag / (2 * np.pi))
        weighted = self._weighted(block, error)
        slope = np.divide(1.0, G, out=np.zeros_like(G), where=self._counts[block])
        r = self._projected(data.Q[block], weighted)
        return float(np.vdot(weighted, weighted).real - np.vdot(r, r).real), LineResiduals(r, slope=slope)

    @cached_property
    def _log_measured(self) -> ComplexArray:
        """ln Ghat (F, n_y, n_u), the same at every x."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(self.measured)

    def _weighted(self, block: slice, e: ComplexArray) -> ComplexArray:
        """Return gain e (F, n_y n_u) of a block of lines."""
        gain = self.gain[block]
        return np.where(gain > 0, gain * np.where(gain > 0, e, 0.0), 0.0).reshape(len(e), -1)

    def _projected(self, Q: FloatArray, weighted: ComplexArray) -> ComplexArray:
        """Return Q^H r (F, n_e) of uncorrelated weighted residuals r (F, n_y n_u)."""
        first, second = self._places
        return Q[:, :, 0] * weighted[:, first] + Q[:, :, 1] * weighted[:, second]

    @cached_property
    def _places(self) -> tuple[IntArray, IntArray]:
        (rows, columns), n_u = self.elements, self.measured.shape[2]
        return rows * n_u + columns, columns * n_u + rows if len(rows) < self.entries.size else rows * n_u + columns

    @cached_property
    def _counts(self) -> BoolArray:
        """True for elements (F, n_e) with at least one used measured value."""
        is_used = (self.gain > 0).reshape(len(self.gain), -1)
        return is_used[:, self._places[0]] | is_used[:, self._places[1]]

    @cached_property
    def compressed(self) -> "Compressed":
        """R with the compressed data."""
        if self.precomputed is not None:
            return self.precomputed
        first, second = self._places
        form = Packed.of if self.takes_compiled else Full
        residual, has_mirror = self._weighted(slice(None), self.measured), first != second
        if self.whitening is not None:
            mixing = self.whitening.matrix
            W = mixing * self.gain.reshape(len(self.gain), 1, -1)
            basis, R = np.linalg.qr(W[:, :, first] + has_mirror * W[:, :, second])
            weights = form(R)  # the largest array of a fit
            weights = replace(weights, R=move_beside(self.whitening.noise.in_file, weights.R))
            residual = (mixing @ residual[:, :, None])[:, :, 0]
            q = (basis.mT.conj() @ residual[:, :, None])[:, :, 0]
            residual = residual - (basis @ q[:, :, None])[:, :, 0]
        else:
            gain, mirror = (self.gain.reshape(len(self.gain), -1)[:, columns] for columns in (first, second))
            size = np.hypot(gain, mirror * has_mirror)
            Q, weights = (
                np.stack([gain, mirror * has_mirror], axis=2) / np.where(size > 0, size, 1.0)[:, :, None],
                form(size),
            )
            if self.criterion != "complex":
                return Compressed(weights, Q=Q)
            q = self._projected(Q, residual)
            residual[:, first] -= Q[:, :, 0] * q
            residual[:, second] -= Q[:, :, 1] * q  # 0 on the diagonal, where both indices are equal
        q = np.asfortranarray(q)  # memory order of the kernel
        return Compressed(weights, q=q, constant=np.sum(np.abs(residual) ** 2, axis=1))


@dataclass(frozen=True, eq=False)
class Compressed:
    """R, with q (F, n_e) and constant |L^-1 Ghat|^2 - |q|^2 (F,) for the complex criterion.

    Q (F, n_e, 2): for the logarithmic criterion, the coefficients of an element and of its mirror image.
    """

    R: Full | Packed
    Q: FloatArray = field(default_factory=lambda: np.zeros(0))
    q: ComplexArray = field(default_factory=lambda: np.zeros(0, complex))
    constant: FloatArray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The normal equations of the residuals of one configuration, with the columns of their derivatives."""

    columns: Columns
    residuals: CompressedResiduals

    def at(self, theta: FloatArray, precision: Precision = np.float64) -> tuple[float, FloatArray, FloatArray]:
        """Return V, J^T r (P,) and J^T J (P, P) at theta (n_theta,) for the P parameters of the kernel.

        J^T J follows from the sums over lines of omega^p U^H U, U: weighted columns, p = 0 ... 4.
        precision: of these sums; single precision is enough for a step, and faster.
        """
        pieces, highest = self.columns.pieces, self.columns.omega_0**self.columns.pieces.power
        # Scale the columns to unit size, because the exponents of single precision are limited.
        scale, size = np.zeros(pieces.base.max(initial=-1) + 1), np.abs(theta[self.columns.kernel.places])
        np.maximum.at(scale, pieces.base, np.abs(pieces.sigma @ np.where(size == 0, 1.0, size)) * highest)
        scale[scale == 0] = 1.0
        V, pull, moments = 0.0, np.zeros((3, len(scale)), complex), np.zeros((5, len(scale), len(scale)))
        R = self.residuals.compressed.R
        for lines in self.columns.at(theta):
            constant, e = self.residuals.at(lines.block, lines.G)
            sums = R.sums(lines, e, scale, precision)
            V, pull, moments = V + (constant + sums.cost), pull + sums.pull, moments + sums.moments
        release(R.R)
        indices, sign = self._pairs
        g = highest * pull[pieces.power, pieces.base].real
        sigma = (highest / scale[pieces.base])[:, None] * pieces.sigma
        return V, pieces.sigma.T @ g, sigma.T @ (sign * moments.take(indices)) @ sigma

    @cached_property
    def _pairs(self) -> tuple[IntArray, FloatArray]:
        """Index into the moments (5, n_b, n_b) for each pair of pieces (n_t, n_t), and the sign of the moment.

        The product of two pieces is the real part of (j omega)^k' (-j omega)^k.
        """
        base, power = self.columns.pieces.base, self.columns.pieces.power
        order, apart = power + power[:, None], power - power[:, None]
        signs = np.where(base < base[:, None], -1.0, 1.0) ** order
        n_b = base.max(initial=-1) + 1
        indices = (order * n_b + np.minimum(base, base[:, None])) * n_b + np.maximum(base, base[:, None])
        return indices, signs * np.array([1.0, -1.0, -1.0, 1.0])[apart % 4]
