r"""Variance of the estimate by its scatter: over configurations (jackknife), and over blocks of lines.

.. math:: x_{(i)} - x = (A - A_i)^{-1} g_i, \qquad
          \mathrm{var}\, x = t^2 \frac{Q - 1}{Q} \sum_i (x_{(i)} - \bar x)^2, \qquad A_i = J_i^T J_i,\; g_i = J_i^T r_i

with configuration i left out, and with g_b the pull of the lines of a block of a configuration and a band, S_b its
covariance under the measured noise, n the sum of the ranks of S_b:

.. math:: \mathrm{var}\, x_i = t^2 \frac{B}{B - 1} \sum_b (A^{-1} g_b)_i^2, \qquad
          T = \frac{1}{n - n_x} \sum_b g_b^T S_b^{+} g_b

A model error that parameters absorb does not show in the residuals of one configuration, but it is absorbed by
different values in each. T is 1 where the model is true, since noise alone then parts the blocks.  t >= 1 accounts for
few configurations or blocks: the 97.5 % point of Student's distribution over that of the normal one.
(Efron & Stein 1981, The jackknife estimate of variance; White 1980, Econometrica 48; blocks as clusters, and t, Cameron
& Miller 2015, section VI; T as Cochran 1954, Biometrics 10.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.statistics import small_sample_factor
from elastid.fit.uncertainty.line_sums import Blocks, LineSums

# With fewer configurations the scatter is not estimated.
MIN_CONFIGURATIONS = 3
# Eigenvalues of the scaled information below this share of the largest: only the configuration left out informs them.
RANK_TOLERANCE = 1e-10
# Eigenvalues of a block's scaled covariance below this share of the largest: nothing is measured in that direction.
BLOCK_RANK_TOLERANCE = 1e-9


def jackknife_variance(parts: Sequence[LineSums], A: FloatArray) -> FloatArray:
    """Variances (n_x,) of x, zero for fewer than three configurations; A (n_x, n_x): J^T J of all, priors included."""
    Q = len(parts)
    if Q < MIN_CONFIGURATIONS:
        return np.zeros(len(A))
    length = np.sqrt(np.diag(A))
    length[length == 0] = 1.0
    moved = np.array([_moved_without(part, A, length) for part in parts])
    t = small_sample_factor(Q)
    return np.asarray(t**2 * (Q - 1) / Q * np.sum((moved - moved.mean(axis=0)) ** 2, axis=0))


def _moved_without(part: LineSums, A: FloatArray, length: FloatArray) -> FloatArray:
    """The change of x (n_x,) without a configuration, in the directions that the others determine."""
    rest = (A - part.rows.T @ part.rows) / np.outer(length, length)
    values, vectors = np.linalg.eigh(rest)
    known = values > RANK_TOLERANCE * max(values[-1], 1e-300)
    pull = part.pull.sum(axis=1) / length
    step = vectors[:, known] @ ((vectors[:, known].T @ pull) / values[known])
    return np.asarray(step / length)


def block_variance(blocks: Sequence[Blocks], A_inverse: FloatArray) -> FloatArray:
    """Variances (n_x,) of x by the scatter of the pulls of all blocks; zero for fewer than two."""
    moved = np.concatenate([block.pull for block in blocks]) @ A_inverse
    n = int(np.count_nonzero(np.any(moved != 0, axis=1)))
    if n < 2:
        return np.zeros(len(A_inverse))
    t = small_sample_factor(n)
    return np.asarray(t**2 * n / (n - 1) * np.sum(moved**2, axis=0))


def disagreement(blocks: Sequence[Blocks], A_inverse: FloatArray) -> float:
    """T of the blocks whose noise is known; NaN where that is none, or too few to disagree."""
    total, rank = 0.0, -int(np.count_nonzero(np.diag(A_inverse) > 0))
    scale = np.sqrt(np.diag(A_inverse))
    for block in blocks:
        for pull, noise in zip(block.pull, () if block.noise is None else block.noise, strict=block.noise is not None):
            values, vectors = np.linalg.eigh(noise * np.outer(scale, scale))
            known = values > BLOCK_RANK_TOLERANCE * max(float(values[-1]), 1e-300)
            total += float(np.sum((vectors[:, known].T @ (scale * pull)) ** 2 / values[known]))
            rank += int(np.count_nonzero(known))
    return total / rank if rank > 0 else math.nan
