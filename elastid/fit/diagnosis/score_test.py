r"""Score test (Rao) of numbers that a fit held: the drop of V by one Gauss-Newton step that frees them.

With the residuals r and their derivatives J to what is free and J_h to what was held, all at the optimum,

.. math:: g = J_h^T r - J_h^T J H^{-1} J^T r, \quad S = J_h^T J_h - J_h^T J H^{-1} J^T J_h, \quad
          H = J^T J + \text{priors}

.. math:: \text{step} = -S^{-1} g, \qquad \text{drop of } V = g^T S^{-1} g, \qquad
          \text{effects on } x = -H^{-1} J^T J_h \, \text{step}

for one number, or some of them together, along given directions. (Rao 1948; in structural equation models the
modification index of Soerbom 1989.) Under the noise alone a drop is chi-squared, times V / dof.

A load that the robot's file lacks: a point mass at the place of a body that lowers V most.

.. math:: \delta m = \mu, \quad \delta c = \frac{\mu}{m} \rho, \quad
          \delta I = \mu\, (\rho^T \rho\, 1 - \rho \rho^T), \quad
          (\mu, \rho) = \arg\min\; 2 g^T \delta + \delta^T S\, \delta + \text{priors}

rho: from the body's centre of mass to the load; g, S: of the score test.  The inertia about the body's origin then
changes as a point mass changes it, of any size: M is affine in m, m c and that inertia.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray, quotient
from elastid.robot.body import TENSOR_LETTERS


@dataclass(frozen=True)
class FixedNumber:
    """A number that the fit held.  value: SI, in unit.  log: steps are of ln p.

    lower, upper: of a plausible step.  usual: how far such a number is commonly off, of the step's unit.
    is_nuisance: it moves within the tolerance of the robot's file, and is off by more.  is_stated: of `Hypothesis`.
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
    """Numbers that are freed together: their places among all, and the directions (n_m, n_d) in which they may go."""

    name: str
    family: str
    places: IntArray
    directions: FloatArray


