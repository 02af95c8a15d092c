"""Quantiles of distributions, tests, and combinations of correlated numbers.

Functions import SciPy themselves, so that stages that need the constants alone do not wait for it.
"""

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray

QUANTILE_95 = 1.959964  # half width of the 95 % interval of a normal distribution, over its standard deviation
ONE_SIDED_95 = 1.644854  # the same for the interval with one end
FALSE_ALARM_RATE = 1 / 700  # of each residual test of a fit
STD_OVER_MAD = 1.4826  # standard deviation of a normal distribution over its median absolute deviation


def small_sample_factors(dof: FloatArray | float) -> FloatArray:
    """Return the ratio (n,) of 95 % quantiles, Student's t over normal; dof (n,) or scalar, possibly infinite.

    They widen standard deviations that are themselves estimated.

    >>> small_sample_factors(np.array([3.0, 24.0, np.inf])).round(3).tolist()
    [1.624, 1.053, 1.0]
    """
    from scipy.special import ndtri, stdtrit

    return np.where(np.isinf(dof), 1.0, stdtrit(np.minimum(dof, 1e9), 0.975) / ndtri(0.975))


def chi_square_limit(dof: float, tail: float) -> float:
    """Return the value that a chi-square variable of `dof` degrees of freedom exceeds with probability `tail`.

    >>> round(chi_square_limit(1, 0.05), 3)
    3.841
    """
    from scipy.special import chdtri

    return float(chdtri(dof, tail))


def max_cost_ratio(cost_dof: float) -> float:
    """Return the upper limit of V / E[V] for a correct model at the false-alarm rate.

    2 / cost_dof: relative variance of V / E[V], a chi-square variable over its degrees of freedom.
    """
    dof = max(cost_dof, 1.0)
    return chi_square_limit(dof, FALSE_ALARM_RATE) / dof


def exceeds_cost_limit(cost: float, expected_cost: float, cost_dof: float) -> bool:
    """Return True if V exceeds the limit of noise alone (`max_cost_ratio`)."""
    return cost > expected_cost * max_cost_ratio(cost_dof)


def f_test(drop: float, n_added: int, residual: float, dof: float) -> float:
    """Return the p-value of n_added parameters: F = (drop / n_added) / (residual / dof).

    drop: decrease of the sum of squares, 0 if it increases.  residual: the sum of squares with them, of `dof` degrees
    of freedom.

    >>> round(f_test(4.0, 1, 10.0, 10), 3)
    0.073
    >>> f_test(-1e-9, 1, 10.0, 10)
    1.0
    """
    from scipy.special import fdtrc

    return float(fdtrc(n_added, dof, max(drop, 0.0) / n_added / max(residual / dof, 1e-300)))


def correlation_of(covariance: FloatArray) -> FloatArray:
    """Return the correlations (n, n) of a covariance (n, n); NaN off the diagonal for an infinite or zero variance."""
    std = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.asarray(covariance / np.outer(std, std))
    np.fill_diagonal(correlation, 1.0)
    return correlation


@dataclass(frozen=True)
class Combination:
    """Identifiable weighted sum of parameters (members) that are not identifiable individually.

    members: indices of the parameters.  weights: of the members; the first is 1.  std: of the value.
    """

    members: tuple[int, ...]
    weights: tuple[float, ...]
    value: float
    std: float


MAX_COMBINATION_STD = 0.25  # of a reported combination, over the standard deviation of its first member
MIN_MEMBER = 0.25  # least component of a member in its eigenvector, over the largest component


def identifiable_combinations(x: FloatArray, covariance: FloatArray, max_members: int = 3) -> tuple[Combination, ...]:
    r"""Return combinations of at most `max_members` correlated numbers x (n,), one per small eigenvalue of correlation.

    .. math:: c = x_i - C_{iJ} C_{JJ}^{-1} x_J, \qquad \mathrm{var}\, c = w^T C w

    the residual of the member i after its regression on the other members J; weights are rounded to two digits.

    >>> C = np.array([[1.0, -1.99], [-1.99, 4.0]])
    >>> [(c.weights, round(c.std, 2)) for c in identifiable_combinations(np.array([3.0, 1.0]), C)]
    [((1.0, 0.5), 0.1)]
    """
    std = np.sqrt(np.diag(covariance))
    if not np.all(np.isfinite(std)) or not np.all(std > 0):
        return ()
    eigenvalues, vectors = np.linalg.eigh(covariance / np.outer(std, std))
    combinations: dict[tuple[int, ...], Combination] = {}
    for eigenvalue, vector in zip(eigenvalues.tolist(), np.abs(vectors.T), strict=True):
        order = np.argsort(-vector)[:max_members]
        members = sorted(order[vector[order] > MIN_MEMBER * vector.max()].tolist())
        if eigenvalue > MAX_COMBINATION_STD or len(members) < 2:
            continue
        i, other_members = members[0], members[1:]
        w = -np.linalg.solve(covariance[np.ix_(other_members, other_members)], covariance[other_members, i])
        weights = np.array([1.0, *(float(f"{weight:.2g}") for weight in w)])
        combination_std = float(np.sqrt(weights @ covariance[np.ix_(members, members)] @ weights))
        if combination_std < MAX_COMBINATION_STD * std[i]:
            value = float(weights @ x[members])
            combination = Combination(tuple(members), tuple(weights.tolist()), value, combination_std)
            combinations.setdefault(combination.members, combination)
    return tuple(combinations.values())
