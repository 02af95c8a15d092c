r"""The error of the local model where transient and response share its windows, from models with more poles.

A model that is too simple for a window passes part of G off as transient, and its residual does not show it: a
polynomial in a window wider than a resonance, a rational function with too few poles beside one.  A richer model of
about the same data differs from it by noise alone where both are right.  With g the mean over neighbouring lines of

.. math:: \frac{|G - G_{richer}|^2}{\sigma^2 + \sigma^2_{richer}}

the squared error (g - 1)(sum of the variances) is added to the variance of G where g is clearly above 1; of several
richer models that with the largest error counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.response import Covariance

# Lines that are averaged, and the mean ratio above which a difference is more than noise.
_LINES = 11
_MIN_RATIO = 1.5


def with_model_error(
    covariance: Covariance, differences: Sequence[ComplexArray], variances: Sequence[FloatArray]
) -> Covariance:
    """The covariance of G with its model error, from its differences (F, n_y, n_u) to richer models of these variances.

    A difference of 0 says nothing.  Outputs are widened as a whole, by the mean over their inputs, so that their
    correlations stay.
    """
    error = np.zeros(covariance.variance.shape)
    for difference, variance in zip(differences, variances, strict=True):
        both = covariance.variance + variance
        ratio = np.divide(np.abs(difference) ** 2, both, out=np.zeros(both.shape), where=both > 0)
        g = _local_mean(ratio)
        error = np.maximum(error, np.where(g > _MIN_RATIO, (g - 1) * both, 0.0))
    relative = np.divide(error, covariance.variance, out=np.zeros(error.shape), where=covariance.variance > 0)
    factor = np.sqrt(1 + relative.mean(axis=2))
    right = None if covariance.right is None else factor[:, :, None] * covariance.right * factor[:, None, :]
    return replace(covariance, variance=covariance.variance * factor[:, :, None] ** 2, right=right)


def _local_mean(x: FloatArray) -> FloatArray:
    """Mean (F, ...) over the neighbouring lines, fewer of them at the ends."""
    F = len(x)
    total = np.concatenate([np.zeros((1, *x.shape[1:])), np.cumsum(x, axis=0)])
    first = np.maximum(np.arange(F) - _LINES // 2, 0)
    last = np.minimum(np.arange(F) + _LINES // 2 + 1, F)
    return np.asarray((total[last] - total[first]) / (last - first).reshape(-1, *(1,) * (x.ndim - 1)))
