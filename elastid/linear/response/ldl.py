r"""Z(omega) X = B by Z = L D L^T in C (`base/kernels/ldl.c`), or, without compiled kernels, by condensation of leaves.

.. math:: Z^{(k+1)}_{ij} = Z^{(k)}_{ij} - \frac{z^{(k)}_{ki} z^{(k)}_{kj}}{z^{(k)}_{kk}}, \qquad i, j > k

Symmetric, so half of an LU, all coordinates in an order that fills L least; entries that are zero for every theta are
skipped: six motors behind their gears cost next to nothing. No rows are exchanged: a line whose pivot is small relative
to its terms, as that of an undamped part on its own resonance, is solved by LAPACK instead.

In NumPy leaves are condensed first, coordinates on which only one other acts, as motors behind their gears:

.. math:: \Big(Z_{rr} - \sum_l \frac{z_l^2}{Z_{ll}} e_l e_l^T\Big) X_r = B_r - \sum_l \frac{z_l}{Z_{ll}} e_l B_l, \qquad
          X_l = \frac{B_l - z_l X_{r(l)}}{Z_{ll}}

An LU of 12 rows instead of 18 for six motors on twelve further coordinates (times of both: scripts/benchmarks/fit.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.kernels import call


@dataclass(frozen=True)
class PivotLimits:
    """|pivot| relative to the sizes of its terms, below which the quotients would cost digits (not measured)."""

    elimination: float = 1e-3
    leaf: float = 1e-2


LIMITS = PivotLimits()


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
        products = np.empty((Y.shape[1], B.shape[1], len(omega)), complex)
        smallest, sizes = np.empty(len(omega)), (len(omega), *B.shape, Y.shape[1])
        B_ordered, Y_ordered = B.take(self.order, axis=0), Y.take(self.order, axis=0)
        matrices = (matrix.take(places) for matrix in (M, D, K))
        call("eliminate", *sizes, *matrices, B_ordered, omega, later, many, Y_ordered, products, smallest)
        weak = np.flatnonzero(~(smallest > LIMITS.elimination**2))  # not above: NaN too
        if len(weak):
            of_lines = omega[weak, None, None]
            X = np.linalg.solve(K + 1j * of_lines * D - of_lines**2 * M, B.astype(complex)).transpose(1, 2, 0)
            # One product of real matrices, since Y is real and may have thousands of columns.
            real = np.ascontiguousarray(X).reshape(len(Y), -1).view(np.float64)
            if len(weak) == len(omega):
                np.matmul(Y.T, real, out=products.reshape(Y.shape[1], -1).view(np.float64))
            else:
                products[:, :, weak] = (Y.T @ real).view(np.complex128).reshape(-1, *X.shape[1:])
        return np.asarray(products.T)

    @cached_property
    def _later(self) -> tuple[IntArray, IntArray, IntArray]:
        """The columns of each row of L^T that are not zero, the first of each row of (n, n), and how many (n,).

        Last, where each entry (n, n) of a matrix in this order stands in the matrix.
        """
        later = np.argsort(~self.filled, axis=1, kind="stable").astype(np.int64)
        return later, self.filled.sum(axis=1), self.order[:, None] * len(self.order) + self.order


@dataclass(frozen=True)
class Leaves:
    """The order (n,) of the coordinates: those on which one leaf each acts, the others, the n_l leaves as the first."""

    order: IntArray
    n_l: int

    @classmethod
    def of(cls, coupled: BoolArray) -> Leaves:
        """Of a pattern (n, n): which coordinates act on each other."""
        acts = coupled & ~np.eye(len(coupled), dtype=bool)
        degree, taken = acts.sum(axis=1), np.zeros(len(acts), dtype=bool)
        leaf: list[int] = []
        for i in np.flatnonzero(degree == 1):
            neighbour = int(np.flatnonzero(acts[i])[0])
            if not taken[i] and not taken[neighbour]:
                leaf.append(int(i))
                taken[i] = taken[neighbour] = True
        on = [int(np.flatnonzero(acts[i])[0]) for i in leaf]
        remaining = [i for i in range(len(acts)) if i not in {*leaf, *on}]
        return cls(np.array([*on, *remaining, *leaf], np.int64), len(leaf))

    def products(
        self, M: FloatArray, D: FloatArray, K: FloatArray, omega: FloatArray, B: FloatArray, Y: FloatArray
    ) -> ComplexArray:
        """B^T Z^-1 Y (F, m, n_d) of Z = K + j omega D - omega^2 M, real B (n, m), Y (n, n_d).

        Raises LinAlgError where Z is singular.
        """
        B, Y = B.take(self.order, axis=0), Y.take(self.order, axis=0)
        X = self._solved(M.take(self._places), D.take(self._places), K.take(self._places), omega, B)
        if X is None:
            ordered = np.ix_(self.order, self.order)
            Z = _stiffness(M[ordered], D[ordered], K[ordered], omega)
            X = np.ascontiguousarray(np.linalg.solve(Z, B.astype(complex)).swapaxes(0, 1))
        # Y is real: one product for the real and imaginary parts of all lines.
        products = (Y.T @ X.reshape(len(X), -1).view(np.float64)).view(np.complex128).reshape(-1, *X.shape[1:])
        return np.ascontiguousarray(products.transpose(1, 2, 0))

    def _solved(
        self, M: FloatArray, D: FloatArray, K: FloatArray, omega: FloatArray, B: FloatArray
    ) -> ComplexArray | None:
        """X (n, F, m) in this order, of the entries at `_places`; None where a leaf is near a resonance of its own."""
        (n, m), n_l = B.shape, self.n_l
        n_r, F = n - n_l, len(omega)
        Z = _stiffness(M, D, K, omega)
        leaf = slice(n_r * n_r, n_r * n_r + n_l)
        Z_rr, own, z = Z[:, : n_r * n_r].reshape(F, n_r, n_r), Z[:, leaf], Z[:, leaf.stop :]
        size = np.abs(K[leaf]) + omega[:, None] ** 2 * np.abs(M[leaf])
        if np.any(np.abs(own) < LIMITS.leaf * size):
            return None
        share = z / own
        Z[:, : n_l * (n_r + 1) : n_r + 1] -= z * share  # the diagonal of Z_rr
        right = np.empty((F, n_r, m), complex)
        right[:] = B[:n_r]
        right[:, :n_l] -= share[:, :, None] * B[n_r:]
        X = np.empty((n, F, m), complex)
        X[:n_r] = np.linalg.solve(Z_rr, right).swapaxes(0, 1)
        np.multiply(-share.T[:, :, None], X[:n_l], out=X[n_r:])
        X[n_r:] += (1 / own).T[:, :, None] * B[n_r:, None]
        return X

    @cached_property
    def _places(self) -> IntArray:
        """Where in a matrix Z_rr, the leaves' diagonal and their other entries stand."""
        n, n_l = len(self.order), self.n_l
        rest, on, leaf = self.order[: n - n_l], self.order[:n_l], self.order[n - n_l :]
        return np.concatenate([(rest[:, None] * n + rest).ravel(), leaf * n + leaf, leaf * n + on])


def _stiffness(M: FloatArray, D: FloatArray, K: FloatArray, omega: FloatArray) -> ComplexArray:
    """Z of all lines (F, ...) in one real product: [1, omega, -omega^2] times K and M (real parts) and D."""
    parts = np.zeros((3, M.size, 2))
    parts[0, :, 0], parts[1, :, 1], parts[2, :, 0] = K.ravel(), D.ravel(), M.ravel()
    Z = np.stack([np.ones_like(omega), omega, -(omega**2)], axis=1) @ parts.reshape(3, -1)
    return Z.view(complex).reshape(len(omega), *M.shape)
