"""Sample variances from few degrees of freedom, smoothed over neighbouring lines so that they can weigh."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.special import gammaincinv

from elastid.base.arrays import ComplexArray, FloatArray

# Degrees of freedom behind each weight. Inverse-variance weights from nu of them make the estimate's standard deviation
# sqrt((nu - 1) / (nu - 2)) too large: 2 % for 24.
MIN_DOF = 24
# A line whose variance exceeds the smooth one by more than chance allows (once in a thousand lines) keeps its own.
OUTLIER_PROBABILITY = 1e-3


def smooth_variance(
    variance: FloatArray, G: ComplexArray, dof: float, width: int = 0, weakness: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, int]:
    r"""Sample variances (F,) of one element, each from few degrees of freedom, smoothed over `width` lines.

    .. math:: \ln \tilde v_k = s_k + \text{mean}_{|l - k| \le w/2} (\ln v_l - s_l) + \ln c, \qquad
              s_k = a \ln |G_k|^2 + b \ln w_k

    The exponents a and b in [0, 1] are found by regression: a is 0 where noise ignores the resonances, 1 where it
    follows them; b is 1 where noise sets the level, 0 where distortion does, which grows with the excitation. weakness
    (F,): w, the inverse of the power of the input, where it is known; its spectrum may jump from line to line. The
    mean of logarithms follows a variance that changes by decades. c makes the weight 1 / v~ unbiased, E[1/v~] = 1/v,
    for v_l distributed as v chi^2_{2 dof} / (2 dof). width 0: as many lines as give MIN_DOF degrees of freedom.
    A line that is noisier than chance allows keeps its own variance; one of zero variance takes its neighbours'.

    Returns v~, the same with c such that E[v~] = v (F,), and over how many lines; zeros where no line has a variance.
    """
    known = variance > 0
    n = int(known.sum())
    if n == 0:
        return np.zeros_like(variance), np.zeros_like(variance), 1
    width = min((width or math.ceil(MIN_DOF / dof)) // 2 * 2 + 1, n)
    log_v = np.log(variance[known])
    followed = [_log(np.abs(G[known]) ** 2)] + ([] if weakness is None else [_log(weakness[known])])
    shape = _shape(log_v, np.array(followed), width)
    geometric = np.exp(shape + moving_mean(log_v - shape, width))
    unbiased = geometric / math.exp(log_moment(1, dof, width))
    for_weights = geometric * math.exp(log_moment(-1, dof, width))
    if width > 1:
        loud = variance[known] > unbiased * largest_by_chance(dof)
        for_weights, unbiased = (np.where(loud, variance[known], v) for v in (for_weights, unbiased))
    lines = np.arange(len(variance))
    return np.interp(lines, lines[known], for_weights), np.interp(lines, lines[known], unbiased), width


def _log(power: FloatArray) -> FloatArray:
    return np.asarray(np.log(np.maximum(power, max(1e-30 * float(power.max()), 1e-300))))


def _shape(log_v: FloatArray, followed: FloatArray, width: int) -> FloatArray:
    """s (F,): what of log_v (F,) follows the rows of `followed` (1 or 2, F), exponents in [0, 1]."""
    rough_v = log_v - moving_mean(log_v, width)
    rough = np.array([row - moving_mean(row, width) for row in followed])
    exponents = np.linalg.lstsq(rough.T, rough_v, rcond=1e-9)[0] if np.abs(rough).max() > 1e-9 else np.zeros(len(rough))
    if len(rough) == 2 and not np.all((exponents >= 0) & (exponents <= 1)):
        # The best on the border of the square: one exponent at an end, the other free between its own.
        sides = [_on_a_side(rough_v, rough, one, end) for one in (0, 1) for end in (0.0, 1.0)]
        exponents = min(sides, key=lambda side: float(np.sum((rough_v - side @ rough) ** 2)))
    return np.asarray(np.clip(exponents, 0.0, 1.0) @ followed)


def _on_a_side(rough_v: FloatArray, rough: FloatArray, one: int, end: float) -> FloatArray:
    """Exponents (2,) with one of them at an end."""
    other = rough[1 - one]
    best = (rough_v - end * rough[one]) @ other / max(float(other @ other), 1e-12)
    exponents = np.full(2, end)
    exponents[1 - one] = np.clip(best, 0.0, 1.0)
    return exponents


def moving_mean(values: Any, width: int) -> Any:
    """Mean over the `width` nearest lines, axis 0; at the ends the window stays inside."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    first = np.clip(np.arange(len(values)) - width // 2, 0, len(values) - width)
    return np.asarray((total[first + width] - total[first]) / width)


def log_moment(power: int, dof: float, width: int) -> float:
    """ln E[g^power], g the geometric mean of `width` variables chi^2_{2 dof} / (2 dof); 0 where it does not exist."""
    step = power / width
    if math.isinf(dof) or dof + step <= 0:
        return 0.0
    return width * (math.lgamma(dof + step) - math.lgamma(dof) - step * math.log(dof))


def largest_by_chance(dof: float) -> float:
    """The factor over its mean that a sample variance exceeds with probability OUTLIER_PROBABILITY."""
    return 1.0 if math.isinf(dof) else float(gammaincinv(dof, 1 - OUTLIER_PROBABILITY) / dof)
