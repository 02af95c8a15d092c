r"""Unmodelled payload: the point mass on a body that reduces the cost V most.

.. math:: \delta m = \mu, \quad \delta c = \frac{\mu}{m} \rho, \quad
          \delta I = \mu\, (\rho^T \rho\, 1 - \rho \rho^T), \quad
          (\mu, \rho) = \arg\min\; 2 g^T \delta + \delta^T S\, \delta + \text{priors}

rho: vector from the centre of mass of the body to the payload; g, S: gradient and information of the score test.  The
result is exact for any mass, because M is affine in m, m c and the inertia about the origin of the body. The search
varies rho alone: delta is linear in mu, whose optimum for each rho has a closed form (variable projection: Golub and
Pereyra, SIAM J. Numerical Analysis 10, 1973).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.diagnosis.score_test import Candidate, FixedNumber, ScoreTest
from elastid.robot.body import TENSOR_LETTERS

MASS_KG, DISTANCE_M = 5.0, 0.3  # typical mass of a payload and distance from the body's centre of mass
MIN_MASS_FRACTION = 1e-3  # of the body's mass, below which a payload is not considered
MIN_CHANGE, MAX_DISTANCE_M = -0.9, 3.0  # bounds of the mass relative to the body's, and of a coordinate
STARTS = DISTANCE_M * np.vstack([np.eye(3), [-1.0, 0.0, 0.0]])


@dataclass(frozen=True, eq=False)
class Load:
    """Point mass on a body: mass (kg), position (3,) from the centre of mass (m), and information (4, 4) on both.

    steps (n_m,): changes of mass, centre and inertia of the body (of ln p if log).  drop: decrease of V.
    """

    mass: float
    position: FloatArray
    steps: FloatArray
    drop: float
    information: FloatArray


def find_load(test: ScoreTest, candidate: Candidate, variance: float, min_drop: float) -> Load | None:
    """Return the best load of a body within the priors; None if V falls by less than `min_drop` or it has no mass."""
    locations, numbers = candidate.indices, [test.numbers[i] for i in candidate.indices]
    S, g = test.S[np.ix_(locations, locations)], test.g[locations]
    mass = next((n.value for n in numbers if n.name.startswith("m_")), 0.0)
    is_reached = np.diag(S) > 0
    if not (mass > 0 and test.is_distinct[locations].any() and is_reached.any()):
        return None
    scale = np.sqrt(np.where(is_reached, np.diag(S), math.inf))
    power, turn = np.linalg.eigh(S / np.outer(scale, scale))
    is_significant = power > 1e-9 * power[-1]
    root = np.sqrt(power[is_significant])
    L = (root * turn[:, is_significant]).T * np.where(is_reached, scale, 0.0)
    target = (turn[:, is_significant].T @ (g / scale)) / root
    if float(target @ target) < min_drop:
        return None
    priors, A = math.sqrt(variance) / np.array([2 * MASS_KG, *3 * [2 * DISTANCE_M]]), _parameter_changes(numbers)
    mu, rho, J = _search(L @ A, target, priors, MIN_CHANGE * mass)
    if abs(mu) < MIN_MASS_FRACTION * mass:
        return None
    change = mu * A @ _moments(rho)
    drop = max(float(-change @ (2 * g + S @ change)), 0.0)
    return Load(mu, rho, load_steps(numbers, np.append(mu, rho)), drop, J.T @ J)


def _search(
    A: FloatArray, target: FloatArray, priors: FloatArray, min_mass: float
) -> tuple[float, FloatArray, FloatArray]:  # fmt: skip
    """Return the mu of at least `min_mass` and rho (3,) of least |mu A m(rho) + target|^2 + |priors (mu, rho)|^2.

    m: `_moments`.  Return also the derivatives (n, 4) of the first residuals to (mu, rho).
    """
    from scipy.optimize import least_squares  # slow to load, and seldom needed

    def project(rho: FloatArray) -> tuple[float, FloatArray, FloatArray, FloatArray]:
        """Return mu, its derivative (3,) to rho, and the residuals of 1 kg with their derivatives to rho."""
        a, da = A @ _moments(rho), A @ _moment_slopes(rho)
        norm = float(a @ a) + priors[0] ** 2
        mu = -float(a @ target) / norm
        if mu < min_mass:
            return min_mass, np.zeros(3), a, da
        return mu, -(target @ da + 2 * mu * (a @ da)) / norm, a, da

    def residual(rho: FloatArray) -> FloatArray:
        mu, _, a, _ = project(rho)
        return np.concatenate([mu * a + target, priors * [mu, *rho]])

    def jacobian(rho: FloatArray) -> FloatArray:
        mu, slope, a, da = project(rho)
        return np.vstack([mu * da + np.outer(a, slope), priors[0] * slope, np.diag(priors[1:])])

    limits = -MAX_DISTANCE_M, MAX_DISTANCE_M
    ends = (least_squares(residual, rho, jacobian, limits, x_scale=0.1, ftol=1e-6) for rho in STARTS)
    rho = min(ends, key=lambda end: end.cost).x
    mu, _, a, da = project(rho)
    return mu, rho, np.column_stack([a, mu * da])


def _moments(rho: FloatArray) -> FloatArray:
    """Return the moments (1, x, y, z, xx, yy, zz, xy, xz, yz) (10,) of 1 kg at rho = (x, y, z)."""
    x, y, z = rho
    return np.array([1.0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z])


def _moment_slopes(rho: FloatArray) -> FloatArray:
    """Return the derivatives (10, 3) of the moments to rho."""
    x, y, z = rho
    return np.vstack([np.zeros(3), np.eye(3), 2 * np.diag(rho), [y, x, 0.0], [z, 0.0, x], [0.0, z, y]])


def _parameter_changes(numbers: list[FixedNumber]) -> FloatArray:
    """Return the derivatives (n_m, 10) of the body's numbers, relative if log, to the moments of a load."""
    mass, body = numbers[0].value, numbers[0].name.partition("@")[0].removeprefix("m_")
    J = {"m": {0: 1.0}} | {f"c{axis}": {1 + i: 1 / mass} for i, axis in enumerate("xyz")}
    J["I"] = {4: 1.0, 5: 1.0, 6: 1.0}  # scalar inertia of a planar body
    for i, axis in enumerate("xyz"):
        J[f"I{axis}{axis}"] = {4 + j: 1.0 for j in range(3) if j != i}
    for k, pair in enumerate(TENSOR_LETTERS[3:], start=7):
        J[f"I{pair}"] = J[f"I{pair[::-1]}"] = {k: -1.0}
    A = np.zeros((len(numbers), 10))
    for row, number in zip(A, numbers, strict=True):
        # m_fore, c_fore_x@c1, I_fore_xy, I_fore of the body fore -> m, cx, Ixy, I
        letter, _, entry = number.name.partition("@")[0].partition("_")
        for entry_index, factor in J.get(letter + entry.removeprefix(body).removeprefix("_"), {}).items():
            row[entry_index] = factor / number.value if number.log else factor
    return A


def load_steps(numbers: list[FixedNumber], p: FloatArray) -> FloatArray:
    """Return the changes (n_m,) of mass, common centre and inertia by a load p (4,), of ln p if log."""
    mass = numbers[0].value
    changes, new_fraction = p[0] * _parameter_changes(numbers) @ _moments(p[1:]), mass / (mass + p[0])
    changes = changes * np.where([n.name.startswith(("c_", "I_")) for n in numbers], new_fraction, 1.0)
    log = np.array([n.log for n in numbers])
    return np.where(log, np.log1p(np.where(log, np.maximum(changes, -0.99), 0.0)), changes)
