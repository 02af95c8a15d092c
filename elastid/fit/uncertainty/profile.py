r"""Profile likelihood: V against one parameter, minimised over all others.

.. math:: V_p(x_i) = \min_{x_j, j \ne i} V(x), \qquad
          \{x_i : V_p(x_i) - V(\hat x) \le 1.96^2 c_i\}, \quad c_i = \mathrm{var}\, x_i / (A^{-1})_{ii}

An interval of 95 % that need not be symmetric in x, and is one-sided where the data only bound a parameter. c_i scales
to the stated variance, which holds correlated elements, model error and the floor as well as the curvature of V.
(Raue et al., Bioinformatics 25, 2009, 1923.)

sqrt(V_p - V) is nearly linear in x_i, and its slope is known: dV_p / dx_i = g^T t with the tangent t of the path along
which the others follow, t_i = 1. Newton's method on it takes a few points to each end, and each point, begun on the
tangent of the one before, a few evaluations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.execution import Execution, in_order
from elastid.base.statistics import QUANTILE_95
from elastid.fit.problem.least_squares import Evaluation, LeastSquares
from elastid.fit.solve.local_optimum import Ending, held_by_bounds
from elastid.fit.solve.solvers import ROUGH
from elastid.fit.solve.trust_region import trust_region

# Where sqrt(V_p - V) is within this share of its level, the last step needs no evaluation; an end that is known within
# a share of its distance from the optimum needs no step.
LAST_STEP = 0.05
END_TOLERANCE = 0.005
# A step to an end is at most this many times as far from the optimum as the point before; points, at most.
MAX_GROWTH = 3.0
MAX_POINTS = 15
MAX_ITERATIONS = 60


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
    best = problem.evaluate(x)
    curvature = np.diag(np.linalg.pinv(best.hessian / 2, hermitian=True))
    free = problem.parameters.free_names
    stated = np.where(np.isfinite(variance), variance, curvature)
    work = _Work(problem, x, best, stated, QUANTILE_95**2 * stated / np.maximum(curvature, 1e-300))
    places = [free.index(name) for name in names]
    results = (execution or Execution()).resumed(work, places, [f"profile-{name}" for name in names])
    return tuple(in_order(results))


@dataclass(frozen=True)
class _Point:
    """x (n_x,) of a point of the path, V there, its slope along the path, and the tangent (n_x,)."""

    x: FloatArray
    cost: float
    slope: float
    tangent: FloatArray


@dataclass(frozen=True)
class _Work:
    """allowed (n_x,): by how much V_p rises to the ends of the interval."""

    problem: LeastSquares
    x: FloatArray
    best: Evaluation
    variance: FloatArray
    allowed: FloatArray

    def __call__(self, place: int) -> Profile:
        """Both ends of the interval of one parameter."""
        begin = self._point(place, Ending(self.x, self.best, "", 0))
        (low, below), (high, above) = self._end(place, -1, begin), self._end(place, 1, begin)
        costs = dict(sorted((float(point.x[place]), point.cost) for point in (begin, *below, *above)))
        name = self.problem.parameters.free_names[place]
        return Profile(name, (low, high), np.array(list(costs)), np.array(list(costs.values())))

    def _end(self, place: int, side: int, begin: _Point) -> tuple[float, list[_Point]]:
        """Where V_p crosses the level on one side, infinite where it does not before the bound, and the points."""
        optimum, bound = float(self.x[place]), float(self.problem.parameters.x_bounds[(side + 1) // 2][place])
        level = math.sqrt(self.allowed[place])
        inside, outside, last = 0.0, math.inf, begin
        points: list[_Point] = []
        at = optimum + side * QUANTILE_95 * math.sqrt(float(self.variance[place]))
        while len(points) < MAX_POINTS:
            at = min(at, bound) if side > 0 else max(at, bound)
            point = self._moved(place, last, at)
            points.append(point)
            rise = math.sqrt(max(0.0, point.cost - self.best.cost))
            if rise > level:
                outside = abs(at - optimum)
            elif at == bound:
                return side * math.inf, points
            else:
                inside = abs(at - optimum)
            slope = side * point.slope / (2 * rise) if 0 < rise < math.inf else 0.0
            reach = _next_reach(abs(at - optimum), (inside, outside), level - rise, slope)
            at = optimum + side * reach
            near = slope > 0 and abs(level - rise) < LAST_STEP * level
            if near or outside - inside < END_TOLERANCE * outside:
                return at, points
            last = point if math.isfinite(rise) else last
        return optimum + side * outside, points

    def _moved(self, place: int, last: _Point, value: float) -> _Point:
        """The point of the path with a value, begun on the tangent of another one."""
        x = np.clip(last.x + (value - last.x[place]) * last.tangent, *self.problem.parameters.x_bounds)
        x[place] = value
        beginning = self.problem.evaluate(x)
        if not math.isfinite(beginning.cost):
            x = np.where(self._is(place), value, last.x)
            beginning = self.problem.evaluate(x)
        if not math.isfinite(beginning.cost):  # no model there
            return _Point(x, math.inf, math.inf, last.tangent)
        end = trust_region(self.problem, x, beginning, ROUGH, MAX_ITERATIONS, self._is(place))
        return self._point(place, end)

    def _point(self, place: int, end: Ending) -> _Point:
        """With the tangent: the Gauss-Newton step of the others that no bound holds, for a unit step of this one."""
        H, tangent = end.evaluation.hessian, np.zeros(len(end.x))
        free = ~(self._is(place) | held_by_bounds(self.problem, end.x, end.evaluation))
        tangent[place] = 1.0
        tangent[free] = -np.linalg.lstsq(H[np.ix_(free, free)], H[free, place], rcond=1e-12)[0]
        return _Point(end.x, end.evaluation.cost, float(end.evaluation.gradient @ tangent), tangent)

    def _is(self, place: int) -> BoolArray:
        return np.asarray(np.arange(len(self.x)) == place)


def _next_reach(reach: float, ends: tuple[float, float], missing: float, slope: float) -> float:
    """The distance from the optimum at which sqrt(V_p - V) has its level: by its slope, or between the ends.

    reach: a distance where it misses so much.  ends: distances inside and outside of the interval.
    """
    inside, outside = ends
    step = reach + missing / slope if slope > 0 else math.inf
    if inside < step < min(outside, MAX_GROWTH * reach):
        return step
    return MAX_GROWTH * inside if math.isinf(outside) else 0.5 * (inside + outside)
