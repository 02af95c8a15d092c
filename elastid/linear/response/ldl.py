r"""Z(omega) X = B by Z = L D L^T, all coordinates in an order that fills L least; in C (`base/kernels/ldl.c`).

.. math:: Z^{(k+1)}_{ij} = Z^{(k)}_{ij} - \frac{z^{(k)}_{ki} z^{(k)}_{kj}}{z^{(k)}_{kk}}, \qquad i, j > k

Symmetric, so half of an LU; entries that are zero for every theta are skipped: six motors behind their gears cost next
to nothing. Faster than `condensation` (scripts/benchmarks/fit.py), which does its work where there are no kernels in C.
Nothing is exchanged for the sake of digits: a line whose pivot is small beside the terms that it is made of, as that of
an undamped part on its own resonance, is solved by LAPACK instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.kernels import call

# |pivot| beside the sizes of its terms, below which the quotients would cost digits.
MIN_PIVOT = 1e-3


@dataclass(frozen=True)
class Elimination:
    """The order (n,) of the coordinates, and where L^T is not zero then (n, n), above its diagonal."""

    order: IntArray
    filled: BoolArray

    @classmethod
    def of(cls, coupled: BoolArray) -> Elimination:
        """Of a pattern (n, n): which coordinates act on each other; next is always the one that acts on the fewest."""
        acts = (coupled | coupled.T) & ~np.eye(len(coupled), dtype=bool)
        filled, left, order = np.zeros_like(acts), np.ones(len(acts), dtype=bool), []
        while left.any():
            k = int(np.argmin(np.where(left, (acts & left).sum(axis=1), len(acts))))
            left[k] = False
            filled[k] = acts[k] & left
            acts |= np.outer(filled[k], filled[k]) & ~np.eye(len(acts), dtype=bool)
            order.append(k)
        places = np.array(order, np.int64)
        return cls(places, filled[np.ix_(places, places)])

    def products(
        self, M: FloatArray, D: FloatArray, K: FloatArray, omega: FloatArray, B: FloatArray, Y: FloatArray
    ) -> ComplexArray:
        """B^T Z^-1 Y (F, m, n_d) of Z = K + j omega D - omega^2 M, real B (n, m), Y (n, n_d).

        Raises LinAlgError where Z is singular.
        """
        later, many, places = self._later
        found = np.empty((Y.shape[1], B.shape[1], len(omega)), complex)
        smallest, sizes = np.empty(len(omega)), (len(omega), *B.shape, Y.shape[1])
        call(
            "eliminate",
            *sizes,
            M.take(places),
            D.take(places),
            K.take(places),
            B.take(self.order, axis=0),
            omega,
            later,
            many,
            Y.take(self.order, axis=0),
            found,
            smallest,
        )
        for line in np.flatnonzero(~(smallest > MIN_PIVOT**2)):  # not above: NaN too
            Z = K + 1j * omega[line] * D - omega[line] ** 2 * M
            found[:, :, line] = Y.T @ np.linalg.solve(Z, B.astype(complex))
        return np.asarray(found.T)

    @cached_property
    def _later(self) -> tuple[IntArray, IntArray, IntArray]:
        """The columns of each row of L^T that are not zero, the first of each row of (n, n), and how many (n,).

        Last, where each entry (n, n) of a matrix in this order stands in the matrix.
        """
        later = np.argsort(~self.filled, axis=1, kind="stable").astype(np.int64)
        return later, self.filled.sum(axis=1), self.order[:, None] * len(self.order) + self.order
