r"""LeastSquares: a weighted nonlinear least-squares problem that knows no robot; residuals between two responses.

    V(x) = sum_i r_i(x)^2 + sum_p ((x_p - m_p) / s_p)^2,   each real residual r_i of unit variance under the noise model

so that V is expected to be the degrees of freedom, n_residuals + priors - n_x.

.. math:: \text{complex: } e = \hat G - G, \qquad \text{log: } e = \ln(\hat G / G), \ \mathrm{Im}\, e \in (-\pi, \pi]

Element by element. A complex error of variance sigma^2 = E|e|^2 carries half of it in each real component, so
r = sqrt(2) [Re e, Im e] / sigma has unit variance. (NLS and LLS of Wernholt and Moberg.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
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


ResidualKind: TypeAlias = Literal["complex", "log"]
Residual: TypeAlias = Callable[[ComplexArray, ComplexArray], tuple[ComplexArray, ComplexArray]]


def linear(measured: ComplexArray, G: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """e = Ghat - G and s = -de/dG = 1."""
    return measured - G, np.ones_like(G)


def logarithmic(measured: ComplexArray, G: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """e = ln(Ghat / G), its phase wrapped, and s = -de/dG = 1 / G.

    To first order e is (Ghat - G) / G, so its standard deviation is that of Ghat over |Ghat|. Where either is zero
    the result is not finite: such elements must be left out.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(measured / G), 1.0 / G


RESIDUALS: dict[ResidualKind, Residual] = {"complex": linear, "log": logarithmic}


def error_gain(criterion: ResidualKind, measured: ComplexArray) -> ComplexArray:
    """g of e = g (Ghat - G) to first order at G = Ghat: how an error of Ghat appears in the residual."""
    return RESIDUALS[criterion](measured, measured)[1]


def as_real(values: ComplexArray) -> FloatArray:
    """(..., N) complex as (..., 2 N) real, [Re, Im] side by side, without a copy where the memory is contiguous."""
    return np.ascontiguousarray(values).view(np.float64)
