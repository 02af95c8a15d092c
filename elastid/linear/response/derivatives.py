r"""The derivatives of one response as few columns: parameters that change Z along the same matrix share one.

.. math:: -dG_p = c \sum_t s^{k_t} \sigma_t\, W^T E_{b_t} X, \qquad dZ_p = \sum_t s^{k_t} \sigma_t E_{b_t}

A spring and its damper share E, and so do a rotor and its friction, so that P parameters have fewer columns
W^T E_b X than pieces t. Where inputs and outputs are the same directions G is symmetric, and only the elements on and
above its diagonal are computed.
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

# Matrices of length one that differ by less than this are equal.
EQUAL_TOLERANCE = 1e-12


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
class Sensitivity:
    """One block of lines: s = j omega (F,), G (F, n_e) of the elements, and the columns c W^T E_b X by their factors.

    Images of held torques are in G, and in columns of factors; of the others `Columns.pull_images` has the derivatives.
    of_outputs (F, n_y, n_1), of_inputs (F, n_u, n_1): W^T y and c y^T X of the bases of rank one.  whole (F, n_e, n_2):
    the columns of all others.  outputs, inputs (n_e,): output and input of each element.
    """

    block: slice
    s: ComplexArray
    G: ComplexArray
    of_outputs: ComplexArray
    of_inputs: ComplexArray
    whole: ComplexArray
    outputs: IntArray
    inputs: IntArray

    def columns(
        self, scale: FloatArray, precision: type[np.floating[Any]]
    ) -> npt.NDArray[np.complexfloating[Any, Any]]:
        """Columns (F, n_e, n_b), each times its scale (n_b,)."""
        F, _, n_1 = self.of_outputs.shape
        found = np.empty((F, len(self.outputs), n_1 + self.whole.shape[2]), np.result_type(precision, np.complex64))
        left, right = (self.of_outputs * scale[:n_1]).astype(found.dtype), self.of_inputs.astype(found.dtype)
        np.multiply(left.take(self.outputs, axis=1), right.take(self.inputs, axis=1), out=found[:, :, :n_1])
        np.multiply(self.whole, scale[n_1:], out=found[:, :, n_1:], casting="same_kind")
        return found

    def pull(self, weight: ComplexArray) -> ComplexArray:
        """sum_e weight_e U_eb (F, n_b) of the columns U, weight (F, n_e)."""
        F, n_y, _ = self.of_outputs.shape
        spread = np.zeros((F, n_y, self.of_inputs.shape[1]), complex)
        spread[:, self.outputs, self.inputs] = weight
        simple = np.sum(self.of_outputs * (spread @ self.of_inputs), axis=1)
        return np.concatenate([simple, (weight[:, None, :] @ self.whole)[:, 0]], axis=1)


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
        simple = [_root(E) is not None for E in bases]
        order = sorted(range(len(bases)), key=lambda b: not simple[b])
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
    def _factors(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Signs (n_1,) and y of the bases of rank one, +-E = y y^T, as columns (n, n_1); the others side by side."""
        n, roots = self.kernel.model.n, [_root(E) for E in self.pieces.E]
        sign = np.array([root[0] for root in roots if root is not None])
        y = np.array([root[1] for root in roots if root is not None]).reshape(-1, n).T
        others = self.pieces.E[y.shape[1] :]
        return sign, y, others.transpose(1, 0, 2).reshape(n, -1)

    def at(self, theta: FloatArray) -> Iterator[Sensitivity]:
        """Block by block at theta (n_theta,)."""
        rows, columns = self.elements
        sign, y, wide = self._factors
        n_1, n_2, n_u = y.shape[1], len(self.pieces.E) - y.shape[1], self.kernel.model.B.shape[1]
        places = self.kernel.output_columns
        of_y, of_u = self.kernel.model.channel_gains(theta)
        n_f, n_m = len(self.kernel.factors), len(self.kernel.moved_outputs)
        images, of_images = self._of_factors.evaluate_images(theta)
        asked = np.hstack([y, wide, *self._whole_solution])
        for block, s, gain, response, YX, moved in self.kernel.products(theta, asked):
            F, m = YX.shape[:2]
            G = response[:, rows, columns]
            whole = np.empty((F, len(rows), n_2 + n_f + n_m), complex)
            if n_2:
                n = self.kernel.model.n
                EX = YX[:, :, n_1 : n_1 + n_2 * n].reshape(F, m * n_2, n)
                X = YX[:, :n_u, n_1 + n_2 * n :].swapaxes(1, 2)
                full = (EX @ (gain[:, None, None] * X)).reshape(F, -1)
                place = (places[rows][:, None] * n_2 + np.arange(n_2)) * n_u + columns[:, None]
                whole[:, :, :n_2] = full.take(place.ravel(), axis=1).reshape(F, len(rows), n_2)
                whole[:, :, :n_2] *= (of_y[rows] * of_u[columns])[:, None]
            for i, (_, slope) in enumerate(self.kernel.factor_slopes(theta, s), start=n_2):
                whole[:, :, i] = -np.broadcast_to(slope, response.shape)[:, rows, columns] * G
            whole[:, :, n_2 : n_2 + n_f] -= of_images[:, block, rows, columns].transpose(1, 2, 0)
            whole[:, :, n_2 + n_f :] = -moved[:, :, rows, columns].transpose(1, 2, 0)
            of_outputs = of_y[:, None] * sign * YX[:, places, :n_1]
            of_inputs = gain[:, None, None] * of_u[:, None] * YX[:, :n_u, :n_1]
            everything = G + images[block][:, rows, columns]
            yield Sensitivity(block, s, everything, of_outputs, of_inputs, whole, rows, columns)

    def pull_images(self, theta: FloatArray, weight: ComplexArray) -> FloatArray:
        """Re sum_fe weight_fe dG_fe (P,) of the images that are not in the columns, weight (F, n_e)."""
        kernel, pulled = self.kernel, np.zeros(len(self.kernel.wanted))
        spread = np.zeros((len(weight), len(kernel.model.outputs), len(kernel.model.inputs)), complex)
        spread[:, *self.elements] = weight
        places = [kernel.wanted.index(name) for name in self._of_others.wanted]
        pulled[places] = self._of_others.pull_images(theta, spread)
        return pulled

    @cached_property
    def _of_factors(self) -> Kernel:
        """The kernel of delay, chain and gains alone."""
        return replace(self.kernel, wanted=self.kernel.factors)

    @cached_property
    def _of_others(self) -> Kernel:
        """The kernel of all others."""
        return replace(
            self.kernel, wanted=tuple(name for name in self.kernel.wanted if name not in self.kernel.factors)
        )

    @property
    def _whole_solution(self) -> tuple[FloatArray, ...]:
        """Directions that ask for X itself, where a base is of a higher rank."""
        return (np.eye(self.kernel.model.n),) if self._factors[2].size else ()


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


def _root(E: FloatArray) -> tuple[float, FloatArray] | None:
    """Sign and y of E = +-y y^T; None for a higher rank."""
    values, vectors = np.linalg.eigh(E)
    largest = int(np.argmax(np.abs(values)))
    if np.sum(np.abs(values) > EQUAL_TOLERANCE * abs(values[largest])) > 1:
        return None
    return float(np.sign(values[largest])), vectors[:, largest] * np.sqrt(abs(values[largest]))
