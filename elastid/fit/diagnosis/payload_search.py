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
    """The best load of a body, within the priors; None where all its numbers together lower V by less than `least`."""
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

    def residual(p: FloatArray) -> FloatArray:
        return np.concatenate([L @ _changes(numbers, p) + target, priors * p])

    bounds = [-0.9 * mass, -3, -3, -3], [np.inf, 3, 3, 3]
    ends = [least_squares(residual, [mu, *rho], bounds=bounds, x_scale=[1.0, 0.1, 0.1, 0.1]) for mu, rho in STARTS]
    p = min(ends, key=lambda end: float(end.cost)).x
    change = _changes(numbers, p)
    step = 1e-6 * np.array([MASS_KG, *3 * [DISTANCE_M]])
    J = np.stack([(_changes(numbers, p + h) - change) / h.sum() for h in np.diag(step)], axis=1)
    drop = float(-change @ (2 * g + S @ change))
    return Load(float(p[0]), p[1:], steps_of(numbers, p), max(drop, 0.0), J.T @ S @ J)


def _changes(numbers: list[HeldNumber], p: FloatArray) -> FloatArray:
    """delta (n_m,), relative where log, of mu, rho (4,)."""
    mu, rho = p[0], p[1:]
    mass = numbers[0].value
    inertia = mu * (rho @ rho * np.eye(3) - np.outer(rho, rho))
    own = {"m": mu, **{f"c{axis}": mu / mass * rho[i] for i, axis in enumerate("xyz")}}
    own["I"] = mu * float(rho @ rho)  # of a single number, as in a plane
    own |= {f"I{a}{b}": inertia[i, j] for i, a in enumerate("xyz") for j, b in enumerate("xyz")}
    values = [own.get(_key(n.name), 0.0) for n in numbers]
    return np.array([v / n.value if n.log else v for v, n in zip(values, numbers, strict=True)])


def steps_of(numbers: list[HeldNumber], p: FloatArray) -> FloatArray:
    """The changes of the numbers themselves, in ln p where log: the centre is that of both masses."""
    mass = numbers[0].value
    changes, both = _changes(numbers, p), mass / (mass + p[0])
    inertial = np.where([n.name.startswith(("c_", "I_")) for n in numbers], both, 1.0)
    changes = changes * inertial
    log = np.array([n.log for n in numbers])
    return np.where(log, np.log1p(np.where(log, np.maximum(changes, -0.99), 0.0)), changes)


def _key(name: str) -> str:
    """m, cx, Ixy, I of m_fore, c_fore_x@c1, I_fore_xy, I_fore."""
    parts = name.partition("@")[0].split("_")
    is_entry = len(parts) > 2 and parts[-1] in {"x", "y", "z", *(a + b for a in "xyz" for b in "xyz")}
    return parts[0] + parts[-1] if is_entry else parts[0]