@dataclass(frozen=True, eq=False)
class ScoreTest:
    """S (n_h, n_h) and g (n_h,) of all numbers, response (n_x, n_h): -H^-1 J^T J_h.

    known (n_h,): numbers with an effect that the free parameters do not have, too.
    """

    numbers: tuple[FixedNumber, ...]
    S: FloatArray
    g: FloatArray
    response: FloatArray
    known: BoolArray

    @classmethod
    def of(cls, numbers: Sequence[FixedNumber], A: FloatArray, b: FloatArray, free: BoolArray) -> ScoreTest:
        """A = [J J_h]^T [J J_h] with priors and b = [J J_h]^T r; free (n_x,): parameters that may follow."""
        n_x, places = len(free), np.flatnonzero(free)
        size = np.sqrt(np.diag(A))
        size[size == 0] = 1.0
        A, b = A / np.outer(size, size), b / size
        cross = A[places, n_x:]
        follow = -np.linalg.pinv(A[np.ix_(places, places)], rcond=1e-13, hermitian=True) @ cross
        S, g = A[n_x:, n_x:] + cross.T @ follow, b[n_x:] + follow.T @ b[places]
        # The free parameters leave at least this share of the information on a number that is known.
        known = np.diag(S) > 1e-7 * np.maximum(np.diag(A)[n_x:], 1e-300)
        scale = size[n_x:]
        response = np.zeros((n_x, len(numbers)))
        response[places] = follow * scale / size[places, None]
        return cls(tuple(numbers), S * np.outer(scale, scale), g * scale, response, known)

    def step(self, candidate: Candidate) -> tuple[FloatArray, float]:
        """Return steps (n_m,) of a candidate, limited to plausible sizes, and the decrease of V; 0 without information.

        Several numbers have a prior of the width of what is plausible, which decides where the data do not.
        """
        D, places = candidate.directions, candidate.places
        S, g = self.along(candidate)
        if not self.known[places].any() or (len(g) == 1 and S[0, 0] <= 0):
            return np.zeros(len(D)), 0.0
        along = places[np.argmax(D != 0, axis=0)]  # the first number of each direction
        steps = D[:, 0] * (-g[0] / S[0, 0]) if len(g) == 1 else D @ self._bounded(along, S, g)
        steps = steps * self._plausible(candidate, steps)
        drop = -steps @ (2 * self.g[places] + self.S[np.ix_(places, places)] @ steps)
        return steps, max(float(drop), 0.0)

    def most(self, candidate: Candidate) -> float:
        """The drop of V by the best step of a candidate, plausible or not."""
        S, g = self.along(candidate)
        return float(g @ np.linalg.pinv(S, hermitian=True) @ g)

    def std(self, candidate: Candidate) -> float:
        """The standard deviation of the first number's step, for residuals of unit variance."""
        S, D = self.along(candidate)[0], candidate.directions
        return float(np.sqrt(max(D[0] @ np.linalg.pinv(S, hermitian=True) @ D[0], 0.0)))

    def correlations(self, candidates: Sequence[Candidate]) -> FloatArray:
        """Squared correlations (n_c, n_c) of effects that free parameters leave; 0 of several directions."""
        D = np.zeros((len(self.numbers), len(candidates)))
        for i, candidate in enumerate(candidates):
            if candidate.directions.shape[1] == 1 and self.known[candidate.places].any():
                D[candidate.places, i] = candidate.directions[:, 0]
        products = D.T @ self.S @ D
        size = np.diag(products)
        both = np.outer(size, size)
        return quotient(products**2, both)

    def effects(self, candidate: Candidate, steps: FloatArray) -> FloatArray:
        """Change (n_x,) of the free parameters that the steps (n_m,) of a candidate imply."""
        return self.response[:, candidate.places] @ steps

    def freed(self, candidate: Candidate) -> ScoreTest:
        """The test of all numbers with a candidate at its step and free."""
        D, places = candidate.directions, candidate.places
        columns = self.S[:, places] @ D
        back = columns @ np.linalg.pinv(self.along(candidate)[0], hermitian=True)
        g = self.g + self.S[:, places] @ self.step(candidate)[0]
        S = self.S - back @ columns.T
        known = self.known & (np.diag(S) > 1e-6 * np.diag(self.S))
        response = self.response - self.response[:, places] @ D @ back.T
        return replace(self, S=S, g=g - back @ (D.T @ g[places]), response=response, known=known)

    def _bounded(self, places: IntArray, S: FloatArray, g: FloatArray) -> FloatArray:
        """The step along several directions (n_d,) within the limits of the number of each, which are priors, too."""
        limits = np.array([(self.numbers[i].lower, self.numbers[i].upper) for i in places]).T
        width = np.maximum(np.abs(limits).min(axis=0), 1e-3)  # some, where a number can only grow
        size = np.sqrt(np.maximum(np.diag(S), 0.0) + width**-2)
        # Rounding in S can exceed the priors of wide numbers: no Cholesky factor then exists.
        power, directions = np.linalg.eigh((S + np.diag(width**-2)) / np.outer(size, size))
        L = directions * np.sqrt(np.maximum(power, 1e-13 * power[-1]))
        target = -np.linalg.solve(L, g / size)
        step = np.linalg.solve(L.T, target) / size
        if np.all((limits[0] <= step) & (step <= limits[1])):
            return np.asarray(step)
        from scipy.optimize import lsq_linear  # slow to load, and seldom needed

        return np.asarray(lsq_linear(L.T, target, limits * size).x / size)

    def along(self, candidate: Candidate) -> tuple[FloatArray, FloatArray]:
        """S (n_d, n_d) and g (n_d,) along the directions of a candidate."""
        D, places = candidate.directions, candidate.places
        return D.T @ self.S[np.ix_(places, places)] @ D, D.T @ self.g[places]

    def _plausible(self, candidate: Candidate, steps: FloatArray) -> float:
        """The part of the steps that stays within all limits, at most 1."""
        pairs = [(step, self.numbers[i]) for step, i in zip(steps, candidate.places, strict=True) if step != 0]
        parts = ((number.upper if step > 0 else -number.lower) / abs(step) for step, number in pairs)
        return float(max(min([1.0, *parts]), 0.0))


def free_drop(A: FloatArray, b: FloatArray, free: BoolArray) -> float:
    """The drop of V by the step of the free parameters (n_x,) with all others held; 0 at an optimum."""
    places = np.flatnonzero(free)
    size = np.sqrt(np.maximum(np.diag(A)[places], 1e-300))
    g = b[places] / size
    return float(g @ np.linalg.pinv(A[np.ix_(places, places)] / np.outer(size, size), rcond=1e-13, hermitian=True) @ g)


MASS_KG, DISTANCE_M = 5.0, 0.3  # usual ones of a load from a body's centre
LEAST = 1e-3  # of the body's mass: nobody forgets a smaller load, and other causes look like one
STARTS = [(3.0, DISTANCE_M * axis) for axis in (*np.eye(3), np.array([-1.0, 0.0, 0.0]))]


