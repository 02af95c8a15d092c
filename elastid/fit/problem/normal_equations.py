r"""Cost, J^T r and J^T J of one configuration, worked out on as few numbers as they need.

The residuals are compressed (`compressed_residuals`), and their derivatives are few columns times powers of j omega
(`Columns`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.fit.problem.compressed_residuals import CompressedResiduals
from elastid.linear.response.derivatives import Columns


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The normal equations of the residuals of one configuration, with the columns of their derivatives."""

    columns: Columns
    residuals: CompressedResiduals

    def __reduce__(self) -> tuple[type[NormalEquations], tuple[object, ...]]:
        """To other processes without what is worked out again there."""
        return NormalEquations, (Columns(self.columns.kernel), self.residuals)

    def at(
        self, theta: FloatArray, precision: type[np.floating[Any]] = np.float64
    ) -> tuple[float, FloatArray, FloatArray]:
        """V, J^T r (P,) and J^T J (P, P) at theta (n_theta,), P the kernel's wanted parameters.

        J^T J is put together from sums over the lines of omega^p U^H U, U the weighted columns, p = 0 ... 4.
        precision: of these sums alone; single is enough for a step and takes less time. The derivatives of
        images of held torques, a thousandth of the others at a tenth of the rate, are in J^T r but not in J^T J.
        """
        pieces, highest = self.columns.pieces, self.columns.omega_0**self.columns.pieces.power
        # Columns of a size near one, whatever the units of the parameters: single precision does not reach far.
        scale = np.zeros(pieces.base.max(initial=-1) + 1)
        np.maximum.at(scale, pieces.base, np.abs(pieces.sigma @ self.columns.size(theta)) * highest)
        scale[scale == 0] = 1.0
        V, pull, moments = 0.0, np.zeros((3, len(scale)), complex), np.zeros((5, len(scale), len(scale)))
        weights, R = [], self.residuals.compressed.R
        for part in self.columns.at(theta):
            constant, e = self.residuals.at(part.block, part.G)
            found = R.sums(part, e, scale, precision)
            V += constant + found.cost
            pull += found.pulled
            moments += found.moments
            weights.append(found.weight)
        places, sign = self._pairs
        g = highest * pull[pieces.power, pieces.base].real
        sigma = (highest / scale[pieces.base])[:, None] * pieces.sigma
        A = sign * moments.take(places)
        return V, pieces.sigma.T @ g - self._of_images(theta, weights), sigma.T @ A @ sigma

    @cached_property
    def _pairs(self) -> tuple[IntArray, FloatArray]:
        """Which of the moments (5, n_b, n_b), which are Hermitian, a pair of pieces (n_t, n_t) takes, and its sign.

        It is the real part of (j omega)^k' of one piece times the conjugate (-j omega)^k of the other.
        """
        base, power = self.columns.pieces.base, self.columns.pieces.power
        order, apart = power + power[:, None], power - power[:, None]
        turned = np.where(base < base[:, None], -1.0, 1.0) ** order
        n_b = base.max(initial=-1) + 1
        places = (order * n_b + np.minimum(base, base[:, None])) * n_b + np.maximum(base, base[:, None])
        return places, turned * np.array([1.0, -1.0, -1.0, 1.0])[apart % 4]

    def _of_images(self, theta: FloatArray, weights: Sequence[ComplexArray]) -> FloatArray:
        """Re sum weight dG / dtheta (P,) of images of held torques; weights (F, n_e) of each block of lines."""
        if self.columns.kernel.model.hold is None or not weights:
            return np.zeros(len(self.columns.kernel.wanted))
        return self.columns.pull_images(theta, np.concatenate(weights))
