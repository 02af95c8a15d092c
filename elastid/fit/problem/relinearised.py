r"""The fit of a robot whose linearisation holds near its point only: linearised anew at every x.

.. math:: x \to \theta \to q_0(\theta) \to M, D, K\,(q_0, \theta) \to G, \qquad dG / dx \text{ along the whole chain}

The tangent stiffness of a nonlinear spring changes by factors between a start and the truth; a model that is affine
about the nominal parameters would lead all starts into one valley. The same holds for masses identified together with
their places: M contains m c^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.least_squares import Evaluation, LeastSquares


@dataclass(frozen=True, eq=False)
class RelinearisedFit:
    """linearise(x): the fit with every configuration linearised at x.  first: at the first start, for its gains."""

    linearise: Callable[[FloatArray], ElasticFit]
    first: ElasticFit

    @property
    def problem(self) -> LeastSquares:
        """The problem of a solver; it pickles."""
        border = self.first.problem.border
        return LeastSquares(self.first.parameters, self.first.n_residuals, self.evaluate, border)

    def evaluate(self, x: FloatArray) -> Evaluation:
        """V, its gradient and 2 J^T J at x; V is infinite, and no error, where the robot cannot stand."""
        try:
            return self.at(x).evaluate(x)
        except StudyError:
            return Evaluation(math.inf, np.zeros(len(x)), np.eye(len(x)))

    def at(self, x: FloatArray) -> ElasticFit:
        """The fit at x; which elements count and how much stays as it is at the first start."""
        return self.linearise(x).with_residuals_of(self.first)
