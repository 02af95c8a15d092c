"""Many starts, since a local solve finds the global optimum only half of the time from 50 % off, and the hit rate.

It knows no robot: problems are solved one after the other, each from where the one before ended (log, then complex).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import FitError
from elastid.fit.problem import LeastSquares
from elastid.fit.result import Start
from elastid.fit.solvers import FINE, ROUGH, solve
from elastid.parallel import Progress, ordered, silent
from elastid.parameters import Parameter, ParameterSet

# Dampings and frictions are known worse than stiffnesses and inertias: their starts spread over factor^2.
SPREAD_OF_DAMPING = 2.0
# A linear parameter's starts spread over this share of its bounds to either side.
SPREAD_OF_LINEAR = 0.1
# A start is a hit if its V exceeds the best by less than this share of what one standard deviation costs.
HIT = 0.1


def spread(parameters: ParameterSet, starts: int, factor: float, seed: int) -> FloatArray:
    """Starts (starts, n_x) in x: the given one first, then a Latin hypercube, uniform in x, around it.

    Logarithmic parameters within `factor` of their start, dampings and frictions within factor^2, linear ones within a
    tenth of their bounds (unbounded ones stay), all within the bounds.
    """
    lower, upper = parameters.x_bounds
    n, n_x = starts - 1, len(parameters.free)
    rng = np.random.default_rng(seed)
    strata = np.array([rng.permutation(n) for _ in range(n_x)]).reshape(n_x, n).T
    cube = 2 * (strata + rng.random((n, n_x))) / max(n, 1) - 1
    reach = np.array([_reach(parameter, factor) for parameter in parameters.free])
    return np.vstack([parameters.x, np.clip(parameters.x + cube * reach, lower, upper)])


def _reach(parameter: Parameter, factor: float) -> float:
    if parameter.log:
        return math.log(factor) * (SPREAD_OF_DAMPING if parameter.unit == "N*m*s/rad" else 1.0)
    span = parameter.upper - parameter.lower
    return SPREAD_OF_LINEAR * span if math.isfinite(span) else 0.0


def multistart(
    problems: Sequence[LeastSquares], starts: FloatArray, jobs: int = 1, progress: Progress = silent
) -> tuple[tuple[Start, ...], int]:
    """All starts (starts, n_x) solved, best first, and how many of them reached the best cost of the last problem.

    The same for any number of jobs; with several, the problems must pickle.  Raises FitError where none succeeds.
    """
    ends = ordered(partial(_solve_in_turn, tuple(problems)), list(starts), jobs, progress)
    ranked = tuple(sorted(ends, key=lambda end: end.cost))
    best = ranked[0]
    if not np.isfinite(best.cost):
        raise FitError(f"none of the {len(ranked)} starts led anywhere; the first one ended so: {ends[0].message}")
    per_deviation = max(1.0, best.cost / max(problems[-1].dof, 1))
    return ranked, sum(end.cost <= best.cost + HIT * per_deviation for end in ranked)


def _solve_in_turn(problems: Sequence[LeastSquares], x_start: FloatArray) -> Start:
    x, iterations = x_start, 0
    try:
        for tolerance, problem in zip([ROUGH] * (len(problems) - 1) + [FINE], problems, strict=True):
            end = solve(problem, x, tolerance)
            x, iterations = end.x, iterations + end.iterations
    except FitError as error:
        return Start(x_start, x, math.inf, iterations, False, str(error))
    return Start(x_start, end.x, end.cost, iterations, end.converged, end.message)
