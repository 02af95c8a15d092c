r"""What the residuals of a line are divided by, as a triangle: R of the weighted residuals q - R g of its elements g.

`Full` works with NumPy, `Packed` with loops in C where there is a compiler: whitening and sums over the lines in one
pass, without the weighted columns of a block in memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.problem import line_loops
from elastid.linear.response.sensitivity import Sensitivity

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
    """R (F, n_e, 2 n_e), real parts of a row and then imaginary ones, or its diagonal (F, n_e).

    So products are real ones, with numbers above j times themselves: of small matrices BLAS has those sooner.
    """

    R: FloatArray

    @classmethod
    def of(cls, R: ComplexArray | FloatArray) -> Full:
        """Of R (F, n_e, n_e) or its diagonal (F, n_e)."""
        return cls(np.concatenate([R.real, R.imag], axis=2) if R.ndim == 3 else R.real)

    def times(self, block: slice, U: Complex) -> Complex:
        """R U (F, n_e, n) of a block of lines."""
        both = np.empty((len(U), 2, *U.shape[1:]), U.dtype)
        both[:, 0] = U
        np.multiply(both[:, 0], 1j, out=both[:, 1])
        return _times(self.R[block], both)

    def residual(self, block: slice, q: ComplexArray, G: ComplexArray) -> ComplexArray:
        """r = q - R g (F, n_e) of a block of lines."""
        return np.asarray(q - self.times(block, G[:, :, None])[:, :, 0])

    def sums(self, part: Sensitivity, e: LineResiduals, scale: FloatArray, precision: Precision) -> LineSums:
        """The sums of a block of lines; precision: of the moments."""
        q, G, slope = e
        R = self.R[part.block]
        r = q if G is None else self.residual(part.block, q, G)
        weight = _weight(R, r)
        if slope is not None:
            weight = weight * slope
        U = part.columns(scale, precision)
        if slope is not None:
            U *= slope[:, None, :, None]
        moments = _moments(R, U, part.omega)
        return LineSums(float(np.vdot(r, r).real), weight, part.pull(weight), moments)


@dataclass(frozen=True, eq=False)
class Packed:
    """R of the compiled loops (`line_loops.packed`)."""

    R: FloatArray

    @classmethod
    def of(cls, R: ComplexArray | FloatArray) -> Packed:
        """Of R (F, n_e, n_e) or its diagonal (F, n_e)."""
        return cls(line_loops.packed(R))

    def sums(self, part: Sensitivity, e: LineResiduals, scale: FloatArray, precision: Precision) -> LineSums:
        """As `Full.sums`."""
        return LineSums(*line_loops.sums(part, self.R, *e, scale, precision))


def _times(R: npt.NDArray[np.floating[Any]], both: Complex) -> Complex:
    """R U (F, n_e, n) of each line; both (F, 2, n_e, n): U, and j U."""
    F, _, n_e, n = both.shape
    if R.ndim == 2:
        return np.asarray(both[:, 0] * R[:, :, None])
    return np.asarray((R @ both.view(both.real.dtype).reshape(F, 2 * n_e, 2 * n)).view(both.dtype))


def _moments(R: FloatArray, both: Complex, omega: FloatArray) -> FloatArray:
    """Re, for odd p Im, of sum omega^p V^H V (5, n_b, n_b), V = R U of each line; both (F, 2, n_e, n_b): U, and j U."""
    n_b, real = both.shape[3], both.real.dtype
    V = _times(R.astype(real), both).view(real)
    # Of a copy, as BLAS is slower where it knows that the product is symmetric.
    gram = V.copy().swapaxes(1, 2) @ V
    powers = (omega ** np.arange(5)[:, None]).astype(real)
    parts = (powers @ gram.reshape(len(V), -1)).reshape(5, n_b, 2, n_b, 2).astype(np.float64)
    moments = parts[:, :, 0, :, 0] + parts[:, :, 1, :, 1]
    moments[1::2] = parts[1::2, :, 0, :, 1] - parts[1::2, :, 1, :, 0]
    return np.asarray(moments)


def _weight(R: FloatArray, r: ComplexArray) -> ComplexArray:
    """r^H R (F, n_e) of each line."""
    if R.ndim == 2:
        return np.asarray(R * r.conj())
    F, n_e = r.shape
    of = np.ascontiguousarray(r).view(np.float64).reshape(F, n_e, 2).swapaxes(1, 2) @ R
    found = np.empty((F, n_e), complex)
    np.add(of[:, 0, :n_e], of[:, 1, n_e:], out=found.real)
    np.subtract(of[:, 0, n_e:], of[:, 1, :n_e], out=found.imag)
    return found
