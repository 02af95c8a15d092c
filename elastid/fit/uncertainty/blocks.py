r"""Blocks of a configuration and a band: the variance of the estimate where the model is wrong, and whether they agree.

.. math:: \mathrm{var}\, x_i = t^2 \frac{B}{B - 1} \sum_b (A^{-1} g_b)_i^2, \qquad
          T = \frac{1}{n - n_x} \sum_b g_b^T S_b^{+} g_b, \qquad g_b = \sum_{k \in b} J_k^T r_k

g_b: pull of the lines of a block, S_b: its covariance under the measured noise, n: sum of the ranks of S_b. Errors of a
model are alike on neighbouring lines, so that single lines do not count as independent; blocks do, where they are
longer than the residuals are correlated. T is 1 where the model is true, since noise alone then parts the blocks.

Bands: as many of equal numbers of lines as are twice as long as the correlation length tau of the configuration's
residuals (`correlation_length`), at least 4 and at most 24. t >= 1 accounts for few blocks, as in `jackknife`.
(White 1980, Econometrica 48; blocks as clusters, Cameron & Miller 2015; T as Cochran 1954, Biometrics 10.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.special import ndtri, stdtrit

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value

MIN_BANDS, MAX_BANDS = 4, 24
# Correlation lengths of the residuals in a band.
LENGTHS_PER_BAND = 2.0
# Eigenvalues of a block's scaled covariance below this share of the largest: nothing is measured in that direction.
RANK_TOLERANCE = 1e-9


@frozen_value
class Blocks:
    """Of one configuration, B bands: pull (B, n_x), and its covariance noise (B, n_x, n_x), None where unknown."""

    pull: FloatArray
    noise: FloatArray | None


def bands(n_lines: int, length: float) -> tuple[slice, ...]:
    """Bands of equal numbers of lines by the correlation length of the residuals, in lines.

    >>> bands(60, 7.0)
    (slice(0, 15, None), slice(15, 30, None), slice(30, 45, None), slice(45, 60, None))
    """
    wanted = int(np.clip(n_lines / (LENGTHS_PER_BAND * length), MIN_BANDS, MAX_BANDS))
    edges = np.unique(np.linspace(0, n_lines, wanted + 1).round().astype(int))
    return tuple(slice(int(low), int(high)) for low, high in pairwise(edges))


def sum_blocks(pull: FloatArray, J: ComplexArray, S: ComplexArray | None, length: float) -> Blocks:
    """The blocks of one configuration.

    pull (n_x, F): J_k^T r_k of each line.  J (F, m, n_x), S (F, m, m): derivatives and covariance of its whitened
    residuals.  length: their correlation length, in lines.
    """
    pulls, noise = [], []
    for band in bands(len(J), length):
        pulls.append(pull[:, band].sum(axis=1))
        if S is not None:
            columns = J[band]
            noise.append(0.5 * np.sum(columns.conj().transpose(0, 2, 1) @ S[band] @ columns, axis=0).real)
    return Blocks(np.array(pulls), np.array(noise) if S is not None else None)


def block_variance(blocks: Sequence[Blocks], A_inverse: FloatArray) -> FloatArray:
    """Variances (n_x,) of x by the scatter of the pulls of all blocks; zero for fewer than two."""
    moved = np.concatenate([one.pull for one in blocks]) @ A_inverse
    n = int(np.count_nonzero(np.any(moved != 0, axis=1)))
    if n < 2:
        return np.zeros(len(A_inverse))
    t = float(stdtrit(n - 1, 0.975) / ndtri(0.975))
    return np.asarray(t**2 * n / (n - 1) * np.sum(moved**2, axis=0))


def disagreement(blocks: Sequence[Blocks], A_inverse: FloatArray) -> float:
    """T of the blocks whose noise is known; NaN where that is none, or too few to disagree."""
    total, rank = 0.0, -int(np.count_nonzero(np.diag(A_inverse) > 0))
    scale = np.sqrt(np.diag(A_inverse))
    for one in blocks:
        for pull, noise in zip(one.pull, () if one.noise is None else one.noise, strict=one.noise is not None):
            values, vectors = np.linalg.eigh(noise * np.outer(scale, scale))
            known = values > RANK_TOLERANCE * max(float(values[-1]), 1e-300)
            total += float(np.sum((vectors[:, known].T @ (scale * pull)) ** 2 / values[known]))
            rank += int(np.count_nonzero(known))
    return total / rank if rank > 0 else math.nan
