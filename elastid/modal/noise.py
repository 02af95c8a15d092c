r"""Variance of each line and element of a response: as stated, smoothed over lines, or by differences of lines.

A response without a covariance shows its noise from line to line: of five neighbours the combination that no cubic
passes has the variance of one,

.. math:: d_k = \sum_i c_i G_{k+i}, \qquad \sum_i c_i x_i^m = 0\ (m = 0..3), \quad \sum_i c_i^2 = 1

and the median of |d|^2 over some lines leaves resonances out.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.optimize import nnls

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.response import Covariance, Response

# Lines of a median of differences, and of a mean of stated variances or of residuals.
DIFFERENCE_LINES, MEAN_LINES = 41, 41
# Stated variances of more degrees of freedom are taken as they are.
MANY_DOF = 15.0
# Of a line's variance over its smooth level, so that single lines do not make that of their neighbours.
MAX_RATIO = 100.0
# Of |G|^2: errors of the model itself (rounding of files, noise that bends windows) below it are no signal.
MIN_RELATIVE_VARIANCE = 1e-12


def line_variance(response: Response) -> FloatArray:
    """E|dG|^2 (F, n_y, n_u), without the leakage of windows that the columns have; positive."""
    power = np.abs(response.G) ** 2
    covariance = response.uncertainty
    if response.window and response.noise is not None:
        covariance = response.noise
    if covariance is None or not has_variance(response):
        return floored(by_differences(response.freq_hz, response.G), power)
    if covariance.dof > MANY_DOF:
        return floored(covariance.variance, power)
    # The part by the inputs is known line by line: of hits it is as uneven as their spectrum.
    of_inputs = _of_inputs(covariance)
    return floored(of_inputs * smoothed(covariance.variance / of_inputs, power), power)


def _of_inputs(covariance: Covariance) -> FloatArray:
    """Variance (F, 1, n_u) of G by noise of variance 1 at the outputs, over its mean; 1 where it is not known."""
    if covariance.left is None:
        return np.ones((1, 1, 1))
    own = np.einsum("fuu->fu", covariance.left).real[:, None, :]
    return np.asarray(own / own.mean(axis=0))


def has_variance(response: Response) -> bool:
    """True where the response states its noise."""
    covariance = response.uncertainty
    return covariance is not None and bool(np.any(covariance.variance > 0))


def floored(variance: FloatArray, power: FloatArray) -> FloatArray:
    """The variance, positive: at least that of rounding."""
    mean = power.mean(axis=0)
    floor = MIN_RELATIVE_VARIANCE * (power + mean) + np.where(mean > 0, 0.0, 1.0)
    return np.asarray(np.maximum(variance, floor))


def by_differences(freq_hz: FloatArray, G: ComplexArray) -> FloatArray:
    """Variance (F, n_y, n_u) by fourth differences of neighbouring lines."""
    F = len(freq_hz)
    power = np.abs(_differences(freq_hz, G)) ** 2
    median = median_filter(power, size=(min(DIFFERENCE_LINES, len(power)), 1, 1), mode="nearest") / math.log(2)
    return np.asarray(np.pad(median, ((2, F - len(power) - 2), (0, 0), (0, 0)), "edge"))


def _differences(freq_hz: FloatArray, G: ComplexArray) -> ComplexArray:
    """d (F - 4, n_y, n_u), of the variance of a line where neighbours are independent."""
    x = np.lib.stride_tricks.sliding_window_view(freq_hz, 5) / (freq_hz[-1] / len(freq_hz))
    gaps = x[:, :, None] - x[:, None, :] + np.eye(5)
    c = 1 / gaps.prod(axis=2)
    c /= np.linalg.norm(c, axis=1, keepdims=True)
    return np.asarray(np.einsum("ki,k...i->k...", c, np.lib.stride_tricks.sliding_window_view(G, 5, axis=0)))


def smoothed(variance: FloatArray, power: FloatArray) -> FloatArray:
    """Variances (F, n_y, n_u) of few degrees of freedom as (a + b |G|^2) c: a by outputs, b by inputs, c a local mean.

    a, b >= 0 of each element by least squares relative to their sum; single variances would weigh lines by chance.
    """
    F, size = len(variance), min(MEAN_LINES, len(variance))
    v, p = variance.reshape(F, -1), power.reshape(F, -1)
    level = np.empty(v.shape)
    for c in range(v.shape[1]):
        mean = max(float(v[:, c].mean()), np.finfo(float).tiny)
        columns = np.stack(
            [np.full(F, mean), p[:, c] * mean / max(float(p[:, c].mean()), np.finfo(float).tiny)], axis=1
        )
        own = np.full(F, mean)
        for _ in range(5):
            share, _ = nnls(columns / own[:, None], v[:, c] / own)
            own = columns @ share + 1e-9 * mean
        level[:, c] = own
    local = uniform_filter1d(np.minimum(v / level, MAX_RATIO), size, axis=0, mode="nearest")
    return np.asarray((level * np.maximum(local, 1 / MAX_RATIO)).reshape(variance.shape))
