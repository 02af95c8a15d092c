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
from typing import Any

import numpy as np
import numpy.typing as npt

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.linear.linear_model import Slope
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.rank_one_terms import rank_one_parts

# Matrices of length one that differ by less than this are equal.
EQUAL_TOLERANCE = 1e-12
# So many lines of the products with bases of a higher rank stay in the cache.
CACHED_LINES = 20


@dataclass(frozen=True)
class Pieces:
    """dZ of the wanted parameters: E (n_b, n, n) of length one; base, power (n_t,) of each piece, sigma (n_t, P).

    A factor of the response (delay, chain, gain) or a parameter that moves C or T (geometry) has a column -dG / dp of
    its own, behind the bases.
    """

    E: FloatArray
    base: IntArray
    power: IntArray
    sigma: FloatArray


@dataclass(frozen=True)
class Directions:
    """Bases of rank one, +-E = y y^T: sign (n_1,), y (n, n_1); the others E = V S V^T: V (n, r), S (r, n_2 r)."""

    sign: FloatArray
    y: FloatArray
    V: FloatArray
    S: FloatArray


@dataclass(frozen=True)
class Sensitivity:
    """One block of lines: s = j omega (F,), G (F, n_e) of the elements, and the columns c W^T E_b X by their factors.

    Images of held torques are in G, and in columns of factors; of the others `Columns.pull_images` has the derivatives.
    left (F, n_y, n_1), right (F, n_u, n_1), sign (n_1,), gain (F,): W^T y and y^T X of the bases of rank one, and c.
    whole (F, n_e, n_2): the columns of all others.  outputs, inputs (n_e,): output and input of each element.
    """

    block: slice
    s: ComplexArray
    gain: ComplexArray
    G: ComplexArray
    left: ComplexArray
    right: ComplexArray
    sign: FloatArray
    whole: ComplexArray
    outputs: IntArray
    inputs: IntArray

    @property
    def is_alike(self) -> bool:
        """Whether left and right are the same numbers, in the same memory."""
        return self.left.shape == self.right.shape and self.left.ctypes.data == self.right.ctypes.data

    def columns(
        self, scale: FloatArray, precision: type[np.floating[Any]]
    ) -> npt.NDArray[np.complexfloating[Any, Any]]:
        """Columns (F, n_e, n_b), each times its scale (n_b,)."""
        n_1 = len(self.sign)
        found = np.empty((len(self.s), len(self.outputs), len(scale)), np.result_type(precision, np.complex64))
        right = self.right.astype(found.dtype)
        left = right if self.is_alike else self.left.astype(found.dtype)
        left = left * (self.gain[:, None] * (self.sign * scale[:n_1])).astype(found.dtype)[:, None]
        np.multiply(left.take(self.outputs, axis=1), right.take(self.inputs, axis=1), out=found[:, :, :n_1])
        np.multiply(self.whole, scale[n_1:], out=found[:, :, n_1:], casting="same_kind")
        return found

    def pull(self, weight: ComplexArray) -> ComplexArray:
        """sum_e weight_e U_eb (F, n_b) of the columns U, weight (F, n_e)."""
        spread = np.zeros((len(weight), self.left.shape[1], self.right.shape[1]), complex)
        spread[:, self.outputs, self.inputs] = self.gain[:, None] * weight
        pulled = np.sum(self.left * (spread @ self.right), axis=1) * self.sign
        return np.concatenate([pulled, (weight[:, None, :] @ self.whole)[:, 0]], axis=1)


