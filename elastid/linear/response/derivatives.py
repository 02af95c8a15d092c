r"""The derivatives of one response as few columns: parameters that change Z along the same matrix share one.

.. math:: -dG_p = c \sum_t s^{k_t} \sigma_t\, W^T E_{b_t} X, \qquad dZ_p = \sum_t s^{k_t} \sigma_t E_{b_t}

A spring and its damper share E, and so do a rotor and its friction, so that P parameters have fewer columns
W^T E_b X than pieces t. Bases of rank one are a product of two vectors, E = +-y y^T; the others, of masses and all that
moves the robot under gravity, E = V S V^T, share the few directions V that they span together. Where inputs and outputs
are the same directions G is symmetric, and only the elements on and above its diagonal are computed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.linear.linear_model import Slope
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.rank_one_terms import as_rank_one
from elastid.linear.response.sensitivity import Sensitivity

# Matrices of length one that differ by less than this are equal.
EQUAL_TOLERANCE = 1e-12
# The product of two that may be.
NEARLY_ONE = 1 - 1e-6


@dataclass(frozen=True)
class Pieces:
    """dZ of the wanted parameters: base b is E[0, b] - omega^2 E[1, b], E (2, n_b, n, n), of a size near one.

    omega is over the highest of all lines, and E[1] zero where a base is of rank one.
    base, power (n_t,) of each piece, sigma (n_t, P). A factor of the response (delay, chain, gain) or a parameter that
    moves C or T (geometry) has a column -dG / dp of its own, behind the bases.
    """

    E: FloatArray
    base: IntArray
    power: IntArray
    sigma: FloatArray


@dataclass(frozen=True)
class Directions:
    """Bases of rank one, +-E = y y^T: sign (n_1,), y (n, n_1); the others E = V S V^T: V (n, r), S (2, n_2, r, r)."""

    sign: FloatArray
    y: FloatArray
    V: FloatArray
    S: FloatArray


@dataclass(frozen=True, eq=False)
class Columns:
    """A kernel's response and derivatives, element by element and base by base."""

    kernel: Kernel

    def size(self, theta: FloatArray) -> FloatArray:
        """|theta| (P,) of the wanted parameters, 1 where one is zero."""
        here = np.abs(theta[self.kernel.places])
        here[here == 0] = 1.0
        return here

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether G = G^T: outputs in the directions of the inputs, none an accelerometer that tilts, no gains.

        Torques are held alike, or none is.
        """
        model = self.kernel.model
        is_alike = model.hold is None or model.hold.is_uniform
        own = model.tilt.any() or model.moved_outputs or model.gains
        return is_alike and np.array_equal(model.B.T, model.C) and not own

    @cached_property
    def elements(self) -> tuple[IntArray, IntArray]:
        """Rows and columns (n_e,) of the elements of G that are computed."""
        n_y, n_u = self.kernel.model.C.shape[0], self.kernel.model.B.shape[1]
        rows, columns = np.triu_indices(n_u) if self.is_symmetric else np.indices((n_y, n_u)).reshape(2, -1)
        return np.asarray(rows, np.int64), np.asarray(columns, np.int64)

    @cached_property
    def omega_0(self) -> float:
        """The highest of all lines, 1 without any."""
        return 2 * np.pi * float(self.kernel.freq_hz.max(initial=0.0)) or 1.0

    @cached_property
    def pieces(self) -> Pieces:
        """The pieces of all wanted parameters; bases of rank one first."""
        bases: list[FloatArray] = []
        found: list[tuple[int, int, int, float]] = []
        for place, name in enumerate(self.kernel.wanted):
            slope = self.kernel.model.slopes.get(name, Slope())
            given = {
                power: matrix
                for power, matrix in enumerate((slope.K, slope.D, slope.M))
                if matrix is not None and np.any(matrix)
            }
            if all(power in given and as_rank_one(given[power]) is None for power in (0, 2)):
                both = np.stack([given.pop(0), self.omega_0**2 * given.pop(2)])
                size = float(np.linalg.norm(both))
                found.append((place, len(bases), 0, size))
                bases.append(both / size)
            for power, matrix in given.items():
                base, sigma = _base(bases, matrix)
                found.append((place, base, power, sigma))
        others = (*self.kernel.factors, *self.kernel.moved_outputs)
        found += [(self.kernel.wanted.index(name), len(bases) + i, 0, 1.0) for i, name in enumerate(others)]
        order = sorted(range(len(bases)), key=lambda b: bases[b][1].any() or as_rank_one(bases[b][0]) is None)
        now_at = np.append(np.argsort(order), len(bases) + np.arange(len(others))).astype(np.int64)
        sigma_of = np.zeros((len(found), len(self.kernel.wanted)))
        for t, (place, _, _, sigma) in enumerate(found):
            sigma_of[t, place] = sigma
        n = self.kernel.model.n
        return Pieces(
            np.array(bases).reshape(-1, 2, n, n)[order].swapaxes(0, 1),
            now_at[[base for _, base, _, _ in found]],
            np.array([power for _, _, power, _ in found], np.int64),
            sigma_of,
        )

    @cached_property
    def _directions(self) -> Directions:
        E, n = self.pieces.E, self.kernel.model.n
        parts = [None if both[1].any() else as_rank_one(both[0]) for both in E.swapaxes(0, 1)]
        single = [part for part in parts if part is not None]
        others = E[:, len(single) :]
        V = _span(others.reshape(-1, n, n))
        sign, y = np.array([sign for sign, _ in single]), np.array([y for _, y in single]).reshape(-1, n).T
        return Directions(sign, y, V, V.T @ others @ V)

    def at(self, theta: FloatArray) -> Iterator[Sensitivity]:
        """Block by block at theta (n_theta,)."""
        rows, columns = self.elements
        of, n_u, kernel = self._directions, self.kernel.model.B.shape[1], self.kernel
        places = rows * n_u + columns
        images, of_images = self._of_factors.evaluate_images(theta) if kernel.is_held else (None, None)
        for block, s, gain, response, YX, moved in kernel.products(theta, self._asked):
            # The loops leave the lines of an element side by side.
            G = response.transpose(1, 2, 0).reshape(-1, len(s)).take(places, axis=0).T
            right = YX if YX.shape[1] == n_u else YX[:, :n_u]
            left = YX if self._is_own else YX[:, kernel.output_columns]
            if kernel.model.gains:
                of_y, of_u = kernel.model.channel_gains(theta)
                left, right = of_y[:, None] * left, of_u[:, None] * right
            factors = [
                np.broadcast_to(slope, response.shape)[:, rows, columns] * G
                for _, slope in kernel.factor_slopes(theta, s)
            ]
            if images is not None and of_images is not None:
                G = G + images[block][:, rows, columns]
                factors = [one + more[block][:, rows, columns] for one, more in zip(factors, of_images, strict=True)]
            others = [*factors, *moved[:, :, rows, columns]]
            whole = -np.stack(others, axis=2) if others else np.zeros((*G.shape, 0), complex)
            omega = s.imag / self.omega_0
            yield Sensitivity(block, s, omega, gain, G, left, right, of.sign, of.S, whole, rows, columns)

    @cached_property
    def _asked(self) -> FloatArray:
        """The directions of all bases (n, n_1 + r)."""
        return np.hstack([self._directions.y, self._directions.V])

    @cached_property
    def _is_own(self) -> bool:
        """Whether the right sides are the outputs' directions, in their order."""
        return np.array_equal(self.kernel.output_columns, np.arange(self.kernel.model.B.shape[1]))

    def pull_images(self, theta: FloatArray, weight: ComplexArray) -> FloatArray:
        """Re sum_fe weight_fe dG_fe (P,) of the images that are not in the columns, weight (F, n_e)."""
        kernel, pulled = self.kernel, np.zeros(len(self.kernel.wanted))
        spread = np.zeros((len(weight), len(kernel.model.outputs), len(kernel.model.inputs)), complex)
        spread[:, *self.elements] = weight
        places = [kernel.wanted.index(name) for name in self._images_of_others.wanted]
        pulled[places] = self._images_of_others.pull_images(theta, spread)
        return pulled

    @cached_property
    def _of_factors(self) -> Kernel:
        """The kernel of delay, chain and gains alone."""
        return replace(self.kernel, wanted=self.kernel.factors)

    @cached_property
    def _images_of_others(self) -> Kernel:
        """The kernel of all others."""
        return replace(
            self.kernel, wanted=tuple(name for name in self.kernel.wanted if name not in self.kernel.factors)
        )


def _base(bases: list[FloatArray], matrix: FloatArray) -> tuple[int, float]:
    """The place among the bases of a matrix, added where it is new, and its factor."""
    sigma = float(np.linalg.norm(matrix))
    both = np.stack([matrix / sigma, np.zeros_like(matrix)])
    for place, other in enumerate(bases):
        product = float(np.vdot(both, other))
        if abs(product) > NEARLY_ONE and np.abs(both - np.sign(product) * other).max() < EQUAL_TOLERANCE:
            return place, sigma * float(np.sign(product))
    bases.append(both)
    return len(bases) - 1, sigma


def _span(matrices: FloatArray) -> FloatArray:
    """Directions (n, r) that symmetric matrices (N, n, n) span: coordinates, or fewer by half that are a mixture."""
    stacked = matrices.transpose(1, 0, 2).reshape(matrices.shape[1], -1)
    U, size, _ = np.linalg.svd(stacked, full_matrices=False)
    U, touched = U[:, size > EQUAL_TOLERANCE * size.max(initial=0.0)], np.flatnonzero(stacked.any(axis=1))
    return U if 2 * U.shape[1] <= len(touched) else np.eye(len(stacked))[:, touched]
