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

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.response import FrequencyResponse

# Lines of a median of differences, and of a mean of stated variances or of residuals.
DIFFERENCE_LINES, MEAN_LINES = 41, 41
# Of |G|^2: errors of the model itself (rounding of files, noise that bends windows) below it are no signal.
MIN_RELATIVE_VARIANCE = 1e-12


def line_variance(response: FrequencyResponse) -> FloatArray:
    """E|dG|^2 (F, n_y, n_u), without the leakage of windows that the columns have; positive."""
    power = np.abs(response.G) ** 2
    covariance = response.uncertainty
    if response.window and response.noise is not None:
        covariance = response.noise
    if covariance is None or not np.any(covariance.variance > 0):
        variance = by_differences(response.freq_hz, response.G)
    elif np.isinf(covariance.dof):
        variance = covariance.variance
    else:
        variance = smoothed(covariance.variance, power, covariance.dof)
    mean = power.mean(axis=0)
    floor = MIN_RELATIVE_VARIANCE * (power + mean) + np.where(mean > 0, 0.0, 1.0)
    return np.asarray(np.maximum(variance, floor))


def by_differences(freq_hz: FloatArray, G: ComplexArray) -> FloatArray:
    """Variance (F, n_y, n_u) by fourth differences of neighbouring lines."""
    F = len(freq_hz)
    power = np.abs(_differences(freq_hz, G)) ** 2
    median = median_filter(power, size=(min(DIFFERENCE_LINES, len(power)), 1, 1), mode="nearest") / math.log(2)
    return np.asarray(np.pad(median, ((2, F - len(power) - 2), (0, 0), (0, 0)), "edge"))


def normalised_differences(freq_hz: FloatArray, G: ComplexArray, variance: FloatArray) -> ComplexArray:
    """Differences (F - 4, C) of neighbouring lines over the standard deviation of their middle line."""
    d = _differences(freq_hz, G) / np.sqrt(variance[2:-2])
    return np.asarray(d.reshape(len(d), -1))


def _differences(freq_hz: FloatArray, G: ComplexArray) -> ComplexArray:
    """d (F - 4, n_y, n_u), of the variance of a line where neighbours are independent."""
    x = np.lib.stride_tricks.sliding_window_view(freq_hz, 5) / (freq_hz[-1] / len(freq_hz))
    gaps = x[:, :, None] - x[:, None, :] + np.eye(5)
    c = 1 / gaps.prod(axis=2)
    c /= np.linalg.norm(c, axis=1, keepdims=True)
    return np.asarray(np.einsum("ki,k...i->k...", c, np.lib.stride_tricks.sliding_window_view(G, 5, axis=0)))


def smoothed(variance: FloatArray, power: FloatArray, dof: float) -> FloatArray:
    """Stated variances (F, ...) of few degrees of freedom, their ratio to |G|^2 + local mean averaged over lines."""
    lines = int(np.clip(round(200 / max(dof, 1.0)), 1, MEAN_LINES)) | 1
    if lines == 1 or len(variance) < 3:
        return variance
    size = min(lines, len(variance))
    level = power + power.mean(axis=0) * 1e-6 + np.finfo(float).tiny
    relative = uniform_filter1d(variance / level, size, axis=0, mode="nearest") * level
    absolute = uniform_filter1d(variance, size, axis=0, mode="nearest")
    # Noise of the outputs does not follow |G|, noise of the inputs does: whichever scatters less from line to line.
    by = [np.mean(np.abs(np.log(variance + tiny) - np.log(each + tiny)), axis=0) for tiny in (1e-300,)
          for each in (relative, absolute)]  # fmt: skip
    return np.where(by[0] < by[1], relative, absolute)
