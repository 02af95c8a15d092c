r"""What the residuals of a line are divided by, as a triangle: R of the weighted residuals q - R g of its elements g.

`Full` works with NumPy, `Packed` with loops in C where there is a compiler: whitening and sums over the lines in one
pass, without the weighted columns of a block in memory. R (F, n_e, n_e), or its diagonal
(F, n_e) where elements count one by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.problem import line_loops
from elastid.linear.response.derivatives import Sensitivity

Complex: TypeAlias = npt.NDArray[np.complexfloating[Any, Any]]
Precision: TypeAlias = type[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Full:
    """R as it is."""

    R: ComplexArray | FloatArray

    def residual(self, block: slice, q: ComplexArray, G: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """r = q - R g (F, n_e) of a block of lines, and r^H R."""
        r = np.asarray(q - _times(self.R[block], G[:, :, None])[:, :, 0])
        return r, self.returned(block, r)

    def returned(self, block: slice, r: ComplexArray) -> ComplexArray:
        """r^H R (F, n_e)."""
        R = self.R[block]
        return np.asarray(R * r.conj() if R.ndim == 2 else (r.conj()[:, None, :] @ R)[:, 0])

    def pull(self, part: Sensitivity, weight: ComplexArray) -> ComplexArray:
        """As `Sensitivity.pull`."""
        return part.pull(weight)

    def moments(
        self, part: Sensitivity, scale: FloatArray, slope: ComplexArray | None, omega: FloatArray, precision: Precision
    ) -> FloatArray:
        """Re, for odd p Im, of sum_f omega^p V_f^H V_f (5, n_b, n_b), V = R diag(slope) U, on and above the diagonal.

        U: the columns of the block times their scale (n_b,).
        """
        U = part.columns(scale, precision)
        if slope is not None:
            U *= slope[:, :, None]
        R = self.R[part.block]
        V = _times(R.astype(U.dtype if R.ndim == 3 else U.real.dtype), U)
        gram = np.swapaxes(V.conj(), 1, 2) @ V
        powers = (omega ** np.arange(5)[:, None]).astype(V.real.dtype)
        found = (powers @ gram.reshape(len(V), -1).view(powers.dtype)).view(V.dtype).reshape(5, *gram.shape[1:])
        return np.stack([one.imag if p % 2 else one.real for p, one in enumerate(found)]).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Packed:
    """R of the compiled loops (`line_loops.packed`)."""

    R: FloatArray

    @classmethod
    def of(cls, R: ComplexArray | FloatArray) -> Packed:
        """Of R (F, n_e, n_e) or its diagonal (F, n_e)."""
        return cls(line_loops.packed(R))

    def residual(self, block: slice, q: ComplexArray, G: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """As `Full.residual`."""
        return line_loops.residual(self.R, block.start, q, G)

    def returned(self, block: slice, r: ComplexArray) -> ComplexArray:
        """As `Full.returned`."""
        return line_loops.returned(self.R, block.start, r)

    def pull(self, part: Sensitivity, weight: ComplexArray) -> ComplexArray:
        """As `Full.pull`."""
        return part.with_whole(line_loops.pulled(part, part.gain[:, None] * weight), weight)

    def moments(
        self, part: Sensitivity, scale: FloatArray, slope: ComplexArray | None, omega: FloatArray, precision: Precision
    ) -> FloatArray:
        """As `Full.moments`."""
        return line_loops.moments(part, scale, slope, self.R, omega, precision)


def _times(R: npt.NDArray[np.inexact[Any]], U: Complex) -> Complex:
    """R U (F, n_e, n) of each line, R possibly given by its diagonal."""
    if R.ndim == 2:
        return np.asarray((np.ascontiguousarray(U).view(R.dtype) * R[:, :, None]).view(U.dtype))
    return np.asarray(R @ U)
