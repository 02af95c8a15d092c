r"""LocalOptimum and Ending: the end of a solve, and the distance from there to the stationary point.

delta^2 = dx^T J^T J dx / max(1, V / dof),   dx the Gauss-Newton step of the variables that no bound holds
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.label import labelled
from elastid.fit.problem.least_squares import Evaluation, LeastSquares


@frozen_value
class LocalOptimum:
    """The end of a solve: its start and its end in x (n_x,), V there, and the message of the solver."""

    x_start: FloatArray = labelled("variables of the solver at the start")
    x: FloatArray = labelled("variables of the solver at the optimum")
    cost: float = labelled("V at the optimum")
    iterations: int
    converged: bool
    message: str


# x within this share of its bounds from one of them is at it.
AT_BOUND = 1e-6
# V over its degrees of freedom beyond which the model is wrong, whatever the noise.
FAR_FROM_NOISE = 100.0


@dataclass(frozen=True)
class Ending:
    """x (n_x,) and the problem there; status: why the solver stopped, empty where the optimum was near enough."""

    x: FloatArray
    evaluation: Evaluation
    status: str
    iterations: int


def distance(step: FloatArray, ending: Evaluation, dof: int) -> float:
    """Length delta of a step dx (n_x,) in standard deviations of the estimate."""
    information = 0.5 * float(step @ ending.hessian @ step)
    return float(np.sqrt(max(0.0, information) / max(1.0, ending.cost / max(dof, 1))))


def distance_to_optimum(ending: Evaluation, dof: int, held: BoolArray) -> float:
    """Distance to the stationary point, one Gauss-Newton step, in standard deviations of the estimate.

    held (n_x,): variables that a bound holds, which take no step.  inf where the cost is not finite.
    """
    if not np.isfinite(ending.cost):
        return np.inf
    free = ~held
    step = np.zeros(len(free))
    step[free] = np.linalg.lstsq(ending.hessian[np.ix_(free, free)], ending.gradient[free], rcond=1e-12)[0]
    return distance(step, ending, dof)


def is_far_from_noise(cost: float, dof: int) -> bool:
    """True if V is that of a wrong model, so that its optimum matters only approximately."""
    return cost > FAR_FROM_NOISE * max(dof, 1)


def held_by_bounds(problem: LeastSquares, x: FloatArray, ending: Evaluation) -> BoolArray:
    """Variables (n_x,) at a bound beyond which the cost falls."""
    lower, upper = problem.parameters.x_bounds
    reach = AT_BOUND * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    below, above = x <= lower + reach, x >= upper - reach
    return np.asarray((below & (ending.gradient > 0)) | (above & (ending.gradient < 0)))
