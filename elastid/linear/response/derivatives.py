r"""Derivatives of a response as few columns: parameters that change Z by multiples of one matrix share a column.

.. math:: -dG_p = c \sum_t s^{k_t} \sigma_t\, W^T E_{b_t} X, \qquad dZ_p = \sum_t s^{k_t} \sigma_t E_{b_t}

A spring and its damper have the same basis E, as have a rotor and its friction, so that there are fewer columns W^T E_b
X than pieces t. Bases of rank one are products of two vectors, E = +-y y^T. The other bases, of masses and of
parameters that change the equilibrium, are E = V S V^T with few common directions V. If inputs and outputs have the
same directions, G is symmetric, and only the elements on and above its diagonal are computed. `Sensitivity` contains
the factors of the columns on a block of lines.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.messages import WorkerConstant
from elastid.linear.response.kernel import Kernel

AnyComplex: TypeAlias = npt.NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True)
class Sensitivity:
    """Block of lines: s = j omega (F,), G (F, n_e) of the elements, and the factors of the columns c W^T E_b X.

    omega (F,): relative to the highest line.  gain (F,): c.  left (F, n_y, n_1 + r), right (F, n_u, n_1 + r): W^T [y,
    V] and [y, V]^T X for the bases sign y y^T of rank one, sign (n_1,), and V (S[0] - omega^2 S[1]) V^T, with symmetric
    S (2, n_2, r, r).  whole (F, n_e, n_3): other columns.  outputs, inputs (n_e,): of each element.
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
    def has_equal_sides(self) -> bool:
        """True if left and right are the same array."""
        return self.left is self.right

    def columns(self, scale: FloatArray, precision: type[np.floating[Any]]) -> AnyComplex:
        """Return columns (F, n_e, n_b), n_b = n_1 + n_2 + n_3, each times its scale (n_b,)."""
        n_1, n_12 = len(self.sign), len(self.sign) + self.S.shape[1]
        columns = np.empty((len(self.s), len(self.outputs), len(scale)), np.result_type(precision, np.complex64))
        right = self.right.astype(columns.dtype)
        left = right if self.has_equal_sides else self.left.astype(columns.dtype)
        of_outputs = left[:, :, :n_1] * (self.gain[:, None] * (self.sign * scale[:n_1])).astype(columns.dtype)[:, None]
        of_outputs, of_inputs = of_outputs.take(self.outputs, axis=1), right[:, :, :n_1].take(self.inputs, axis=1)
        np.multiply(of_outputs, of_inputs, out=columns[:, :, :n_1])
        if n_12 > n_1:
            left = left[:, :, n_1:] * self.gain.astype(columns.dtype)[:, None, None]
            columns[:, :, n_1:n_12] = self._matrix_columns(left, right[:, :, n_1:], scale[n_1:n_12])
        np.multiply(self.whole, scale[n_12:], out=columns[:, :, n_12:], casting="same_kind")
        return columns

    def _matrix_columns(self, left: AnyComplex, right: AnyComplex, scale: FloatArray) -> AnyComplex:
        """Return left (F, n_y, r) times each matrix S times right (F, n_u, r) of a line: (F, n_e, n_2)."""
        (F, n_u, r), n_2, real = right.shape, len(scale), right.real.dtype
        # Row index of S first, so that one product with left covers all matrices of a line.
        S = (self.S * scale[:, None, None]).transpose(0, 2, 1, 3).reshape(2, r * n_2, r).astype(real)
        lines = np.ascontiguousarray(right.swapaxes(1, 2)).view(real)
        products = S[0] @ lines
        if S[1].any():
            products -= S[1] @ (lines * (self.omega**2).astype(real)[:, None, None])
        full = left @ products.view(right.dtype).reshape(F, r, n_2 * n_u)
        index = ((self.outputs[:, None] * n_2 + np.arange(n_2)) * n_u + self.inputs[:, None]).ravel()
        return np.asarray(full.reshape(F, -1).take(index, axis=1).reshape(F, len(self.outputs), n_2))

    def pull(self, weight: ComplexArray) -> ComplexArray:
        """Return sums (3, n_b) of (j omega)^p weight U_b over lines and elements, p = 0, 1, 2; weight (F, n_e).

        For matrices S with a term in omega^2 only p = 0 is defined.
        """
        spread = np.zeros((len(weight), self.left.shape[1], self.right.shape[1]), complex)
        spread[:, self.outputs, self.inputs] = self.gain[:, None] * weight
        powers = np.stack([np.ones_like(self.omega), 1j * self.omega, -(self.omega**2)])
        rows, n_1, r = spread @ self.right, len(self.sign), self.S.shape[2]
        flat = (self.left[:, :, :n_1] * rows[:, :, :n_1]).reshape(len(rows), rows.shape[1] * n_1)
        single = (powers @ flat).reshape(3, rows.shape[1], n_1).sum(axis=1) * self.sign
        weighted_rows = (powers[:, :, None, None] * rows[:, :, n_1:]).reshape(3, rows.shape[0] * rows.shape[1], r)
        between = self.left[:, :, n_1:].reshape(weighted_rows.shape[1:]).T @ weighted_rows
        direct = powers @ (weight[:, None, :] @ self.whole)[:, 0]
        return np.concatenate([single, self.matrix_pull(between), direct], axis=1)

    def matrix_pull(self, between: ComplexArray) -> ComplexArray:
        """Return the contribution of S to `pull` (3, n_2); between (3, r, r): sums of s^p left^T weight right."""
        flat = between.reshape(3, between.shape[1] ** 2)
        fixed, inertial = self.S.reshape(*self.S.shape[:2], flat.shape[1])
        pull = flat @ fixed.T
        pull[0] += inertial @ flat[2]
        return np.asarray(pull)


