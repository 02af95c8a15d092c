r"""How far configurations disagree: the estimate without each of them in turn, the jackknife.

.. math:: x_{(i)} - x = (A - A_i)^{-1} g_i, \qquad
          \mathrm{var}\, x = t^2 \frac{Q - 1}{Q} \sum_i (x_{(i)} - \bar x)^2, \qquad A_i = J_i^T J_i,\; g_i = J_i^T r_i

An error of the model that parameters absorb leaves no trace in the residuals of one configuration, but is absorbed by
other values in each. t >= 1 widens for the few configurations that the scatter is taken from: the 97.5 % point of
Student's distribution of Q - 1 degrees of freedom over that of the normal one.
(Efron & Stein 1981, The jackknife estimate of variance; t as for clusters, Cameron & Miller 2015, section VI.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri, stdtrit

from elastid.base.arrays import FloatArray
from elastid.fit.uncertainty.line_sums import Evidence

# Fewer configurations say nothing about their scatter.
FEWEST = 3
# Standard deviations by which V exceeds what noise explains, from where the model is taken to be in error.
EVIDENT = 3.0
# Directions that only the one left out informs: their share of the largest eigenvalue of the scaled information.
ALONE = 1e-10


def is_in_error(cost: float, expected_cost: float, dof: int) -> bool:
    """Whether V is more than the noise explains."""
    return cost > expected_cost * (1 + EVIDENT * math.sqrt(2 / max(dof, 1)))


def between_configurations(parts: Sequence[Evidence], A: FloatArray) -> FloatArray:
    """Variances (n_x,) of x, zero for fewer than three configurations; A (n_x, n_x): J^T J of all, priors included."""
    Q = len(parts)
    if Q < FEWEST:
        return np.zeros(len(A))
    length = np.sqrt(np.diag(A))
    length[length == 0] = 1.0
    moved = np.array([_moved_without(part, A, length) for part in parts])
    t = float(stdtrit(Q - 1, 0.975) / ndtri(0.975))
    variance: FloatArray = t**2 * (Q - 1) / Q * np.sum((moved - moved.mean(axis=0)) ** 2, axis=0)
    return variance


def _moved_without(part: Evidence, A: FloatArray, length: FloatArray) -> FloatArray:
    """By how much x (n_x,) moves without a configuration, where the others say anything."""
    rest = (A - part.rows.T @ part.rows) / np.outer(length, length)
    values, vectors = np.linalg.eigh(rest)
    known = values > ALONE * max(values[-1], 1e-300)
    pull = part.pull.sum(axis=1) / length
    step = vectors[:, known] @ ((vectors[:, known].T @ pull) / values[known])
    moved: FloatArray = step / length
    return moved
