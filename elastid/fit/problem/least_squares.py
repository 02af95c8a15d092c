r"""LeastSquares: a weighted nonlinear least-squares problem, its residuals, and its local optimum.

    V(x) = sum_i r_i(x)^2 + sum_p ((x_p - m_p) / s_p)^2,   each real residual r_i of unit variance under the noise model

so that the expected V is the number of degrees of freedom, n_residuals + number of priors - n_x.

.. math:: \text{complex: } e = \hat G - G, \qquad \text{log: } e = \ln(\hat G / G), \ \mathrm{Im}\, e \in (-\pi, \pi]

Element by element. A complex error of variance sigma^2 = E|e|^2 carries half of it in each real component, so
r = sqrt(2) [Re e, Im e] / sigma has unit variance. (NLS and LLS of Wernholt and Moberg.)

    delta^2 = dx^T J^T J dx / max(1, V / dof),   dx: Gauss-Newton step of the variables without an active bound

is the squared distance from the end of a solve to the stationary point, in standard deviations of the estimate.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, labelled
from elastid.parameters import Parameters


@dataclass(frozen=True)
class Evaluation:
    """V, its gradient (n_x,) and its Gauss-Newton Hessian 2 J^T J (n_x, n_x), at one x."""

    cost: float
    gradient: FloatArray
    hessian: FloatArray


@dataclass(frozen=True)
class LeastSquares:
    """Least-squares problem in x (n_x,).  parameters: names, scale, bounds, start.  evaluate(x): V and derivatives.

    border(x): D (n_x, n_x) such that V is finite at x + s for s^T D s < 1, to first order; None if V has no barrier.
    """

    parameters: Parameters
    n_residuals: int
    evaluate: Callable[[FloatArray], Evaluation]
    border: Callable[[FloatArray], FloatArray] | None = None

    @property
    def dof(self) -> int:
        """Degrees of freedom, the expected V: number of residuals and priors minus number of parameters."""
        return self.n_residuals - int(np.count_nonzero(self.parameters.prior_slopes == 0))


ResidualKind: TypeAlias = Literal["complex", "log"]


def difference(criterion: ResidualKind, measured: ComplexArray, G: ComplexArray) -> ComplexArray:
    """Return e = Ghat - G, or ln(Ghat / G) with wrapped phase, (..., F, n_y, n_u); not finite, and unused, at zeros."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return measured - G if criterion == "complex" else np.log(measured / G)


def error_gain(criterion: ResidualKind, G: ComplexArray) -> ComplexArray:
    """Return s = -de/dG = 1, or 1 / G (F, n_y, n_u): to first order e = s (Ghat - G) at G = Ghat."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.ones_like(G) if criterion == "complex" else 1.0 / G


def as_real(values: ComplexArray) -> FloatArray:
    """View (..., N) complex as (..., 2 N) real, [Re, Im] side by side; contiguous memory is not copied."""
    return np.ascontiguousarray(values).view(np.float64)


@frozen_value
class LocalOptimum:
    """Result of a solve: start and end x (n_x,), V at the end, and the message of the solver."""

    x_start: FloatArray = labelled("variables of the solver at the start")
    x: FloatArray = labelled("variables of the solver at the optimum")
    cost: float = labelled("V at the optimum")
    iterations: int
    converged: bool
    message: str


@dataclass(frozen=True)
class Ending:
    """End of a solver at x (n_x,) with the evaluation there; status: reason of the stop, empty if it converged."""

    x: FloatArray
    evaluation: Evaluation
    status: str
    iterations: int


def distance(step: FloatArray, ending: Evaluation, dof: int) -> float:
    """Return the length delta of a step dx (n_x,) in standard deviations of the estimate."""
    information = 0.5 * float(step @ ending.hessian @ step)
    return float(np.sqrt(abs(information) / max(1.0, ending.cost / max(dof, 1))))  # abs: rounding errors


def distance_to_optimum(ending: Evaluation, dof: int, fixed: BoolArray) -> float:
    """Return the distance to the stationary point, one Gauss-Newton step, in standard deviations of the estimate.

    fixed (n_x,): variables at an active bound, which take no step.  inf where the cost is not finite.
    """
    if not np.isfinite(ending.cost):
        return np.inf
    free = ~fixed
    step = np.zeros(len(free))
    step[free] = np.linalg.lstsq(ending.hessian[np.ix_(free, free)], ending.gradient[free], rcond=1e-12)[0]
    return distance(step, ending, dof)


def is_far_from_noise(cost: float, dof: float) -> bool:
    """Return True if V is so large that the model is wrong for any noise, and an approximate optimum is sufficient."""
    return cost > 100 * max(dof, 1)


def find_active_bounds(problem: LeastSquares, x: FloatArray, ending: Evaluation) -> BoolArray:
    """Return True for each variable (n_x,) within 1e-6 of a bound towards which the cost falls."""
    lower, upper = problem.parameters.x_bounds
    margin = 1e-6 * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    below, above = x <= lower + margin, x >= upper - margin
    return (below & (ending.gradient > 0)) | (above & (ending.gradient < 0))
