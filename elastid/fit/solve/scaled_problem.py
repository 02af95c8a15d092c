r"""A LeastSquares problem as IPOPT sees it, in variables of unit range.

.. math:: z = (x - x_0) / s, \qquad \min_z V / N
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.problem.least_squares import Evaluation, LeastSquares
from elastid.fit.solve.ending import distance_to_optimum, held_by_bounds


class ScaledProblem:
    """V / N and its derivatives in z, each x evaluated once; an error of a callback is kept in `error`.

    Bounded variables are scaled to unit range, so that a delay in seconds and ln k are alike to a solver.
    """

    def __init__(self, problem: LeastSquares, x0: FloatArray, beginning: Evaluation) -> None:
        lower, upper = problem.parameters.x_bounds
        bounded = np.isfinite(upper - lower)
        self.problem, self.x0 = problem, x0
        self.origin = np.where(bounded, lower, 0.0)
        self.scale = np.where(bounded, upper - lower, np.maximum(np.abs(x0), 1.0))
        self.weight = 1.0 / max(1, problem.n_residuals)
        self.error: BaseException | None = None
        self._cache = (x0.tobytes(), beginning)

    @property
    def z_bounds(self) -> tuple[FloatArray, FloatArray]:
        """The parameters' bounds (n_x,) in z."""
        lower, upper = self.problem.parameters.x_bounds
        return self.to_z(lower), self.to_z(upper)

    def to_x(self, z: FloatArray) -> FloatArray:
        """x (n_x,) of z."""
        return np.asarray(self.origin + self.scale * z)

    def to_z(self, x: FloatArray) -> FloatArray:
        """z (n_x,) of x."""
        return np.asarray((x - self.origin) / self.scale)

    def at(self, x: FloatArray) -> Evaluation:
        """The problem at x; cost, gradient and Hessian are asked for one after the other at the same x."""
        key = x.tobytes()
        if self._cache[0] != key:
            self._cache = (key, self.problem.evaluate(x))
        return self._cache[1]

    def distance(self, x: FloatArray) -> float:
        """From x to the stationary point, in standard deviations."""
        here = self.at(x)
        return distance_to_optimum(here, self.problem.dof, held_by_bounds(self.problem, x, here))

    def guarded(self, z: ca.DM) -> Evaluation:
        """The same for a callback, whose exceptions CasADi would swallow: the first is kept in `error`.

        From then on the solver sees a flat function, with which it ends at once and silently.
        """
        if self.error is None:
            try:
                return self.at(self.to_x(np.asarray(z).ravel()))
            except BaseException as error:
                self.error = error
        n = len(self.x0)
        return Evaluation(0.0, np.zeros(n), np.eye(n))
