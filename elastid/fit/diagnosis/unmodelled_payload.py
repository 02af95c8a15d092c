r"""Unmodelled payload: the point mass on a body that reduces the cost V most.

.. math:: \delta m = \mu, \quad \delta c = \frac{\mu}{m} \rho, \quad
          \delta I = \mu\, (\rho^T \rho\, 1 - \rho \rho^T), \quad
          (\mu, \rho) = \arg\min\; 2 g^T \delta + \delta^T S\, \delta + \text{priors}

rho: vector from the centre of mass of the body to the payload; g, S: gradient and information of the score test.  The
result is exact for any mass, because M is affine in m, m c and the inertia about the origin of the body.
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

STARTS = [(3.0, DISTANCE_M * axis) for axis in (*np.eye(3), np.array([-1.0, 0.0, 0.0]))]


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
    from scipy.optimize import least_squares  # slow to load, and seldom needed

    priors = math.sqrt(variance) / np.array([2 * MASS_KG, *3 * [2 * DISTANCE_M]])

    A = _parameter_changes(numbers)
    LA = L @ A

    def residual(p: FloatArray) -> FloatArray:
        return np.concatenate([LA @ _moments(p) + target, priors * p])

    bounds, scales = ([-0.9 * mass, -3, -3, -3], [np.inf, 3, 3, 3]), [1.0, 0.1, 0.1, 0.1]
    ends = [least_squares(residual, [mu, *rho], bounds=bounds, x_scale=scales) for mu, rho in STARTS]
    best = min(ends, key=lambda end: float(end.cost))
    p, J = best.x, best.jac[: len(target)]
    if abs(p[0]) < MIN_MASS_FRACTION * mass:
        return None
    change = A @ _moments(p)
    return Load(float(p[0]), p[1:], load_steps(numbers, p), max(float(-change @ (2 * g + S @ change)), 0.0), J.T @ J)


def _moments(p: FloatArray) -> FloatArray:
    """Return the moments mu (1, x, y, z, xx, yy, zz, xy, xz, yz) (10,) of p = (mu, rho) (4,)."""
    mu, x, y, z = p
    return np.asarray(mu * np.array([1.0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z]))


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
    changes, new_fraction = _parameter_changes(numbers) @ _moments(p), mass / (mass + p[0])
    changes = changes * np.where([n.name.startswith(("c_", "I_")) for n in numbers], new_fraction, 1.0)
    log = np.array([n.log for n in numbers])
    return np.where(log, np.log1p(np.where(log, np.maximum(changes, -0.99), 0.0)), changes)
