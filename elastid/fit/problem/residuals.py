r"""The two residuals between a measured and a modelled response, and how complex ones become real ones.

.. math:: \text{complex: } e = \hat G - G, \qquad \text{log: } e = \ln(\hat G / G), \ \mathrm{Im}\, e \in (-\pi, \pi]

Element by element. A complex error of variance sigma^2 = E|e|^2 carries half of it in each real component, so
r = sqrt(2) [Re e, Im e] / sigma has unit variance. (NLS and LLS of Wernholt and Moberg.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray

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
