r"""Derivatives of Z = K + s D + s^2 M as terms of rank one, and of a response on a block of lines by their factors.

.. math:: \partial Z / \partial \theta_p = \sum_t s^{k_t} \sigma_t\, y_t y_t^T
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from elastid.base.arrays import ComplexArray, FloatArray, IntArray

AnyComplex: TypeAlias = npt.NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True)
class Sensitivity:
    """One block of lines: s = j omega (F,), G (F, n_e) of the elements, and the columns c W^T E_b X by their factors.

    Images of held torques are in G, and in columns of factors; of the others `Columns.pull_images` has the derivatives.
    omega (F,): over the highest of all lines.  gain (F,): c.
    left (F, n_y, n_1 + r), right (F, n_u, n_1 + r): W^T [y, V] and [y, V]^T X; the bases are
    sign y y^T of rank one, sign (n_1,), and V (S[0] - omega^2 S[1]) V^T, S (2, n_2, r, r) symmetric.
    whole (F, n_e, n_3): the columns of all others.  outputs, inputs (n_e,): output and input of each element.
    """

    block: slice
    s: ComplexArray
    omega: FloatArray
    gain: ComplexArray
    G: ComplexArray
    left: ComplexArray
    right: ComplexArray
    sign: FloatArray
    S: FloatArray
    whole: ComplexArray
    outputs: IntArray
    inputs: IntArray

    @property
    def is_alike(self) -> bool:
        """True if left and right are the same array."""
        return self.left is self.right

    def columns(self, scale: FloatArray, precision: type[np.floating[Any]]) -> AnyComplex:
        """Columns (F, n_e, n_b), n_b = n_1 + n_2 + n_3, each times its scale (n_b,)."""
        n_1, n_12 = len(self.sign), len(self.sign) + self.S.shape[1]
        columns = np.empty((len(self.s), len(self.outputs), len(scale)), np.result_type(precision, np.complex64))
        right = self.right.astype(columns.dtype)
        left = right if self.is_alike else self.left.astype(columns.dtype)
        scaled = left[:, :, :n_1] * (self.gain[:, None] * (self.sign * scale[:n_1])).astype(columns.dtype)[:, None]
        scaled, other = scaled.take(self.outputs, axis=1), right[:, :, :n_1].take(self.inputs, axis=1)
        np.multiply(scaled, other, out=columns[:, :, :n_1])
        if n_12 > n_1:
            left = left[:, :, n_1:] * self.gain.astype(columns.dtype)[:, None, None]
            columns[:, :, n_1:n_12] = self._of_matrices(left, right[:, :, n_1:], scale[n_1:n_12])
        np.multiply(self.whole, scale[n_12:], out=columns[:, :, n_12:], casting="same_kind")
        return columns

    def _of_matrices(self, left: AnyComplex, right: AnyComplex, scale: FloatArray) -> AnyComplex:
        """left (F, n_y, r) times each matrix S times right (F, n_u, r) of a line: (F, n_e, n_2)."""
        (F, n_u, r), n_2, real = right.shape, len(scale), right.real.dtype
        # Rows of S by their row first, so that the matrices of a line stand side by side in one product with left.
        S = (self.S * scale[:, None, None]).transpose(0, 2, 1, 3).reshape(2, r * n_2, r).astype(real)
        lines = np.ascontiguousarray(right.swapaxes(1, 2)).view(real)
        turned = S[0] @ lines
        if S[1].any():
            turned -= S[1] @ (lines * (self.omega**2).astype(real)[:, None, None])
        full = left @ turned.view(right.dtype).reshape(F, r, n_2 * n_u)
        place = ((self.outputs[:, None] * n_2 + np.arange(n_2)) * n_u + self.inputs[:, None]).ravel()
        return np.asarray(full.reshape(F, -1).take(place, axis=1).reshape(F, len(self.outputs), n_2))

    def pull(self, weight: ComplexArray) -> ComplexArray:
        """sum over lines and elements of (j omega)^p weight U_b (3, n_b), p = 0, 1, 2, columns U; weight (F, n_e).

        Of matrices S with an omega^2 of their own p = 0 alone.
        """
        spread = np.zeros((len(weight), self.left.shape[1], self.right.shape[1]), complex)
        spread[:, self.outputs, self.inputs] = self.gain[:, None] * weight
        powers = np.stack([np.ones_like(self.omega), 1j * self.omega, -(self.omega**2)])
        rows, n_1, r = spread @ self.right, len(self.sign), self.S.shape[2]
        products = self.left[:, :, :n_1] * rows[:, :, :n_1]
        flat = products.reshape(len(rows), rows.shape[1] * n_1)
        single = (powers @ flat).reshape(3, rows.shape[1], n_1).sum(axis=1) * self.sign
        many = (powers[:, :, None, None] * rows[:, :, n_1:]).reshape(3, rows.shape[0] * rows.shape[1], r)
        between = self.left[:, :, n_1:].reshape(many.shape[1:]).T @ many
        direct = powers @ (weight[:, None, :] @ self.whole)[:, 0]
        return np.concatenate([single, self.pulled_by(between), direct], axis=1)

    def pulled_by(self, between: ComplexArray) -> ComplexArray:
        """The share of the matrices S in `pull` (3, n_2); between (3, r, r): of left^T weight right, as it has them."""
        flat = between.reshape(3, between.shape[1] ** 2)
        fixed, moved = self.S.reshape(*self.S.shape[:2], flat.shape[1])
        pulled = flat @ fixed.T
        pulled[0] += moved @ flat[2]
        return np.asarray(pulled)


def as_rank_one(matrix: FloatArray) -> tuple[float, FloatArray] | None:
    """sigma = +-1 and y of a symmetric matrix sigma y y^T; None where it is of a higher rank."""
    i = int(np.argmax(np.abs(matrix.diagonal())))
    largest = float(matrix[i, i])
    if not largest:
        return None
    y = matrix[:, i] / np.sqrt(abs(largest))
    sigma = float(np.sign(largest))
    is_all = np.abs(matrix - sigma * np.outer(y, y)).max() <= 1e-12 * abs(largest)
    return (sigma, y) if is_all else None