@dataclass(frozen=True, eq=False)
class Columns:
    """A kernel's response and derivatives, element by element and base by base."""

    kernel: Kernel

    def size(self, theta: FloatArray) -> FloatArray:
        """|theta| (P,) of the wanted parameters, 1 where one is zero."""
        here = np.abs(theta[self.kernel.places])
        return np.where(here > 0, here, 1.0)

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
    def pieces(self) -> Pieces:
        """The pieces of all wanted parameters; bases of rank one first."""
        bases: list[FloatArray] = []
        found: list[tuple[int, int, int, float]] = []
        for place, name in enumerate(self.kernel.wanted):
            slope = self.kernel.model.slopes.get(name, Slope())
            for power, matrix in enumerate((slope.K, slope.D, slope.M)):
                if matrix is not None and np.any(matrix):
                    base, sigma = _base(bases, matrix)
                    found.append((place, base, power, sigma))
        others = (*self.kernel.factors, *self.kernel.moved_outputs)
        found += [(self.kernel.wanted.index(name), len(bases) + i, 0, 1.0) for i, name in enumerate(others)]
        order = sorted(range(len(bases)), key=lambda b: len(rank_one_parts(bases[b])) > 1)
        now_at = np.append(np.argsort(order), len(bases) + np.arange(len(others))).astype(np.int64)
        sigma_of = np.zeros((len(found), len(self.kernel.wanted)))
        for t, (place, _, _, sigma) in enumerate(found):
            sigma_of[t, place] = sigma
        n = self.kernel.model.n
        return Pieces(
            np.array(bases).reshape(-1, n, n)[order],
            now_at[[base for _, base, _, _ in found]],
            np.array([power for _, _, power, _ in found], np.int64),
            sigma_of,
        )

    @cached_property
    def _directions(self) -> Directions:
        n, E = self.kernel.model.n, self.pieces.E
        parts = [rank_one_parts(one) for one in E]
        single = [terms[0] for terms in parts if len(terms) == 1]
        value, others = np.array([value for value, _ in single]), E[len(single) :]
        y = np.array([y for _, y in single]).reshape(-1, n).T * np.sqrt(np.abs(value))
        V, size, _ = np.linalg.svd(others.transpose(1, 0, 2).reshape(n, -1), full_matrices=False)
        V = V[:, size > EQUAL_TOLERANCE * size.max(initial=0.0)]
        S = (V.T @ others @ V).transpose(1, 0, 2).reshape(V.shape[1], len(others) * V.shape[1])
        return Directions(np.sign(value), y, V, S)

    def at(self, theta: FloatArray) -> Iterator[Sensitivity]:
        """Block by block at theta (n_theta,)."""
        rows, columns = self.elements
        of, n_u, kernel = self._directions, self.kernel.model.B.shape[1], self.kernel
        n_1 = of.y.shape[1]
        images, of_images = self._of_factors.evaluate_images(theta) if kernel.is_held else (None, None)
        for block, s, gain, response, YX, moved in kernel.products(theta, self._asked):
            G = response[:, rows, columns]
            left, right = YX if self._is_own else YX[:, kernel.output_columns], YX[:, :n_u]
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
            whole = self._of_others(left[:, :, n_1:], gain[:, None, None] * right[:, :, n_1:])
            if factors or len(moved):
                others = [*factors, *moved[:, :, rows, columns]]
                whole = np.concatenate([whole, -np.stack(others, axis=2)], axis=2)
            left, right = left[:, :, :n_1], right[:, :, :n_1]
            yield Sensitivity(block, s, gain, G, left, right, of.sign, whole, rows, columns)

    @cached_property
    def _asked(self) -> FloatArray:
        """The directions of all bases (n, n_1 + r)."""
        return np.hstack([self._directions.y, self._directions.V])

    @cached_property
    def _is_own(self) -> bool:
        """Whether the right sides are the outputs' directions, in their order."""
        return np.array_equal(self.kernel.output_columns, np.arange(self.kernel.model.B.shape[1]))

    def _of_others(self, left: ComplexArray, right: ComplexArray) -> ComplexArray:
        """Columns (F, n_e, n_2) of the bases of a higher rank from W^T V (F, n_y, r) and c X^T V (F, n_u, r)."""
        (F, n_y, r), n_u, (rows, columns) = left.shape, right.shape[1], self.elements
        if not r:
            return np.zeros((F, len(rows), 0), complex)
        n_2 = self._directions.S.shape[1] // r
        place = ((rows[:, None] * n_2 + np.arange(n_2)) * n_u + columns[:, None]).ravel()
        found = np.empty((F, len(rows), n_2), complex)
        for few in (slice(start, start + CACHED_LINES) for start in range(0, F, CACHED_LINES)):
            turned = (left[few].reshape(-1, r) @ self._directions.S).reshape(-1, n_y * n_2, r)
            full = turned @ right[few].swapaxes(1, 2)
            found[few] = full.reshape(len(full), -1).take(place, axis=1).reshape(-1, len(rows), n_2)
        return found

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
    E = matrix / sigma
    for place, other in enumerate(bases):
        product = float(np.sum(E * other))
        if np.abs(E - np.sign(product) * other).max() < EQUAL_TOLERANCE:
            return place, sigma * float(np.sign(product))
    bases.append(E)
    return len(bases) - 1, sigma
