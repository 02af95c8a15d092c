r"""Jackknife: the variance of the estimate by its scatter when each configuration is left out in turn.

.. math:: x_{(i)} - x = (A - A_i)^{-1} g_i, \qquad
          \mathrm{var}\, x = t^2 \frac{Q - 1}{Q} \sum_i (x_{(i)} - \bar x)^2, \qquad A_i = J_i^T J_i,\; g_i = J_i^T r_i

A model error that parameters absorb does not show in the residuals of one configuration, but it is absorbed by
different values in each. t >= 1 accounts for few configurations: the 97.5 % point of Student's distribution of Q - 1
degrees of freedom over that of the normal one.
(Efron & Stein 1981, The jackknife estimate of variance; t as for clusters, Cameron & Miller 2015, section VI.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri, stdtrit

from elastid.base.arrays import FloatArray
from elastid.fit.uncertainty.line_sums import LineSums

# With fewer configurations the scatter is not estimated.
MIN_CONFIGURATIONS = 3
# Eigenvalues of the scaled information below this share of the largest: only the configuration left out informs them.
RANK_TOLERANCE = 1e-10


def jackknife_variance(parts: Sequence[LineSums], A: FloatArray) -> FloatArray:
    """Variances (n_x,) of x, zero for fewer than three configurations; A (n_x, n_x): J^T J of all, priors included."""
    Q = len(parts)
    if Q < MIN_CONFIGURATIONS:
        return np.zeros(len(A))
    length = np.sqrt(np.diag(A))
    length[length == 0] = 1.0
    moved = np.array([_moved_without(part, A, length) for part in parts])
    t = float(stdtrit(Q - 1, 0.975) / ndtri(0.975))
    return np.asarray(t**2 * (Q - 1) / Q * np.sum((moved - moved.mean(axis=0)) ** 2, axis=0))


def _moved_without(part: LineSums, A: FloatArray, length: FloatArray) -> FloatArray:
    """The change of x (n_x,) without a configuration, in the directions that the others determine."""
    rest = (A - part.rows.T @ part.rows) / np.outer(length, length)
    values, vectors = np.linalg.eigh(rest)
    known = values > RANK_TOLERANCE * max(values[-1], 1e-300)
    pull = part.pull.sum(axis=1) / length
    step = vectors[:, known] @ ((vectors[:, known].T @ pull) / values[known])
    return np.asarray(step / length)
