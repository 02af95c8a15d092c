r"""Z(omega) X = B by Z = L D L^T in C (`base/kernels/ldl.c`).

.. math:: Z^{(k+1)}_{ij} = Z^{(k)}_{ij} - \frac{z^{(k)}_{ki} z^{(k)}_{kj}}{z^{(k)}_{kk}}, \qquad i, j > k

Symmetric, so half of an LU, all coordinates in an order that fills L least; entries that are zero for every theta are
skipped: six motors behind their gears cost next to nothing. No rows are exchanged: a line whose pivot is small relative
to its terms, as that of an undamped part on its own resonance, is solved by LAPACK instead.

Without the kernels in C LAPACK solves all lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.kernels import call

# |pivot| relative to the sizes of its terms, below which the quotients would cost digits (not measured).
LEAST_PIVOT = 1e-3


@dataclass(frozen=True)
class Elimination:
    """The order (n,) of the coordinates, and where L^T is not zero then (n, n), above its diagonal."""

    order: IntArray
    filled: BoolArray

    @classmethod
    def of(cls, coupled: BoolArray) -> Elimination:
        """Elimination of a pattern (n, n) of coupled coordinates; next is the one that acts on the fewest."""
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
        products = np.empty((Y.shape[1], B.shape[1], len(omega)), complex)
        smallest, sizes = np.empty(len(omega)), (len(omega), *B.shape, Y.shape[1])
        B_ordered, Y_ordered = B.take(self.order, axis=0), Y.take(self.order, axis=0)
        matrices = (matrix.take(places) for matrix in (M, D, K))
        call("eliminate", *sizes, *matrices, B_ordered, omega, later, many, Y_ordered, products, smallest)
        weak = np.flatnonzero(~(smallest > LEAST_PIVOT**2))  # not above: NaN too
        if len(weak):
            products[:, :, weak] = solved_products(M, D, K, omega[weak], B, Y).T
        return np.asarray(products.T)

    @cached_property
    def _later(self) -> tuple[IntArray, IntArray, IntArray]:
        """The columns of each row of L^T that are not zero, the first of each row of (n, n), and how many (n,).

        Last, where each entry (n, n) of a matrix in this order stands in the matrix.
        """
        later = np.argsort(~self.filled, axis=1, kind="stable").astype(np.int64)
        return later, self.filled.sum(axis=1), self.order[:, None] * len(self.order) + self.order


def solved_products(
    M: FloatArray, D: FloatArray, K: FloatArray, omega: FloatArray, B: FloatArray, Y: FloatArray
) -> ComplexArray:
    """Products by LAPACK."""
    of_lines = omega[:, None, None]
    X = np.linalg.solve(K + 1j * of_lines * D - of_lines**2 * M, B.astype(complex)).transpose(1, 2, 0)
    # One product of real matrices, since Y is real and may have thousands of columns.
    real = np.ascontiguousarray(X).reshape(len(Y), -1).view(np.float64)
    return np.asarray((Y.T @ real).view(np.complex128).reshape(-1, *X.shape[1:]).T)
