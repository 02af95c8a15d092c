r"""A LeastSquares problem as a solver sees it, in variables of unit range, and the distance to its stationary point.

.. math:: z = (x - x_0) / s, \qquad \min_z V / N

    delta^2 = dx^T J^T J dx / max(1, V / dof),   dx the Gauss-Newton step of the variables that no bound holds
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.fit.problem.least_squares import Evaluation, LeastSquares

# The SQP changes a logarithmic parameter by this factor at most, a linear one by this share of its bounds, before it
# looks farther.
MAX_FACTOR = 2.0
MAX_SHARE_OF_BOUNDS = 0.2
# x within this share of its bounds from one of them is at it.
AT_BOUND = 1e-6


def distance(step: FloatArray, ending: Evaluation, dof: int) -> float:
    """Length delta of a step dx (n_x,) in standard deviations of the estimate."""
    information = 0.5 * float(step @ ending.hessian @ step)
    return float(np.sqrt(max(0.0, information) / max(1.0, ending.cost / max(dof, 1))))


def distance_to_optimum(ending: Evaluation, dof: int, held: BoolArray) -> float:
    """How far the stationary point is, one Gauss-Newton step, in standard deviations of the estimate.

    held (n_x,): variables that a bound holds, which take no step.  inf where the cost is not finite.
    """
    if not np.isfinite(ending.cost):
        return np.inf
    free = ~held
    step = np.zeros(len(free))
    step[free] = np.linalg.lstsq(ending.hessian[np.ix_(free, free)], ending.gradient[free], rcond=1e-12)[0]
    return distance(step, ending, dof)


def held_by_bounds(problem: LeastSquares, x: FloatArray, ending: Evaluation) -> BoolArray:
    """Variables (n_x,) at a bound beyond which the cost falls."""
    lower, upper = problem.parameters.x_bounds
    reach = AT_BOUND * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    below, above = x <= lower + reach, x >= upper - reach
    return np.asarray((below & (ending.gradient > 0)) | (above & (ending.gradient < 0)))


class ScaledProblem:
    """V / N and its derivatives in z, each x evaluated once; an error of a callback is kept in `error`.

    Bounded variables are scaled to unit range, so that a delay in seconds and ln k are alike to a solver.
    """

    def __init__(self, problem: LeastSquares, x0: FloatArray) -> None:
        lower, upper = problem.parameters.x_bounds
        bounded = np.isfinite(upper - lower)
        self.problem, self.x0 = problem, x0
        self.origin = np.where(bounded, lower, 0.0)
        self.scale = np.where(bounded, upper - lower, np.maximum(np.abs(x0), 1.0))
        self.weight = 1.0 / max(1, problem.n_residuals)
        self.error: BaseException | None = None
        self._cache: tuple[bytes, Evaluation] | None = None

    @property
    def z_bounds(self) -> tuple[FloatArray, FloatArray]:
        """The parameters' bounds (n_x,) in z."""
        lower, upper = self.problem.parameters.x_bounds
        return self.to_z(lower), self.to_z(upper)

    @property
    def reach(self) -> FloatArray:
        """The longest steps of the SQP (n_x,), in z."""
        log = np.array([parameter.log for parameter in self.problem.parameters.free])
        bounded = np.isfinite(np.subtract(*self.problem.parameters.x_bounds))
        far = np.where(log, math.log(MAX_FACTOR) / self.scale, np.where(bounded, MAX_SHARE_OF_BOUNDS, np.inf))
        return np.asarray(far, dtype=np.float64)

    def to_x(self, z: FloatArray) -> FloatArray:
        """x (n_x,) of z."""
        return np.asarray(self.origin + self.scale * z)

    def to_z(self, x: FloatArray) -> FloatArray:
        """z (n_x,) of x."""
        return np.asarray((x - self.origin) / self.scale)

    def at(self, x: FloatArray) -> Evaluation:
        """The problem at x; cost, gradient and Hessian are asked for one after the other at the same x."""
        key = x.tobytes()
        if self._cache is None or self._cache[0] != key:
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