def rank_one_factors(matrices: FloatArray) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Flag symmetric matrices (N, n, n) of rank one, sigma y y^T. Also return sigma = +-1 (N,) and y (N, n)."""
    N = np.arange(len(matrices))
    diagonal = matrices.diagonal(axis1=1, axis2=2)
    i = np.argmax(np.abs(diagonal), axis=1)
    largest = diagonal[N, i]
    sigma, size = np.sign(largest), np.abs(largest)
    y = matrices[N, i] / np.sqrt(np.where(size > 0, size, 1.0))[:, None]
    errors = np.abs(matrices - sigma[:, None, None] * y[:, :, None] * y[:, None, :]).max(axis=(1, 2))
    return (size > 0) & (errors <= 1e-12 * size), sigma, y


EQUAL_TOLERANCE = 1e-12  # difference of equal matrices of unit norm


@dataclass(frozen=True)
class Pieces:
    """dZ of the kernel's parameters: bases sign y y^T of rank one, then E[0, b] - omega^2 E[1, b], scaled to unit size.

    sign (n_1,), y (n, n_1), E (2, n_2, n, n); omega relative to the highest line.
    base, power (n_t,): of each piece.  sigma (n_t, P): its factor for each parameter.  A factor of the response (delay,
    chain, gain), or geometry that changes C or T, has a separate column -dG / dp after the bases.
    """

    sign: FloatArray
    y: FloatArray
    E: FloatArray
    base: IntArray
    power: IntArray
    sigma: FloatArray


@dataclass(frozen=True, eq=False)
class Columns(WorkerConstant):
    """Response and derivatives of a kernel, as columns of its elements and bases."""

    kernel: Kernel

    @cached_property
    def is_symmetric(self) -> bool:
        """True if G = G^T: outputs in the directions of the inputs, no tilting accelerometer, exact channels."""
        model = self.kernel.model
        is_moved = model.T.any() or model.output_parameters or model.channel_numbers or model.controller is not None
        return np.array_equal(model.B.T, model.C) and not is_moved

    @cached_property
    def elements(self) -> tuple[IntArray, IntArray]:
        """Rows and columns (n_e,) of the computed elements of G."""
        n_y, n_u = self.kernel.model.C.shape[0], len(self.kernel.model.inputs)
        rows, columns = np.triu_indices(n_u) if self.is_symmetric else np.indices((n_y, n_u)).reshape(2, -1)
        return rows, columns

    @cached_property
    def entries(self) -> IntArray:
        """Index in `elements` of each entry of G, (n_y, n_u)."""
        (rows, columns), model = self.elements, self.kernel.model
        entries = np.empty((len(model.outputs), len(model.inputs)), np.int64)
        entries[rows, columns] = range(len(rows))
        if self.is_symmetric:
            entries[columns, rows] = range(len(rows))
        return entries

    @cached_property
    def omega_0(self) -> float:
        """Highest line in rad/s; 1 without lines."""
        return 2 * np.pi * float(self.kernel.freq_hz.max(initial=0.0)) or 1.0

    @cached_property
    def pieces(self) -> Pieces:
        """Pieces of all parameters; bases of rank one first."""
        n, parameters, terms = self.kernel.model.n, self.kernel.parameters, self.kernel.model.terms
        index = np.full(len(self.kernel.model.parameters), -1)
        index[self.kernel.places] = np.arange(len(parameters))
        place = index[np.concatenate([terms[letter][0] for letter in "KDM"])]
        power = np.repeat(np.arange(3), [len(terms[letter][0]) for letter in "KDM"])
        matrices = np.concatenate([terms[letter][1].reshape(-1, n, n) for letter in "KDM"])
        matrices[place < 0] = 0.0
        is_single, _, y = rank_one_factors(matrices)
        # Split the base of the damper off a spring that also changes the equilibrium: the remainder has fewer
        # directions.
        stiff = np.flatnonzero(~is_single & (power == 0))
        part, parts, matrices[stiff] = _split_rank_one(matrices[stiff], y[is_single])
        place, power = (np.concatenate([values, values[stiff[part]]]) for values in (place, power))
        matrices = np.concatenate([matrices, parts])
        is_single, sign, y = rank_one_factors(matrices)
        E = np.stack([matrices, np.zeros_like(matrices)], axis=1)
        # Changes of K and M of higher rank by one parameter are one piece.
        stiff, heavy = (np.flatnonzero(~is_single & (power == order)) for order in (0, 2))
        _, with_mass, masses = np.intersect1d(place[stiff], place[heavy], return_indices=True)
        E[stiff[with_mass], 1], E[heavy[masses]] = self.omega_0**2 * matrices[heavy[masses]], 0.0
        others = E.any(axis=(1, 2, 3))
        E, place, power = E[others], place[others], power[others]
        is_single, sign, y = is_single[others], sign[others], y[others]
        sigma, first = _group_multiples(E.reshape(len(E), 2 * n * n))
        # The first pieces of each base, those of rank one in front.
        bases = np.unique(first)
        bases = bases[np.argsort(~is_single[bases], kind="stable")]
        single = bases[is_single[bases]]
        direct = (*self.kernel.factors, *self.kernel.output_parameters)
        base_of = np.zeros(len(E), np.int64)
        base_of[bases] = np.arange(len(bases))
        indices = np.concatenate([place, [parameters.index(name) for name in direct]]).astype(np.int64)
        sigma_of = np.zeros((len(indices), len(parameters)))
        sigma_of[np.arange(len(indices)), indices] = np.concatenate([sigma, np.ones(len(direct))])
        return Pieces(
            sign[single],
            y[single].T / np.sqrt(np.abs(sigma[single])),
            (E[bases[len(single) :]] / sigma[bases[len(single) :], None, None, None]).swapaxes(0, 1),
            np.append(base_of[first], len(bases) + np.arange(len(direct))),
            np.concatenate([power, np.zeros(len(direct), np.int64)]),
            sigma_of,
        )

    @cached_property
    def _directions(self) -> tuple[FloatArray, FloatArray]:
        """[y, V] (n, n_1 + r) and S (2, n_2, r, r) of the bases of a higher rank, E = V S V^T."""
        E, n = self.pieces.E, self.kernel.model.n
        V = _span(E.reshape(-1, n, n))
        return np.hstack([self.pieces.y, V]), V.T @ E @ V

    def at(self, theta: FloatArray) -> Iterator[Sensitivity]:
        """Yield the sensitivities at theta (n_theta,), one block of lines at a time."""
        rows, columns = self.elements
        (directions, S), kernel = self._directions, self.kernel
        locations = rows * len(kernel.model.inputs) + columns
        for band in kernel.products(theta, directions):
            # Lines of an element are contiguous in memory, as the loops in C require.
            s, G = band.s, band.G.transpose(1, 2, 0).reshape(-1, len(band.s)).take(locations, axis=0).T
            left, right = kernel.sides(theta, band)
            factors = [slope[:, rows, columns] for slope in kernel.factor_slopes(theta, band)]
            direct = [*factors, *band.output_slopes[:, :, rows, columns]]
            direct_terms = -np.stack(direct, axis=2) if direct else np.zeros((*G.shape, 0), complex)
            omega = s.imag / self.omega_0
            bases = left, right, self.pieces.sign, S
            yield Sensitivity(band.block, s, omega, band.gain, G, *bases, direct_terms, rows, columns)

    def evaluate(self, theta: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return G (F, n_y, n_u) and its derivatives (P, F, n_y, n_u) by the P parameters at theta (n_theta,)."""
        pieces = self.pieces
        G = np.empty((self.kernel.freq_hz.size, *self.entries.shape), complex)
        dG, indices = np.empty((len(self.kernel.parameters), *G.shape), complex), np.argmax(pieces.sigma != 0, axis=1)
        for band in self.at(theta):
            U = band.columns(np.ones(pieces.base.max(initial=-1) + 1), np.float64)
            of_elements = np.zeros((len(dG), *band.G.shape), complex)
            for t, index in enumerate(indices):
                of_elements[index] -= (
                    pieces.sigma[t, index] * band.s[:, None] ** pieces.power[t] * U[:, :, pieces.base[t]]
                )
            G[band.block], dG[:, band.block] = band.G.take(self.entries, axis=1), of_elements.take(self.entries, axis=2)
        return G, dG


