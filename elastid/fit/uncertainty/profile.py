r"""Profile likelihood: V against one parameter, minimised over all others.

.. math:: V_p(x_i) = \min_{x_j, j \ne i} V(x), \qquad
          \{x_i : V_p(x_i) - V(\hat x) \le 1.96^2 c_i\}, \quad c_i = \mathrm{var}\, x_i / (A^{-1})_{ii}

An interval of 95 % that need not be symmetric in x, and is one-sided where the data only bound a parameter. c_i scales
to the stated variance, which holds correlated elements, model error and the floor beside the curvature of V.
(Raue et al., Bioinformatics 25, 2009, 1923.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.base.execution import Execution, in_order
from elastid.fit.problem.least_squares import Evaluation, LeastSquares
from elastid.fit.result import QUANTILE
from elastid.fit.solve.solvers import FINE, solve
from elastid.parameters import ParameterSet

# The search for an end of the interval: steps in standard deviations, each longer than the one before by a factor, at
# most so many; then bisection until the end is known within a tolerance in standard deviations.
FIRST_STEP = 2.0
STEP_GROWTH = 1.7
MAX_STEPS = 8
END_TOLERANCE = 0.02


@dataclass(frozen=True)
class Profile:
    """Of one parameter: the interval in x, infinite where the data give no bound, and the points (n,) of V_p found."""

    name: str
    interval: tuple[float, float]
    x: FloatArray
    cost: FloatArray


def profiles(
    problem: LeastSquares,
    x: FloatArray,
    variance: FloatArray,
    names: Sequence[str],
    execution: Execution | None = None,
) -> tuple[Profile, ...]:
    """The profiles of the named free parameters about the optimum x (n_x,); variance (n_x,) as the fit states it."""
    curvature = np.diag(np.linalg.pinv(problem.evaluate(x).hessian / 2, hermitian=True))
    free = problem.parameters.free_names
    work = _Work(problem, x, np.where(np.isfinite(variance), variance, curvature), curvature)
    places = [free.index(name) for name in names]
    found = (execution or Execution()).resumed(work, places, [f"profile-{name}" for name in names])
    return tuple(in_order(found))


@dataclass(frozen=True)
class HeldProblem:
    """A problem with one variable held: the same V of the others."""

    problem: LeastSquares
    place: int
    value: float

    @property
    def reduced(self) -> LeastSquares:
        """The problem of the others."""
        parameter = self.problem.parameters.free[self.place]
        parameters = ParameterSet(
            tuple(replace(p, free=False) if p.name == parameter.name else p for p in self._untied(parameter.name))
        )
        return LeastSquares(parameters, self.problem.n_residuals, self.evaluate, self.residual)

    def evaluate(self, rest: FloatArray) -> Evaluation:
        """V and its derivatives to the others."""
        here, keep = self.problem.evaluate(self.whole(rest)), self._keep
        return Evaluation(here.cost, here.gradient[keep], here.hessian[np.ix_(keep, keep)])

    def residual(self, rest: FloatArray) -> tuple[FloatArray, FloatArray]:
        """r and J of the others."""
        r, J = self.problem.residual(self.whole(rest))
        return r, J[:, self._keep]

    def whole(self, rest: FloatArray) -> FloatArray:
        """x with the held one in its place."""
        return np.insert(rest, self.place, self.value)

    @property
    def _keep(self) -> FloatArray:
        return np.delete(np.arange(len(self.problem.parameters.free)), self.place)

    def _untied(self, name: str) -> ParameterSet:
        """The parameters without those tied to the held one, which the whole problem moves."""
        every = self.problem.parameters
        return ParameterSet(tuple(p for p in every if p.tie is None or name not in (p.tie.to, p.tie.by)))


@dataclass(frozen=True)
class _Work:
    problem: LeastSquares
    x: FloatArray
    variance: FloatArray
    curvature: FloatArray

    def __call__(self, place: int) -> Profile:
        """Both ends of the interval of one parameter."""
        best = self.problem.evaluate(self.x).cost
        allowed = QUANTILE**2 * self.variance[place] / max(self.curvature[place], 1e-300)
        found: dict[float, float] = {float(self.x[place]): best}
        lower, upper = (bound[place] for bound in self.problem.parameters.x_bounds)
        low = self._end(place, -1, float(lower), best + allowed, found)
        high = self._end(place, 1, float(upper), best + allowed, found)
        points = sorted(found)
        name = self.problem.parameters.free_names[place]
        return Profile(name, (low, high), np.array(points), np.array([found[point] for point in points]))

    def _end(self, place: int, side: int, bound: float, level: float, found: dict[float, float]) -> float:
        """Where V_p crosses the level on one side; infinite where it does not before the bound."""
        here, deviation = float(self.x[place]), math.sqrt(float(self.variance[place]))
        rest, inside, step = np.delete(self.x, place), here, FIRST_STEP * deviation
        for _ in range(MAX_STEPS):
            outside = max(inside - step, bound) if side < 0 else min(inside + step, bound)
            rest, cost = self._lowest(place, outside, rest)
            found[outside] = cost
            if cost > level:
                break
            if outside == bound:
                return side * math.inf
            inside, step = outside, STEP_GROWTH * step
        else:
            return side * math.inf
        return self._crossing(place, (inside, outside), level, rest, found)

    def _crossing(
        self, place: int, ends: tuple[float, float], level: float, rest: FloatArray, found: dict[float, float]
    ) -> float:
        inside, outside = ends
        while abs(outside - inside) > END_TOLERANCE * math.sqrt(float(self.variance[place])):
            middle = 0.5 * (inside + outside)
            rest, found[middle] = self._lowest(place, middle, rest)
            inside, outside = (middle, outside) if found[middle] <= level else (inside, middle)
        return 0.5 * (inside + outside)

    def _lowest(self, place: int, value: float, rest: FloatArray) -> tuple[FloatArray, float]:
        held = HeldProblem(self.problem, place, value)
        try:
            end = solve(held.reduced, rest, FINE)
        except FitError:  # no model there
            return rest, math.inf
        return end.x, end.cost
