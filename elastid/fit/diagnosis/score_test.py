r"""Score test (Rao) of the fixed numbers of a fit: decrease of V by one Gauss-Newton step with these numbers free.

With the residuals r and their derivatives J to free and J_h to fixed numbers, all at the optimum,

.. math:: g = J_h^T r - J_h^T J H^{-1} J^T r, \quad S = J_h^T J_h - J_h^T J H^{-1} J^T J_h, \quad
          H = J^T J + \text{priors}

.. math:: \text{step} = -S^{-1} g, \qquad \text{drop of } V = g^T S^{-1} g, \qquad
          \text{effects on } x = -H^{-1} J^T J_h \, \text{step}

for one number or several along given directions. (Rao 1948; modification index of Soerbom 1989 in structural equation
models.) Under the noise alone the drop divided by V / dof has a chi-square distribution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray, quotient


@dataclass(frozen=True)
class FixedNumber:
    """Fixed number p of the fit.  value: in SI.  log: steps are changes of ln p.

    lower, upper: limits of a plausible step.  usual: typical error, as a step.  is_nuisance: True for the prior mean of
    a nuisance parameter, outside its tolerance.  is_stated: as in `Hypothesis`.
    """

    name: str
    family: str
    value: float
    unit: str
    log: bool
    lower: float
    upper: float
    usual: float
    is_nuisance: bool = False
    is_stated: bool = True


@dataclass(frozen=True, eq=False)
class Candidate:
    """Numbers that are freed together.  indices (n_m,): among all numbers.  directions (n_m, n_d): of their steps."""

    name: str
    family: str
    indices: IntArray
    directions: FloatArray


@dataclass(frozen=True, eq=False)
class ScoreTest:
    """S (n_h, n_h) and g (n_h,) of all fixed numbers, response (n_x, n_h) = -H^-1 J^T J_h of the free parameters.

    is_distinct (n_h,): True for numbers whose effect the free parameters cannot reproduce.
    """

    numbers: tuple[FixedNumber, ...]
    S: FloatArray
    g: FloatArray
    response: FloatArray
    is_distinct: BoolArray

    @classmethod
    def of(cls, numbers: Sequence[FixedNumber], A: FloatArray, b: FloatArray, free: BoolArray) -> ScoreTest:
        """Build the test from A = [J J_h]^T [J J_h] with priors and b = [J J_h]^T r.  free (n_x,): not at a bound."""
        n_x, indices = len(free), np.flatnonzero(free)
        size = np.sqrt(np.diag(A))
        size[size == 0] = 1.0
        A, b = A / np.outer(size, size), b / size
        cross = A[indices, n_x:]
        follow = -np.linalg.pinv(A[np.ix_(indices, indices)], rcond=1e-13, hermitian=True) @ cross
        S, g = A[n_x:, n_x:] + cross.T @ follow, b[n_x:] + follow.T @ b[indices]
        # Least fraction of the information on a distinct number that remains with free parameters.
        identifiable = np.diag(S) > 1e-7 * np.maximum(np.diag(A)[n_x:], 1e-300)
        scale = size[n_x:]
        response = np.zeros((n_x, len(numbers)))
        response[indices] = follow * scale / size[indices, None]
        return cls(tuple(numbers), S * np.outer(scale, scale), g * scale, response, identifiable)

    def step(self, candidate: Candidate) -> tuple[FloatArray, float]:
        """Return steps (n_m,) of a candidate, limited to plausible sizes, and the decrease of V; 0 without information.

        Several numbers have a prior of the width of their limits, for directions without information.
        """
        D, locations = candidate.directions, candidate.indices
        S, g = self.along(candidate)
        if not self.is_distinct[locations].any() or (len(g) == 1 and S[0, 0] <= 0):
            return np.zeros(len(D)), 0.0
        along = locations[np.argmax(D != 0, axis=0)]  # the first number of each direction
        steps = D[:, 0] * (-g[0] / S[0, 0]) if len(g) == 1 else D @ self._bounded(along, S, g)
        # Scale the steps so that all stay within their limits.
        pairs = [(step, self.numbers[i]) for step, i in zip(steps, locations, strict=True) if step != 0]
        factors = ((number.upper if step > 0 else -number.lower) / abs(step) for step, number in pairs)
        steps = steps * max(min([1.0, *factors]), 0.0)
        return steps, max(float(-steps @ (2 * self.g[locations] + self.S[np.ix_(locations, locations)] @ steps)), 0.0)

    def max_drop(self, candidate: Candidate) -> float:
        """Return the drop of V by the best step of a candidate, plausible or not."""
        S, g = self.along(candidate)
        return float(g @ np.linalg.pinv(S, hermitian=True) @ g)

    def std(self, candidate: Candidate) -> float:
        """Return the standard deviation of the first number's step, for residuals of unit variance."""
        S, D = self.along(candidate)[0], candidate.directions
        return float(np.sqrt(max(D[0] @ np.linalg.pinv(S, hermitian=True) @ D[0], 0.0)))

    def correlations(self, candidates: Sequence[Candidate]) -> FloatArray:
        """Return squared correlations (n_c, n_c) of the candidates' effects; 0 for several directions."""
        D = np.zeros((len(self.numbers), len(candidates)))
        for i, candidate in enumerate(candidates):
            if candidate.directions.shape[1] == 1 and self.is_distinct[candidate.indices].any():
                D[candidate.indices, i] = candidate.directions[:, 0]
        products = D.T @ self.S @ D
        size = np.diag(products)
        return quotient(products**2, np.outer(size, size))

    def effects(self, candidate: Candidate, steps: FloatArray) -> FloatArray:
        """Return the change (n_x,) of the free parameters that the steps (n_m,) of a candidate imply."""
        return self.response[:, candidate.indices] @ steps

    def freed(self, candidate: Candidate) -> ScoreTest:
        """Return the test of all numbers with a candidate at its step and free."""
        D, locations = candidate.directions, candidate.indices
        columns = self.S[:, locations] @ D
        back = columns @ np.linalg.pinv(self.along(candidate)[0], hermitian=True)
        g = self.g + self.S[:, locations] @ self.step(candidate)[0]
        S = self.S - back @ columns.T
        identifiable = self.is_distinct & (np.diag(S) > 1e-6 * np.diag(self.S))
        response = self.response - self.response[:, locations] @ D @ back.T
        return replace(self, S=S, g=g - back @ (D.T @ g[locations]), response=response, is_distinct=identifiable)

    def _bounded(self, indices: IntArray, S: FloatArray, g: FloatArray) -> FloatArray:
        """Return the step along several directions (n_d,) within limits, with priors of the width of the limits."""
        limits = np.array([(self.numbers[i].lower, self.numbers[i].upper) for i in indices]).T
        width = np.maximum(np.abs(limits).min(axis=0), 1e-3)  # not 0 for a number that can only grow
        size = np.sqrt(np.maximum(np.diag(S), 0.0) + width**-2)
        # Not by Cholesky: rounding errors of S can exceed weak priors.
        power, directions = np.linalg.eigh((S + np.diag(width**-2)) / np.outer(size, size))
        L = directions * np.sqrt(np.maximum(power, 1e-13 * power[-1]))
        target = -np.linalg.solve(L, g / size)
        step = np.linalg.solve(L.T, target) / size
        if np.all((limits[0] <= step) & (step <= limits[1])):
            return np.asarray(step)
        from scipy.optimize import lsq_linear  # slow to load, and seldom needed

        return np.asarray(lsq_linear(L.T, target, limits * size).x / size)

    def along(self, candidate: Candidate) -> tuple[FloatArray, FloatArray]:
        """Return S (n_d, n_d) and g (n_d,) along the directions of a candidate."""
        D, locations = candidate.directions, candidate.indices
        return D.T @ self.S[np.ix_(locations, locations)] @ D, D.T @ self.g[locations]


def free_drop(A: FloatArray, b: FloatArray, free: BoolArray) -> float:
    """Return the drop of V by the step of the free parameters (n_x,) with all others fixed; 0 at an optimum."""
    places = np.flatnonzero(free)
    size = np.sqrt(np.maximum(np.diag(A)[places], 1e-300))
    g = b[places] / size
    return float(g @ np.linalg.pinv(A[np.ix_(places, places)] / np.outer(size, size), rcond=1e-13, hermitian=True) @ g)