def _group_multiples(E: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the first row (N,) of which each row of E (N, m) is a multiple, after its factor (N,)."""
    size, first = np.sqrt(np.einsum("nm,nm->n", E, E)), np.arange(len(E))
    unit = E / size[:, None]
    cosine = unit @ unit.T
    rows, earlier = np.nonzero(np.tril(np.abs(cosine) > 1 - 1e-6, -1))
    sign = np.sign(cosine[rows, earlier])
    is_alike = np.abs(unit[rows] - sign[:, None] * unit[earlier]).max(axis=1, initial=0.0) < EQUAL_TOLERANCE
    # np.nonzero lists the earliest row first; in reverse order the earliest is assigned last.
    rows, earlier, sign = (values[is_alike][::-1] for values in (rows, earlier, sign))
    first[rows] = earlier
    size[rows] *= sign
    return size, first


def _split_rank_one(matrices: FloatArray, y: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Split multiples of y y^T, y (N_1, n), off symmetric matrices (N, n, n) if a row of the remainder is zero.

    Returns the index of the matrix of each multiple (m,), the multiples (m, n, n), and the remainders (N, n, n).
    """
    pivot = np.argmin(np.where(y != 0, matrices.any(axis=2).sum(axis=0), np.inf), axis=1)
    unit, rows = y / np.take_along_axis(y, pivot[:, None], axis=1), matrices[:, pivot]
    factor = matrices[:, pivot, pivot]
    errors = np.abs(rows - factor[:, :, None] * unit).max(axis=2, initial=0.0)
    part, vector = np.nonzero(errors < EQUAL_TOLERANCE * np.abs(factor))
    _, first = np.unique(part * y.shape[1] + pivot[vector], return_index=True)
    part, vector = np.array([part, vector])[:, first]
    at = pivot[vector]
    parts = factor[part, vector, None, None] * unit[vector, :, None] * unit[vector, None]
    np.subtract.at(matrices, part, parts)
    matrices[part, at] = matrices[part, :, at] = 0.0
    return part, parts, matrices


def _span(matrices: FloatArray) -> FloatArray:
    """Return directions (n, r) that span symmetric matrices (N, n, n): singular or, for large r, unit vectors."""
    wide = matrices.transpose(1, 0, 2).reshape(matrices.shape[1], -1)
    U, size, _ = np.linalg.svd(np.transpose(np.linalg.qr(wide.T, mode="r")))
    U, coordinates = U[:, size > EQUAL_TOLERANCE * size.max(initial=0.0)], np.flatnonzero(wide.any(axis=1))
    return U if 2 * U.shape[1] <= len(coordinates) else np.eye(len(wide))[:, coordinates]
