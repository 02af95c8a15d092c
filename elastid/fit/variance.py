"""Sample variances from few degrees of freedom, smoothed over neighbouring lines so that they can weigh."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaincinv

from elastid.arrays import ComplexArray, FloatArray

# Degrees of freedom behind each weight. Inverse-variance weights from nu of them make the estimate's standard deviation
# sqrt((nu - 1) / (nu - 2)) too large: 2 % for 24.
SUPPORT = 24
# A line whose variance exceeds the smooth one by more than chance allows (once in a thousand lines) keeps its own.
CHANCE = 1e-3


def smoothed(variance: FloatArray, G: ComplexArray, dof: float, width: int = 0) -> tuple[FloatArray, FloatArray]:
    r"""Sample variances (F,) of one element, each from few degrees of freedom, smoothed over `width` lines.

    .. math:: \ln \tilde v_k = a \ln |G_k|^2 + \text{mean}_{|l - k| \le w/2} (\ln v_l - a \ln |G_l|^2) + \ln c

    The exponent a in [0, 1] is found by regression: 0 where noise ignores the resonances, 1 where it follows them. The
    mean of logarithms follows a variance that changes by decades. c makes the weight 1 / v~ unbiased, E[1/v~] = 1/v,
    for v_l distributed as v chi^2_{2 dof} / (2 dof). width 0: as many lines as give SUPPORT degrees of freedom.
    A line that is noisier than chance allows keeps its own variance; one of zero variance takes its neighbours'.

    Returns v~, and the same with c such that E[v~] = v (F,); zeros where no line has a variance.
    """
    known = variance > 0
    n = int(known.sum())
    if n == 0:
        return np.zeros_like(variance), np.zeros_like(variance)
    width = min((width or math.ceil(SUPPORT / dof)) // 2 * 2 + 1, n)
    log_v = np.log(variance[known])
    power = np.abs(G[known]) ** 2
    log_power = np.log(np.maximum(power, max(1e-30 * float(power.max()), 1e-300)))
    rough_v, rough_power = (values - _moving_mean(values, width) for values in (log_v, log_power))
    exponent = float(np.clip(rough_v @ rough_power / max(rough_power @ rough_power, 1e-12), 0.0, 1.0))
    geometric = np.exp(exponent * log_power + _moving_mean(log_v - exponent * log_power, width))
    unbiased = geometric / _moment(1, dof, width)
    for_weights = geometric * _moment(-1, dof, width)
    if width > 1:
        loud = variance[known] > unbiased * _largest_by_chance(dof)
        for_weights, unbiased = (np.where(loud, variance[known], v) for v in (for_weights, unbiased))
    lines = np.arange(len(variance))
    return np.interp(lines, lines[known], for_weights), np.interp(lines, lines[known], unbiased)


def _moving_mean(values: FloatArray, width: int) -> FloatArray:
    """Mean over the `width` nearest lines; at the ends the window stays inside."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    first = np.clip(np.arange(len(values)) - width // 2, 0, len(values) - width)
    mean: FloatArray = (total[first + width] - total[first]) / width
    return mean


def _moment(power: int, dof: float, width: int) -> float:
    """E[g^power], g the geometric mean of `width` variables chi^2_{2 dof} / (2 dof); 1 where it does not exist."""
    step = power / width
    if math.isinf(dof) or dof + step <= 0:
        return 1.0
    return math.exp(width * (math.lgamma(dof + step) - math.lgamma(dof) - step * math.log(dof)))


def _largest_by_chance(dof: float) -> float:
    """The factor over its mean that a sample variance exceeds with probability CHANCE."""
    return 1.0 if math.isinf(dof) else float(gammaincinv(dof, 1 - CHANCE) / dof)
