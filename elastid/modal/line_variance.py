r"""Variance of each line and element of a response: as stated, smoothed over lines, or by differences of lines.

Without a covariance, the noise is estimated from five neighbouring lines by the combination that annuls cubics,

.. math:: d_k = \sum_i c_i G_{k+i}, \qquad \sum_i c_i x_i^m = 0\ (m = 0..3), \quad \sum_i c_i^2 = 1

which has the variance of one line; a median of |d|^2 over lines is insensitive to resonances.
"""

import math

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.response import Response

# Lines of a median of differences, and of a mean of stated variances or of residuals.
DIFFERENCE_LINES, MEAN_LINES = 41, 41
# Stated variances with more degrees of freedom are not smoothed.
MANY_DOF = 15.0
# Largest ratio of a line's variance to the smooth variance, so that single lines do not determine their neighbours'.
MAX_RATIO = 100.0
# Least variance over |G|^2: rounding of files, and noise that bends windows, are smaller.
MIN_RELATIVE_VARIANCE = 1e-12


def line_variance(response: Response) -> FloatArray:
    """Return E|dG|^2 > 0 (F, n_y, n_u), without the leakage error of windows, which the smoothed columns model."""
    power = np.abs(response.G) ** 2
    covariance = response.uncertainty
    if response.window and response.noise is not None:
        covariance = response.noise
    if covariance is None or not has_variance(response):
        return floor_variance(by_differences(response.freq_hz, response.G), power)
    if covariance.dof > MANY_DOF:
        return floor_variance(covariance.variance, power)
    # The variance (F, 1, n_u) for unit output noise is not smoothed: for hits it is as uneven as their spectrum.
    input_variance = np.ones((1, 1, 1))
    if covariance.left is not None:
        input_variance = np.einsum("fuu->fu", covariance.left).real[:, None, :]
        input_variance = input_variance / input_variance.mean(axis=0)
    return floor_variance(input_variance * smooth_variance(covariance.variance / input_variance, power), power)


def has_variance(response: Response) -> bool:
    """Return whether the response states its noise."""
    covariance = response.uncertainty
    return covariance is not None and bool(np.any(covariance.variance > 0))


def floor_variance(variance: FloatArray, power: FloatArray) -> FloatArray:
    """Return the variance (F, n_y, n_u) or, if larger, the variance of rounding; power (F, n_y, n_u): |G|^2."""
    mean = power.mean(axis=0)
    return np.asarray(np.maximum(variance, MIN_RELATIVE_VARIANCE * (power + mean) + np.where(mean > 0, 0.0, 1.0)))


def by_differences(freq_hz: FloatArray, G: ComplexArray) -> FloatArray:
    """Estimate the variance (F, n_y, n_u) from fourth differences of neighbouring lines; freq_hz (F,)."""
    F = len(freq_hz)
    power = np.abs(_differences(freq_hz, G)) ** 2
    median = median_filter(power, size=(min(DIFFERENCE_LINES, len(power)), 1, 1), mode="nearest") / math.log(2)
    return np.pad(median, ((2, F - len(power) - 2), (0, 0), (0, 0)), "edge")


def _differences(freq_hz: FloatArray, G: ComplexArray) -> ComplexArray:
    """Return d (F - 4, n_y, n_u), which has the variance of one line if neighbours are independent."""
    x = np.lib.stride_tricks.sliding_window_view(freq_hz, 5) / (freq_hz[-1] / len(freq_hz))
    c = 1 / (x[:, :, None] - x[:, None, :] + np.eye(5)).prod(axis=2)
    c /= np.linalg.norm(c, axis=1, keepdims=True)
    return np.asarray(np.einsum("ki,k...i->k...", c, np.lib.stride_tricks.sliding_window_view(G, 5, axis=0)))


def smooth_variance(variance: FloatArray, power: FloatArray) -> FloatArray:
    """Smooth variances (F, n_y, n_u) of few dof, which would weigh lines by chance, with the power |G|^2.

    The result is (a + b |G|^2) c with output noise a, input noise b and a local mean c.  a, b >= 0 of each element
    are fitted by relative least squares.
    """
    F, size, tiny = len(variance), min(MEAN_LINES, len(variance)), np.finfo(float).tiny
    v, p = variance.reshape(F, -1), power.reshape(F, -1)
    mean = np.maximum(v.mean(axis=0), tiny)
    columns = mean * np.stack([np.ones(p.shape), p / np.maximum(p.mean(axis=0), tiny)])
    scale = columns[0]
    for _ in range(5):
        A = columns / scale
        gram = np.einsum("ifc,jfc->cij", A, A) + 1e-12 * np.eye(2)
        moments = np.einsum("ifc,fc->ci", A, v / scale)
        weights = np.linalg.solve(gram, moments[:, :, None])[:, :, 0]
        # If a or b is negative, the fit is repeated with the other alone.
        weights = np.where(weights[:, ::-1] < 0, moments / np.einsum("cii->ci", gram), np.maximum(weights, 0.0))
        scale = np.einsum("ifc,ci->fc", columns, weights) + 1e-9 * mean
    local = uniform_filter1d(np.minimum(v / scale, MAX_RATIO), size, axis=0, mode="nearest")
    return np.asarray((scale * np.maximum(local, 1 / MAX_RATIO)).reshape(variance.shape))
