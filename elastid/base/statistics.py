"""Quantiles and tests that several rooms share: normal, t, chi-square and F; false discovery control.

SciPy is imported where it is used: stages that need the constants alone do not wait for it.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray

# 95 % of a normal distribution lie within so many standard deviations of its mean.
QUANTILE_95 = 1.959964
# And so many above its mean bound it on one side with 95 %.
ONE_SIDED_95 = 1.644854
# The standard deviation of a normal distribution over its median absolute deviation.
STD_OVER_MAD = 1.4826


def small_sample_factor(n: int) -> float:
    """The 95 % quantile of Student's t with n - 1 degrees of freedom over that of the normal distribution.

    It widens a standard deviation that was estimated from n values.

    >>> round(small_sample_factor(4), 3)
    1.624
    """
    from scipy.special import ndtri, stdtrit

    return float(stdtrit(n - 1, 0.975) / ndtri(0.975))


def small_sample_factors(dof: FloatArray) -> FloatArray:
    """The same (n,) for variances of `dof` (n,) degrees of freedom each, 1 where these are infinite.

    >>> small_sample_factors(np.array([3.0, 24.0, np.inf])).round(3).tolist()
    [1.624, 1.053, 1.0]
    """
    from scipy.special import stdtrit

    return np.where(np.isinf(dof), 1.0, stdtrit(np.minimum(dof, 1e9), 0.975) / QUANTILE_95)


def chi_square_limit(dof: float, tail: float) -> float:
    """The value that a chi-square variable of `dof` degrees of freedom exceeds with probability `tail`.

    >>> round(chi_square_limit(1, 0.05), 3)
    3.841
    """
    from scipy.special import chdtri

    return float(chdtri(dof, tail))


def chi_square_tail(value: float, dof: float) -> float:
    """The probability that a chi-square variable of `dof` degrees of freedom exceeds `value`."""
    from scipy.special import chdtrc

    return float(chdtrc(dof, value))


def f_test(drop: float, added: int, left: float, dof: float) -> float:
    """The p-value of `added` further parameters that lower a sum of squares by `drop` to `left` with `dof` left.

    A sum that rounding or a poor search lets grow has a p-value of 1.

    >>> round(f_test(4.0, 1, 10.0, 10), 3)
    0.073
    >>> f_test(-1e-9, 1, 10.0, 10)
    1.0
    """
    from scipy.special import fdtrc

    return float(fdtrc(added, dof, max(drop, 0.0) / added / max(left / dof, 1e-300)))


def discoveries(p_values: FloatArray, rate: float) -> BoolArray:
    """Tests (n,) that are rejected at a false discovery rate (Benjamini and Hochberg 1995, by SciPy).

    >>> discoveries(np.array([0.001, 0.02, 0.6]), 0.05).tolist()
    [True, True, False]
    """
    from scipy.stats import false_discovery_control  # slow to load, and seldom needed

    return np.asarray(false_discovery_control(p_values) <= rate)


def correlation_of(covariance: FloatArray) -> FloatArray:
    """Correlations (n, n) of a covariance (n, n); NaN off the diagonal where a variance is infinite or zero."""
    std = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.asarray(covariance / np.outer(std, std))
    np.fill_diagonal(correlation, 1.0)
    return correlation
