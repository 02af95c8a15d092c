r"""The derivatives of one response as few columns: parameters that change Z along the same matrix share one.

.. math:: -dG_p = c \sum_t s^{k_t} \sigma_t\, W^T E_{b_t} X, \qquad dZ_p = \sum_t s^{k_t} \sigma_t E_{b_t}

A spring and its damper share E, and so do a rotor and its friction, so that P parameters have fewer columns
W^T E_b X than pieces t. Where inputs and outputs are the same directions G is symmetric, and only the elements on and
above its diagonal are worked out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elastid.arrays import ComplexArray, FloatArray, IntArray
from elastid.linear.linear_model import DELAY, Slope
from elastid.linear.transfer import Kernel

# Matrices of length one that differ by less than this are the same.
SAME = 1e-12


@dataclass(frozen=True)
class Pieces:
    """dZ of the wanted parameters: E (n_b, n, n) of length one; base, power (n_t,) of each piece, sigma (n_t, P).

    The torque delay has the response itself as its column, the last one, at base n_b: -dG / dT_d = s G.
    """

    E: FloatArray
    base: IntArray
    power: IntArray
    sigma: FloatArray


@dataclass(frozen=True)
class Sensitivity:
    """One block of lines: G (F, n_e) of the elements, and columns c W^T E_b X (F, n_e, n_b), s = j omega (F,)."""

    block: slice
    s: ComplexArray
    G: ComplexArray
    columns: ComplexArray


@dataclass(frozen=True, eq=False)
class Columns:
    """A kernel's response and derivatives, element by element and base by base."""

    kernel: Kernel

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether G = G^T: outputs in the directions of the inputs."""
        return np.array_equal(self.kernel.model.B.T, self.kernel.model.C)

    @cached_property
    def elements(self) -> tuple[IntArray, IntArray]:
        """Rows and columns (n_e,) of the elements of G that are worked out."""
        n_y, n_u = self.kernel.model.C.shape[0], self.kernel.model.B.shape[1]
        rows, columns = np.triu_indices(n_u) if self.is_symmetric else np.indices((n_y, n_u)).reshape(2, -1)
        return np.asarray(rows, np.int64), np.asarray(columns, np.int64)

    @cached_property
    def pieces(self) -> Pieces:
        """The pieces of all wanted parameters."""
        bases: list[FloatArray] = []
        found: list[tuple[int, int, int, float]] = []
        for place, name in enumerate(self.kernel.wanted):
            slope = self.kernel.model.slopes.get(name, Slope())
            for power, matrix in enumerate((slope.K, slope.D, slope.M)):
                if matrix is not None and np.any(matrix):
                    base, sigma = _base(bases, matrix)
                    found.append((place, base, power, sigma))
        found += [(p, len(bases), 1, 1.0) for p, name in enumerate(self.kernel.wanted) if name == DELAY]
        sigma_of = np.zeros((len(found), len(self.kernel.wanted)))
        for t, (place, _, _, sigma) in enumerate(found):
            sigma_of[t, place] = sigma
        n = self.kernel.model.n
        return Pieces(
            np.array(bases).reshape(-1, n, n),
            np.array([base for _, base, _, _ in found], np.int64),
            np.array([power for _, _, power, _ in found], np.int64),
            sigma_of,
        )

    @cached_property
    def _factors(self) -> tuple[IntArray, ComplexArray, IntArray]:
        """Bases of rank one, their y in E = +-y y^T as columns (n, n_1), and the others."""
        E = self.pieces.E
        values, vectors = np.linalg.eigh(E) if len(E) else (np.zeros((0, 1)), np.zeros((0, 1, 1)))
        largest = np.argmax(np.abs(values), axis=1)
        single = np.array([np.sum(np.abs(v) > 1e-12 * np.abs(v).max()) == 1 for v in values], dtype=bool)
        one, many = np.flatnonzero(single), np.flatnonzero(~single)
        y = np.array([vectors[b][:, largest[b]] * np.emath.sqrt(values[b, largest[b]]) for b in one], complex)
        return one, y.reshape(len(one), self.kernel.model.n).T, many

    def at(self, theta: FloatArray) -> Iterator[Sensitivity]:
        """Block by block at theta (n_theta,)."""
        rows, columns = self.elements
        one, y, many = self._factors
        E, delayed = self.pieces.E, DELAY in self.kernel.wanted
        places, n_u = self.kernel.output_columns, self.kernel.model.B.shape[1]
        for block, s, X, gain in self.kernel.solutions(theta):
            F, n, m = X.shape
            right = X[:, :, :n_u]
            G = (gain[:, None, None] * (self.kernel.model.C @ right))[:, rows, columns]
            found = np.empty((F, len(rows), len(E) + delayed), complex)
            if len(one):
                YX = (np.ascontiguousarray(X.transpose(0, 2, 1)).reshape(F * m, n) @ y).reshape(F, m, len(one))
                left = YX.take(places[rows], axis=1)
                left *= (gain[:, None, None] * YX[:, :n_u]).take(columns, axis=1)
                found[:, :, one] = left
            for b in many:
                full = X.transpose(0, 2, 1) @ (E[b] @ right)
                found[:, :, b] = gain[:, None] * full[:, places[rows], columns]
            if delayed:
                found[:, :, -1] = G
            yield Sensitivity(block, s, G, found)


def _base(bases: list[FloatArray], matrix: FloatArray) -> tuple[int, float]:
    """The place among the bases of a matrix, added where it is new, and its factor."""
    sigma = float(np.linalg.norm(matrix))
    E = matrix / sigma
    for place, other in enumerate(bases):
        product = float(np.sum(E * other))
        if np.abs(E - np.sign(product) * other).max() < SAME:
            return place, sigma * float(np.sign(product))
    bases.append(E)
    return len(bases) - 1, sigma
