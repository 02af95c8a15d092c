"""Residual test: upper limit of the cost V for a correct model, from the measured noise."""

from elastid.base.statistics import chi_square_limit


def exceeds_noise(cost: float, expected_cost: float, cost_dof: float) -> bool:
    """Return True if V exceeds the limit of noise alone (false-alarm rate 1/700)."""
    return cost > expected_cost * max_cost_ratio(cost_dof)


def max_cost_ratio(cost_dof: float) -> float:
    """Return the upper limit of V / E[V] for a correct model (false-alarm rate 1/700).

    2 / cost_dof: relative variance of that ratio, a chi-square variable over its degrees of freedom.
    """
    dof = max(cost_dof, 1.0)
    return chi_square_limit(dof, 1 / 700) / dof
