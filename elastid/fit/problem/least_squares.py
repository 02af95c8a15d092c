"""LeastSquares: a weighted nonlinear least-squares problem; it knows no robot.

    V(x) = sum_i r_i(x)^2 + sum_p ((x_p - m_p) / s_p)^2,   each real residual r_i of unit variance under the noise model

so that V is expected to be the degrees of freedom, n_residuals + priors - n_x.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from elastid.base.arrays import FloatArray
from elastid.parameters import ParameterSet


@dataclass(frozen=True)
class Evaluation:
    """V, its gradient (n_x,) and its Gauss-Newton Hessian 2 J^T J (n_x, n_x), at one x."""

    cost: float
    gradient: FloatArray
    hessian: FloatArray


@dataclass(frozen=True)
class LeastSquares:
    """parameters: names, scale, bounds, start.  evaluate(x): all that Gauss-Newton needs, the Jacobian never stacked.

    border(x): D (n_x, n_x) such that V is finite at x + s for s^T D s < 1, to first order; None without a barrier in V.
    """

    parameters: ParameterSet
    n_residuals: int
    evaluate: Callable[[FloatArray], Evaluation]
    border: Callable[[FloatArray], FloatArray] | None = None

    @property
    def dof(self) -> int:
        """Degrees of freedom, the expected V."""
        priors = sum(parameter.prior is not None for parameter in self.parameters.free)
        return self.n_residuals + priors - len(self.parameters.free)
