"""Quantiles and tests that several rooms share: normal, chi-square and F."""

from __future__ import annotations

from scipy.special import chdtrc, fdtrc

# 95 % of a normal distribution lie within so many standard deviations of its mean.
QUANTILE_95 = 1.959964


def chi_square_tail(value: float, dof: float) -> float:
    """The probability that a chi-square variable of `dof` degrees of freedom exceeds `value`."""
    return float(chdtrc(dof, value))


def f_test(drop: float, added: int, left: float, dof: float) -> float:
    """The p-value of `added` further parameters that lower a sum of squares by `drop` to `left` with `dof` left.

    A sum that rounding or a poor search lets grow has a p-value of 1.

    >>> round(f_test(4.0, 1, 10.0, 10), 3)
    0.073
    >>> f_test(-1e-9, 1, 10.0, 10)
    1.0
    """
    return float(fdtrc(added, dof, max(drop, 0.0) / added / max(left / dof, 1e-300)))
