"""Windows: the neighbouring bins that the local fit at each line sees.

They are the n_w available bins nearest by count, centred where they can be and one-sided at the ends of the band.
Offsets are in units of the furthest bin, so that powers of them are of one size and the regression well conditioned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Windows:
    """index (F, n_w) into the available bins; offset (F, n_w) from the line in [-1, 1]; span (F,) in bins."""

    index: IntArray
    offset: FloatArray
    span: IntArray

    def at(self, lines: slice) -> Windows:
        """The windows of some lines."""
        return Windows(self.index[lines], self.offset[lines], self.span[lines])


def windows(available: IntArray, lines: IntArray, n_w: int) -> Windows:
    """Windows of n_w of the available bins (B,), increasing, around lines (F,); all bins where there are fewer.

    >>> windows(np.array([2, 4, 6, 8, 10]), np.array([2, 6]), 3).index.tolist()
    [[0, 1, 2], [1, 2, 3]]
    """
    n_w = min(n_w, len(available))
    middle = np.searchsorted(available, lines)
    start = np.clip(middle - n_w // 2, 0, len(available) - n_w)
    index = start[:, None] + np.arange(n_w)
    distance = available[index] - lines[:, None]
    return Windows(
        index=index,
        offset=distance / np.maximum(np.abs(distance).max(axis=1, keepdims=True), 1),
        span=(available[index[:, -1]] - available[index[:, 0]]).astype(np.int64),
    )


@dataclass(frozen=True)
class WindowTerms:
    r"""The terms of the fit in a window, of n_u inputs: A(r) Z = B(r) R + T(r).

    order: degree of B, and of T where there is a transient.  poles: degree of A, 0 in the polynomial method.
    """

    n_u: int
    order: int
    poles: int
    transient: bool

    @property
    def columns(self) -> int:
        """Unknowns of B for each output."""
        return self.n_u * (self.order + 1)

    @property
    def transient_columns(self) -> int:
        """Unknowns of T for each output and experiment."""
        return self.order + 1 if self.transient else 0

    def degrees_of_freedom(self, n_w: int, experiments: int, n_z: int) -> float:
        """Complex degrees of freedom of the residual of each of n_z outputs, which share the unknowns of A."""
        return experiments * (n_w - self.transient_columns) - self.columns - self.poles / n_z

    def width(self, dof: float, experiments: int, n_z: int) -> int:
        """n_w, the fewest bins that leave dof degrees of freedom, but at least the unknowns of one element and T."""
        n_w = self.transient_columns + math.ceil((dof + self.columns + self.poles / n_z) / experiments - 1e-9)
        return max(n_w, self.order + self.poles + 1 + self.transient_columns)