@dataclass(frozen=True, eq=False)
class Load:
    """Load with steps (n_m,) of its members (ln p if log), decrease of V, and information (4, 4) on mass and place."""

    mass: float
    place: FloatArray
    steps: FloatArray
    drop: float
    information: FloatArray


def find_load(test: ScoreTest, candidate: Candidate, level: float, least: float) -> Load | None:
    """Return the best load of a body within the priors; None if V decreases by less than `least` or it has no mass."""
    places, numbers = candidate.places, [test.numbers[i] for i in candidate.places]
    S, g = test.S[np.ix_(places, places)], test.g[places]
    mass = next((n.value for n in numbers if n.name.startswith("m_")), 0.0)
    reached = np.diag(S) > 0
    if not (mass > 0 and test.known[places].any() and reached.any()):
        return None
    scale = np.sqrt(np.where(reached, np.diag(S), math.inf))
    power, turn = np.linalg.eigh(S / np.outer(scale, scale))
    used = power > 1e-9 * power[-1]
    root = np.sqrt(power[used])
    L = (root * turn[:, used]).T * np.where(reached, scale, 0.0)
    target = (turn[:, used].T @ (g / scale)) / root
    if float(target @ target) < least:
        return None
    from scipy.optimize import least_squares  # slow to load, and seldom needed

    priors = math.sqrt(level) / np.array([2 * MASS_KG, *3 * [2 * DISTANCE_M]])

    A = _of_moments(numbers)
    LA = L @ A

    def residual(p: FloatArray) -> FloatArray:
        return np.concatenate([LA @ _moments(p) + target, priors * p])

    bounds, scales = ([-0.9 * mass, -3, -3, -3], [np.inf, 3, 3, 3]), [1.0, 0.1, 0.1, 0.1]
    ends = [least_squares(residual, [mu, *rho], bounds=bounds, x_scale=scales) for mu, rho in STARTS]
    best = min(ends, key=lambda end: float(end.cost))
    p, J = best.x, best.jac[: len(target)]
    if abs(p[0]) < LEAST * mass:
        return None
    change = A @ _moments(p)
    drop = float(-change @ (2 * g + S @ change))
    return Load(float(p[0]), p[1:], steps_of(numbers, p), max(drop, 0.0), J.T @ J)


def _moments(p: FloatArray) -> FloatArray:
    """mu times 1, rho and its products in pairs (10,), of mu, rho (4,)."""
    mu, x, y, z = p
    return np.asarray(mu * np.array([1.0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z]))


def _of_moments(numbers: list[FixedNumber]) -> FloatArray:
    """delta (n_m, 10), relative where log, by the moments of a load."""
    mass = numbers[0].value
    J: dict[str, dict[int, float]] = {"m": {0: 1.0}} | {f"c{axis}": {1 + i: 1 / mass} for i, axis in enumerate("xyz")}
    J["I"] = {4: 1.0, 5: 1.0, 6: 1.0}  # of a single number, as in a plane
    for i, axis in enumerate("xyz"):
        J[f"I{axis}{axis}"] = {4 + j: 1.0 for j in range(3) if j != i}
    for k, pair in enumerate(TENSOR_LETTERS[3:], start=7):
        J[f"I{pair}"] = J[f"I{pair[::-1]}"] = {k: -1.0}
    A = np.zeros((len(numbers), 10))
    for row, number in zip(A, numbers, strict=True):
        for place, factor in J.get(_key(number.name), {}).items():
            row[place] = factor / number.value if number.log else factor
    return A


def steps_of(numbers: list[FixedNumber], p: FloatArray) -> FloatArray:
    """Return the changes of mass, common centre and inertia, as ln p if log."""
    mass = numbers[0].value
    changes, both = _of_moments(numbers) @ _moments(p), mass / (mass + p[0])
    inertial = np.where([n.name.startswith(("c_", "I_")) for n in numbers], both, 1.0)
    changes = changes * inertial
    log = np.array([n.log for n in numbers])
    return np.where(log, np.log1p(np.where(log, np.maximum(changes, -0.99), 0.0)), changes)


def _key(name: str) -> str:
    """m, cx, Ixy, I of m_fore, c_fore_x@c1, I_fore_xy, I_fore."""
    parts = name.partition("@")[0].split("_")
    is_entry = len(parts) > 2 and parts[-1] in {"x", "y", "z", *(a + b for a in "xyz" for b in "xyz")}
    return parts[0] + parts[-1] if is_entry else parts[0]
