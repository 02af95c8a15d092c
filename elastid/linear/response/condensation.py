r"""Z(omega) X = B, leaves condensed first: coordinates on which only one other acts, as motors behind their gears.

.. math:: \Big(Z_{rr} - \sum_l \frac{z_l^2}{Z_{ll}} e_l e_l^T\Big) X_r = B_r - \sum_l \frac{z_l}{Z_{ll}} e_l B_l, \qquad
          X_l = \frac{B_l - z_l X_{r(l)}}{Z_{ll}}

The path of NumPy alone: an LU of 12 rows instead of 18 for six motors on twelve further coordinates. A leaf on its own
resonance without damping has no quotient; lines near one are solved whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray

# |Z_ll| beside the sizes of its terms, below which the quotient would cost digits.
MIN_PIVOT = 1e-2


@dataclass(frozen=True)
class Leaves:
    """Which coordinates are leaves (n_l,), the others (n_r,), and which of the others each leaf acts on (n_l,).

    No two leaves act on the same one.
    """

    leaf: IntArray
    other: IntArray
    on: IntArray

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
        chosen = np.array(leaf, np.int64)
        other = np.setdiff1d(np.arange(len(acts)), chosen)
        return cls(chosen, other, np.searchsorted(other, acts[chosen].argmax(axis=1) if leaf else chosen))

    def products(
        self, M: FloatArray, D: FloatArray, K: FloatArray, omega: FloatArray, B: FloatArray, Y: FloatArray
    ) -> ComplexArray:
        """B^T Z^-1 Y (F, m, n_d) of real B (n, m), Y (n, n_d); other arguments as `solve`."""
        X = np.ascontiguousarray(self.solve(M, D, K, omega, B).swapaxes(0, 1))
        # Y is real: one product for the real and imaginary parts of all lines.
        found = Y.T @ X.reshape(len(M), -1).view(np.float64)
        return np.ascontiguousarray(found.view(np.complex128).reshape(Y.shape[1], *X.shape[1:]).transpose(1, 2, 0))

    def solve(self, M: FloatArray, D: FloatArray, K: FloatArray, omega: FloatArray, B: FloatArray) -> ComplexArray:
        """X (F, n, m) of Z = K + j omega D - omega^2 M and real B (n, m); LinAlgError where Z is singular."""
        if not self.leaf.size:
            return _solved(_stiffness(M, D, K, omega), B)
        leaf, other, on = self.leaf, self.other, self.on
        n_l, n_r = leaf.size, other.size
        rows, columns = (np.concatenate([many, leaf, leaf]) for many in (np.repeat(other, n_r), np.tile(other, n_r)))
        columns[-n_l:] = other[on]
        Z = _stiffness(M[rows, columns], D[rows, columns], K[rows, columns], omega)
        Z_rr, own, z = Z[:, : n_r * n_r].reshape(-1, n_r, n_r), Z[:, n_r * n_r : -n_l], Z[:, -n_l:]
        size = np.abs(K[leaf, leaf]) + omega[:, None] ** 2 * np.abs(M[leaf, leaf])
        if np.any(np.abs(own) < MIN_PIVOT * size):
            return _solved(_stiffness(M, D, K, omega), B)
        share = z / own
        Z_rr[:, on, on] -= z * share
        right = np.broadcast_to(B[other].astype(complex), (len(omega), n_r, B.shape[1])).copy()
        i, j = np.nonzero(B[leaf])
        right[:, on[i], j] -= share[:, i] * B[leaf[i], j]
        X = np.empty((len(M), len(omega), B.shape[1]), complex).swapaxes(0, 1)  # row by row, as `products` takes it
        solved = np.linalg.solve(Z_rr, right)
        X[:, other] = solved
        X[:, leaf] = -share[:, :, None] * solved[:, on]
        X[:, leaf[i], j] += B[leaf[i], j] / own[:, i]
        return X


def _stiffness(M: FloatArray, D: FloatArray, K: FloatArray, omega: FloatArray) -> ComplexArray:
    """Z of all lines (F, ...) in one real product: [1, omega, -omega^2] times K and M (real parts) and D."""
    parts = np.zeros((3, M.size, 2))
    parts[0, :, 0], parts[1, :, 1], parts[2, :, 0] = K.ravel(), D.ravel(), M.ravel()
    Z = np.stack([np.ones_like(omega), omega, -(omega**2)], axis=1) @ parts.reshape(3, -1)
    return Z.view(complex).reshape(len(omega), *M.shape)


def _solved(Z: ComplexArray, B: FloatArray) -> ComplexArray:
    return np.asarray(np.linalg.solve(Z, B.astype(complex)))
