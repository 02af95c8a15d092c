"""Weights of the residuals of a line as a triangle: R of the weighted residuals q - R g of its elements g.

`Full` works with NumPy; `Packed` with loops in C (`base/kernels/line_loops.c`) where the kernels are built: whitening
and sums over the lines in one pass, without the weighted columns of a block in memory. R (F, n_e, n_e), or its diagonal
(F, n_e) where elements count one by one.

For the loops in C lines lie side by side in memory, BATCH at a time, real and imaginary parts apart, so that the
processor takes several at once. R (batches, n_r, 2, BATCH) has its rows one below the other, each from its diagonal on;
of diagonal weights it has the diagonal alone. Lines that fill up the last batch are zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.kernels import call
from elastid.linear.response.sensitivity import Sensitivity

BATCH = 16
Complex: TypeAlias = npt.NDArray[np.complexfloating[Any, Any]]
Precision: TypeAlias = type[np.floating[Any]]


class LineResiduals(NamedTuple):
    """r = q - R g of a block of lines, all (F, n_e); without g q is r.  slope: of e to g, where it is not 1."""

    q: ComplexArray
    G: ComplexArray | None = None
    slope: ComplexArray | None = None


class LineSums(NamedTuple):
    """Of a block of lines, with columns U (F, n_e, n_b), s = j omega and the residuals r = q - R g of its elements.

    cost: sum |r|^2.  weight (F, n_e): r^H R diag(slope).
    pulled (3, n_b): sum over lines of s^p weight U, p = 0, 1, 2.
    moments (5, n_b, n_b): Re, for odd p Im, of sum omega^p V^H V, V = R diag(slope) U diag(scale), p = 0 ... 4, on and
    above the diagonal.
    """

    cost: float
    weight: ComplexArray
    pulled: ComplexArray
    moments: FloatArray


@dataclass(frozen=True, eq=False)
class Full:
    """R as it is."""

    R: ComplexArray | FloatArray

    def residual(self, block: slice, q: ComplexArray, G: ComplexArray) -> ComplexArray:
        """r = q - R g (F, n_e) of a block of lines."""
        return np.asarray(q - _times(self.R[block], G[:, :, None])[:, :, 0])

    def sums(self, part: Sensitivity, e: LineResiduals, scale: FloatArray, precision: Precision) -> LineSums:
        """The sums of a block of lines; precision: of the moments."""
        q, G, slope = e
        R = self.R[part.block]
        r = q if G is None else self.residual(part.block, q, G)
        weight = np.asarray(R * r.conj() if R.ndim == 2 else (r.conj()[:, None, :] @ R)[:, 0])
        if slope is not None:
            weight = weight * slope
        U = part.columns(scale, precision)
        if slope is not None:
            U *= slope[:, :, None]
        V = _times(R.astype(U.dtype if R.ndim == 3 else U.real.dtype), U)
        gram = np.swapaxes(V.conj(), 1, 2) @ V
        powers = (part.omega ** np.arange(5)[:, None]).astype(V.real.dtype)
        sums = (powers @ gram.reshape(len(V), -1).view(powers.dtype)).view(V.dtype).reshape(5, *gram.shape[1:])
        moments = np.stack([m.imag if p % 2 else m.real for p, m in enumerate(sums)]).astype(np.float64)
        return LineSums(float(np.vdot(r, r).real), weight, part.pull(weight), moments)


@dataclass(frozen=True, eq=False)
class Packed:
    """R (batches, n_r, 2, BATCH) of the sums in C."""

    R: FloatArray

    @classmethod
    def of(cls, R: ComplexArray | FloatArray) -> Packed:
        """Of R (F, n_e, n_e) or its diagonal (F, n_e)."""
        rows = R if R.ndim == 2 else R[:, *np.triu_indices(R.shape[1])]
        F, n_r = rows.shape
        filled = np.zeros((-(-F // BATCH) * BATCH, n_r), complex)
        filled[:F] = rows
        parts = np.stack([filled.real, filled.imag], axis=2).reshape(-1, BATCH, n_r, 2)
        return cls(np.ascontiguousarray(parts.transpose(0, 2, 3, 1)))

    def sums(self, part: Sensitivity, e: LineResiduals, scale: FloatArray, precision: Precision) -> LineSums:
        """As `Full.sums`; callable only where the kernels are built."""
        (F, n_y, _), n_u, (n_b, n_e) = part.left.shape, part.right.shape[1], (len(scale), len(part.outputs))
        n_1, (_, n_2, r, _) = len(part.sign), part.S.shape
        sign = np.ones(n_b)
        sign[:n_1] = part.sign
        cost, weight = np.zeros(1), np.empty((n_e, F), complex)
        pulled, moments = np.zeros((3, n_b), complex), np.zeros((5, n_b, n_b))
        between = np.zeros((3, r, r), complex)
        call(
            "sums_float" if precision is np.float32 else "sums_double",
            F,
            n_y,
            n_u,
            n_1,
            n_2,
            r,
            n_b - n_1 - n_2,
            n_e,
            self.R.shape[1] == n_e,
            part.left.T,
            None if part.is_alike else part.right.T,
            part.gain,
            part.S,
            part.whole.T,
            part.outputs,
            part.inputs,
            e.q.T,
            None if e.G is None else e.G.T,
            None if e.slope is None else e.slope.T,
            self.R[part.block.start // BATCH :],
            part.omega,
            sign,
            sign * scale,
            cost,
            weight,
            pulled,
            between,
            moments,
        )
        pulled[:, n_1 : n_1 + n_2] = part.pulled_by(between)
        return LineSums(float(cost[0]), weight.T, pulled, moments)


def _times(R: npt.NDArray[np.inexact[Any]], U: Complex) -> Complex:
    """R U (F, n_e, n) of each line, R possibly given by its diagonal."""
    if R.ndim == 2:
        return np.asarray((np.ascontiguousarray(U).view(R.dtype) * R[:, :, None]).view(U.dtype))
    return np.asarray(R @ U)
