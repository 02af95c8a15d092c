r"""A load that the robot's file lacks: a point mass at the place of a body that lowers V most.

.. math:: \delta m = \mu, \quad \delta c = \frac{\mu}{m} \rho, \quad
          \delta I = \mu\, (\rho^T \rho\, 1 - \rho \rho^T), \quad
          (\mu, \rho) = \arg\min\; 2 g^T \delta + \delta^T S\, \delta + \text{priors}

rho: from the body's centre of mass to the load; g, S: of the score test.  The inertia about the body's origin then
changes as a point mass changes it, of any size: M is affine in m, m c and that inertia.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.diagnosis.score_test import Candidate, HeldNumber, ScoreTest

MASS_KG, DISTANCE_M = 5.0, 0.3  # usual ones of a load from a body's centre
LEAST = 1e-3  # of the body's mass: nobody forgets a smaller load, and other causes look like one
STARTS = ((3.0, (0.3, 0.0, 0.0)), (3.0, (0.0, 0.3, 0.0)), (3.0, (0.0, 0.0, 0.3)), (3.0, (-0.3, 0.0, 0.0)))


@dataclass(frozen=True, eq=False)
class Load:
    """steps (n_m,): of the members, in ln p where log.  drop: of V.  information (4, 4): on mass and place."""

    mass: float
    place: FloatArray
    steps: FloatArray
    drop: float
    information: FloatArray


def find_load(test: ScoreTest, candidate: Candidate, level: float, least: float) -> Load | None:
    """The best load of a body, within the priors; None where all its numbers together lower V by less than `least`,
    or where it has no mass to speak of.
    """
    from scipy.optimize import least_squares  # slow to load, and seldom needed

    places, numbers = candidate.places, [test.numbers[i] for i in candidate.places]
    S, g = test.S[np.ix_(places, places)], test.g[places]
    mass = next((n.value for n in numbers if n.name.startswith("m_")), 0.0)
    reached = np.diag(S) > 0
    if not (mass > 0 and test.known[places].any() and reached.any()):
        return None
    scale = np.where(reached, np.sqrt(np.maximum(np.diag(S), 0.0)), math.inf)
    power, turn = np.linalg.eigh(S / np.outer(scale, scale))
    used = power > 1e-9 * power[-1]
    root = np.sqrt(power[used])
    L = (root * turn[:, used]).T * np.where(reached, scale, 0.0)
    target = (turn[:, used].T @ (g / scale)) / root
    if float(target @ target) < least:
        return None
    priors = math.sqrt(level) / np.array([2 * MASS_KG, *3 * [2 * DISTANCE_M]])

    A = _of_moments(numbers)
    LA = L @ A

    def residual(p: FloatArray) -> FloatArray:
        return np.concatenate([LA @ _moments(p) + target, priors * p])

    def slopes(p: FloatArray) -> FloatArray:
        return np.concatenate([LA @ _slopes_of_moments(p), np.diag(priors)])

    bounds, scales = ([-0.9 * mass, -3, -3, -3], [np.inf, 3, 3, 3]), [1.0, 0.1, 0.1, 0.1]
    ends = [least_squares(residual, [mu, *rho], slopes, bounds=bounds, x_scale=scales) for mu, rho in STARTS]
    p = min(ends, key=lambda end: float(end.cost)).x
    if abs(p[0]) < LEAST * mass:
        return None
    change, J = A @ _moments(p), A @ _slopes_of_moments(p)
    drop = float(-change @ (2 * g + S @ change))
    return Load(float(p[0]), p[1:], steps_of(numbers, p), max(drop, 0.0), J.T @ S @ J)


# Second moments in the order of `_moments`.
_PAIRS = (("x", "x"), ("y", "y"), ("z", "z"), ("x", "y"), ("x", "z"), ("y", "z"))


def _moments(p: FloatArray) -> FloatArray:
    """mu times 1, rho and its products in pairs (10,), of mu, rho (4,)."""
    mu, x, y, z = p
    return np.asarray(mu * np.array([1.0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z]))


def _slopes_of_moments(p: FloatArray) -> FloatArray:
    """d moments / d (mu, rho) (10, 4)."""
    mu, x, y, z = p
    of_place = np.zeros((10, 3))
    of_place[1:4] = np.eye(3)
    of_place[4:7] = np.diag([2 * x, 2 * y, 2 * z])
    of_place[7:] = [[y, x, 0.0], [z, 0.0, x], [0.0, z, y]]
    return np.column_stack([_moments(np.array([1.0, x, y, z])), mu * of_place])


def _of_moments(numbers: list[HeldNumber]) -> FloatArray:
    """delta (n_m, 10), relative where log, by the moments of a load."""
    mass = numbers[0].value
    own: dict[str, dict[int, float]] = {"m": {0: 1.0}} | {f"c{axis}": {1 + i: 1 / mass} for i, axis in enumerate("xyz")}
    own["I"] = {4: 1.0, 5: 1.0, 6: 1.0}  # of a single number, as in a plane
    for i, axis in enumerate("xyz"):
        own[f"I{axis}{axis}"] = {4 + j: 1.0 for j in range(3) if j != i}
    own |= {f"I{a}{b}": {4 + k: -1.0} for k, (a, b) in enumerate(_PAIRS) if a != b}
    own |= {f"I{b}{a}": {4 + k: -1.0} for k, (a, b) in enumerate(_PAIRS) if a != b}
    A = np.zeros((len(numbers), 10))
    for row, number in zip(A, numbers, strict=True):
        for place, factor in own.get(_key(number.name), {}).items():
            row[place] = factor / number.value if number.log else factor
    return A


def steps_of(numbers: list[HeldNumber], p: FloatArray) -> FloatArray:
    """The changes of the numbers themselves, in ln p where log: the centre is that of both masses."""
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
