r"""Scatter of gear ratios between angles, due to transmission error, and its contribution to the parameters' variance.

.. math:: \delta G_q = \sum_j e_{jq} \frac{\partial G_q}{\partial e_{jq}}, \qquad e_{jq} \sim N(0, s_j^2)

for gear j at angle q, equal in all configurations with this angle (slopes: `systematic_errors.ratio_errors`).
Ratios are not estimated, because their common part is almost indistinguishable from masses and inertias. Their
variance is estimated, by the components of the residuals r along the whitened errors V:

.. math:: h = V^T r \sim N\big(0,\; N D N + c N\big), \qquad N = V^T V - V^T J A^{-1} J^T V, \quad
          D = \mathrm{diag}\, s_j^2, \qquad \mathrm{cov}\, x = \sum_j E[s_j^2] \sum_q M_{jq} M_{jq}^T

The s_j of one robot are alike, ln s_j ~ N(m, 0.7^2) with a common m: a gear whose ratios agree by chance, as in two
configurations, has the scatter of the other gears.  M_jq: the change of x if the ratio of gear j changes by its
tolerance at angle q.  c: power of a whitened residual.  Where V exceeds the noise and such ratios do not explain it,
another error does, and s_j is the file's tolerance.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from elastid.base.arrays import FloatArray, frozen_value, values_by_name
from elastid.fit.robust_covariance import LineSums

# rad; angles that transmission errors do not tell apart.
SAME_ANGLE = 1e-3
# Grid of the std of a ratio over its tolerance, and prior mean and std of its logarithm, for rigs with transmission
# errors of 0 to 2 % of the ratio in 2, 3 and 5 configurations (scripts/studies/results.csv).
RATIO_STD = np.exp(np.linspace(np.log(0.03), np.log(8.0), 21))
RATIO_PRIOR = np.log(8.0), 2.0
LOG_STD_OF_GEARS = 0.7  # std of the logarithm among the gears of a robot
# Ratios explain an excess if their std is at most this multiple of the tolerance (2 % of the ratio by default), and
# if they explain at least this fraction.
LARGEST_STD, MIN_EXPLAINED_FRACTION = 6.7, 0.8


@frozen_value
class RatioScatter:
    """Covariance (n_x, n_x) of x by the scatter of the gear ratios.

    std: of each ratio over its tolerance, by input; 1 for a gear at a single angle.  explains: True if V exceeds the
    noise and the posterior mean of the ratios explains most of the excess.
    """

    covariance: FloatArray
    std: Mapping[str, float]
    explains: bool


def scatter_of_ratios(
    line_sums: Sequence[LineSums], H: FloatArray, cost: float, expected_cost: float, correlated_lines: float,
    is_excess: bool, min_std: float = 0.0,
) -> RatioScatter:  # fmt: skip
    """Estimate the variance of the ratios.  H (n, n_x): x = H^T z.

    cost: V, NaN for a forecast.  expected_cost: V by the noise.  correlated_lines: number of lines with one common
    error. is_excess: V exceeds the noise.  min_std: lower bound of the std of each ratio over its tolerance. In three
    rounds, c is V / expected_cost without the decrease of V that the ratios explain.
    """
    joints = [joint for sums_q in line_sums for joint in sums_q.ratios.joints]
    if not joints:
        return RatioScatter(np.zeros((H.shape[1], H.shape[1])), {}, False)
    pull = np.reshape([row for sums_q in line_sums for row in sums_q.ratios.pull], (-1, len(H)))
    power = block_diag(*(sums_q.ratios.power for sums_q in line_sums)) - pull @ pull.T
    slopes = np.concatenate([sums_q.ratios.slopes for sums_q in line_sums])
    groups = _same_angles(joints)
    to_groups = np.array([[label == group for group in dict.fromkeys(groups)] for label in groups], float)
    names = [name for name, _ in dict.fromkeys(groups)]
    shifts = to_groups.T @ pull @ H
    N, h, drop = to_groups.T @ power @ to_groups, to_groups.T @ slopes, 0.0
    for _ in range(3):
        variance = correlated_lines * max((cost - drop) / max(expected_cost, 1e-300), 1.0)
        s = ratio_std(N, h, names, variance)
        e = s * np.linalg.solve((s * N.T).T * s + (1.0 if math.isnan(variance) else variance) * np.eye(len(s)), s * h)
        drop = float(2 * h @ e - e @ N @ e)
    explains = is_excess and s.max() <= LARGEST_STD and drop > MIN_EXPLAINED_FRACTION * (cost - expected_cost)
    s = np.ones(len(s)) if is_excess and not explains else np.maximum(s, min_std)
    return RatioScatter((s[:, None] * shifts).T @ (s[:, None] * shifts), values_by_name(names, s), explains)


def _same_angles(joints: Sequence[tuple[str, float]]) -> list[tuple[str, int]]:
    """Return gear and angle number of each (gear, angle); neighbours closer than SAME_ANGLE have the same number."""
    order = sorted(range(len(joints)), key=joints.__getitem__)
    steps = [
        joints[i][0] != joints[j][0] or not abs(joints[j][1] - joints[i][1]) < SAME_ANGLE for i, j in pairwise(order)
    ]
    number = dict(zip(order, np.cumsum([0, *steps]).tolist(), strict=False))
    return [(name, number[i]) for i, (name, _) in enumerate(joints)]


def ratio_std(N: FloatArray, h: FloatArray, names: list[str], variance: float) -> FloatArray:
    """Return the std s (n,) of each ratio over its tolerance; names (n,): the gear of each.

    s is the root of the posterior mean of s_j^2, computed gear by gear in three rounds; 1 for a gear at a single angle,
    which shows no scatter. In forecasts h h^T is c N.
    """
    c, s, likelihood = 1.0 if math.isnan(variance) else variance, np.ones(len(names)), dict[str, FloatArray]()
    prior = np.exp(-0.5 * ((np.log(RATIO_STD) - RATIO_PRIOR[0]) / RATIO_PRIOR[1]) ** 2)
    among = np.exp(-0.5 * (np.log(np.divide.outer(RATIO_STD, RATIO_STD)) / LOG_STD_OF_GEARS) ** 2)
    among /= among.sum(axis=0)
    for name in [name for name in dict.fromkeys(names) if names.count(name) > 1] * 3:
        is_gear = np.array(names) == name
        power, V = np.linalg.eigh(N[np.ix_(is_gear, is_gear)])
        is_significant = power > 1e-9 * max(power[-1], 1e-300)
        V, power = V[:, is_significant], power[is_significant]
        across = V.T @ N[np.ix_(is_gear, ~is_gear)] * s[~is_gear]
        covariance_of_others = across @ across.T + c * np.diag(power)
        square = c * np.diag(power) if math.isnan(variance) else np.outer(V.T @ h[is_gear], V.T @ h[is_gear])
        C = covariance_of_others + RATIO_STD[:, None, None] ** 2 * np.diag(power**2)
        quadratic = np.trace(np.linalg.solve(C, np.broadcast_to(square, C.shape)), axis1=1, axis2=2)
        log_w = -0.5 * (np.linalg.slogdet(C)[1] + quadratic)
        likelihood[name] = np.exp(log_w - log_w.max())
        of_others = np.prod([among.T @ w for other, w in likelihood.items() if other != name], axis=0)
        w = likelihood[name] * (among @ (prior * of_others))
        s[is_gear] = np.sqrt(w @ RATIO_STD**2 / w.sum())
    return s
