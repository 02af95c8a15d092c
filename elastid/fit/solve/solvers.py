r"""Local solve and multistart of any LeastSquares problem, by a trust-region method or by IPOPT.

.. math:: \min_x V(x) \quad \text{s.t.} \quad x_{lower} \le x \le x_{upper}, \qquad \nabla^2 V \approx 2 J^T J

From 50 % off a local solve finds the global optimum only half of the time: many starts are solved, each problem after
the other from where the one before ended (log, then complex), and those that reached the best cost are counted as hits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.base.execution import Execution, in_order
from elastid.fit.problem.least_squares import (
    Ending,
    LeastSquares,
    LocalOptimum,
    distance,
    distance_to_optimum,
    held_by_bounds,
    is_far_from_noise,
)
from elastid.fit.solve.ipopt import ipopt
from elastid.fit.solve.trust_region import CREEPING, trust_region
from elastid.parameters import Parameters

SolverName: TypeAlias = Literal["trust_region", "ipopt"]

# Distance to the stationary point, in standard deviations of the estimate, at which a solve stops: FINE for the
# estimate, ROUGH where another solve continues from there, NEAR where that one has another criterion or other lines,
# and so another optimum.
FINE, ROUGH, NEAR = 1e-3, 0.1, 3.0
# Rough ends at this distance from each other, and less, are near one stationary point.
SAME = 3 * ROUGH
_SOLVERS: dict[SolverName, Callable[..., Ending]] = {"trust_region": trust_region, "ipopt": ipopt}


def solve(
    problem: LeastSquares,
    x0: FloatArray,
    tolerance: float = FINE,
    max_iterations: int = 200,
    method: SolverName = "trust_region",
) -> LocalOptimum:
    """The local optimum that the solver reaches from x0 (n_x,), and how it ended.

    Errors of the problem are raised as they are; Ctrl-C becomes KeyboardInterrupt.  converged: by the distance to the
    stationary point, which means the same for every problem, not by the solver's status.
    Raises FitError where the cost is not finite at x0.
    """
    x0 = np.clip(x0, *problem.parameters.x_bounds)
    beginning = problem.evaluate(x0)
    if not np.isfinite(beginning.cost):
        raise FitError(
            "fit/no-start", f"the cost is not finite at the start {problem.parameters.as_dict(x0)}; move the start"
        )
    if len(x0) == 0:
        return LocalOptimum(x0, x0, beginning.cost, 0, True, "nothing is free")
    end = _SOLVERS[method](problem, x0, beginning, tolerance, max_iterations)
    off = distance_to_optimum(end.evaluation, problem.dof, held_by_bounds(problem, end.x, end.evaluation))
    ended = f"{end.status} after {end.iterations} iterations" if end.status else f"{end.iterations} iterations"
    message = f"{ended}, {off:.1e} standard deviations from the stationary point"
    # A tenth of a deviation moves no interval. One that creeps far from any noise has converged, too: the model is
    # wrong, and not the search.
    converged = off < ROUGH or end.status == CREEPING
    return LocalOptimum(x0, end.x, end.evaluation.cost, end.iterations, converged, message)


# A start is a hit if its V exceeds the best by less than this share of what one standard deviation costs.
MAX_HIT_EXCESS = 0.1
ROUGH_ITERATIONS = 60
DAMPING_UNITS = ("N*m*s/rad", "N*s/m")  # of frictions, too


def spread(parameters: Parameters, starts: int, factor: float, seed: int) -> FloatArray:
    """Starts (starts, n_x) in x: the given one first, then a Latin hypercube, uniform in x, around it.

    Logarithmic parameters within `factor` of their start, dampings and frictions, which are known less well, within
    factor^2, linear ones within a tenth of their bounds (unbounded ones stay), all within the bounds.
    """
    lower, upper = parameters.x_bounds
    n, n_x = starts - 1, len(parameters.free)
    rng = np.random.default_rng(seed)
    strata = np.array([rng.permutation(n) for _ in range(n_x)]).reshape(n_x, n).T
    cube = 2 * (strata + rng.random((n, n_x))) / max(n, 1) - 1
    reach = [
        math.log(factor) * (2 if p.unit in DAMPING_UNITS else 1) if p.log else 0.1 * (p.upper - p.lower)
        for p in parameters.free
    ]
    step = cube * np.where(np.isfinite(reach), reach, 0.0)
    return np.vstack([parameters.x, np.clip(parameters.x + step, lower, upper)])


class Interrupted(KeyboardInterrupt):
    """Ctrl-C in the middle of many starts or after them; ends: of those that did not fail, best first."""

    def __init__(self, ends: Iterable[LocalOptimum]) -> None:
        self.ends = tuple(sorted((end for end in ends if math.isfinite(end.cost)), key=lambda end: end.cost))
        super().__init__(f"interrupted after {len(self.ends)} starts")


def multistart(
    problems: Sequence[LeastSquares],
    starts: FloatArray,
    method: SolverName = "trust_region",
    execution: Execution | None = None,
) -> tuple[tuple[LocalOptimum, ...], int]:
    """All starts (starts, n_x) solved, best first, and how many of them reached the best cost of the last problem.

    Every start is solved roughly; of those that can still reach the best cost one in each place is then solved finely,
    and the others end where they are, with a message. The same under any execution; for several processes the problems
    must pickle.
    Raises FitError where none succeeds, Interrupted on Ctrl-C.
    """
    execution = execution or Execution()
    begin = partial(_begin, tuple(problems), method)
    rough = _solved(begin, {f"start-{i}": x for i, x in enumerate(starts)}, execution)
    best = min(end.cost for end in rough)
    if not np.isfinite(best):
        raise FitError("fit/no-start", f"all {len(rough)} starts failed; the first with: {rough[0].message}")
    reach = best + _deviation(best, problems[-1])
    # One that ran out of iterations is continued where it is near enough.
    hopeful = [i for i, end in enumerate(rough) if end.cost <= reach or (not end.converged and end.cost <= 30 * best)]
    polish, leader = partial(_polish, problems[-1], method), _leaders(problems[-1], rough, hopeful)
    leaders = list(dict.fromkeys(leader.values()))
    try:
        polished = _solved(polish, {f"polished-{i}": rough[i] for i in leaders}, execution.quiet)
    except Interrupted:
        raise Interrupted(rough) from None
    of_leader = dict(zip(leaders, polished, strict=True))
    ends = dict(enumerate(rough))
    for i, first in leader.items():
        further = of_leader[first].iterations - rough[first].iterations
        ends[i] = replace(of_leader[first], x_start=rough[i].x_start, iterations=rough[i].iterations + further)
    for i, end in enumerate(rough):
        if i not in hopeful and math.isfinite(end.cost):
            ends[i] = replace(end, message=f"stopped early, far above the best cost; {end.message}")
    ranked = tuple(sorted((ends[i] for i in range(len(starts))), key=lambda end: end.cost))
    best = ranked[0].cost
    hit = best + MAX_HIT_EXCESS * _deviation(best, problems[-1])
    return ranked, sum(end.cost <= hit for end in ranked)


def _leaders(problem: LeastSquares, rough: Sequence[LocalOptimum], hopeful: Sequence[int]) -> dict[int, int]:
    """For each hopeful start the lowest one that ended in the same place, so that one of them is solved finely."""
    lowest = min(hopeful, key=lambda i: rough[i].cost)
    metric, leader = problem.evaluate(rough[lowest].x), dict[int, int]()
    for i in sorted(hopeful, key=lambda i: rough[i].cost):
        others = (j for j in leader if leader[j] == j)
        same = (j for j in others if distance(rough[i].x - rough[j].x, metric, problem.dof) < SAME)
        leader[i] = next(same, i)
    return leader


def _deviation(cost: float, problem: LeastSquares) -> float:
    """By how much V rises at one standard deviation from its minimum."""
    return max(1.0, cost / max(problem.dof, 1))


def _solved(
    function: Callable[[Any], LocalOptimum], items: Mapping[str, Any], execution: Execution
) -> list[LocalOptimum]:
    """function of each item in order; on Ctrl-C what is done is kept in the exception."""
    try:
        return in_order(execution.resumed(function, list(items.values()), list(items)))
    except KeyboardInterrupt:
        raise Interrupted(execution.checkpoint[name] for name in items if name in execution.checkpoint) from None


def _begin(problems: tuple[LeastSquares, ...], method: SolverName, x_start: FloatArray) -> LocalOptimum:
    x, iterations = x_start, 0
    try:
        for problem in problems:
            end = solve(problem, x, ROUGH if problem is problems[-1] else NEAR, ROUGH_ITERATIONS, method)
            x, iterations = end.x, iterations + end.iterations
    except FitError as error:
        return LocalOptimum(x_start, x, math.inf, iterations, False, str(error))
    return replace(end, x_start=x_start, iterations=iterations)


def _polish(problem: LeastSquares, method: SolverName, rough: LocalOptimum) -> LocalOptimum:
    """A rough end taken to the optimum; far from any noise it stays, since it is near enough."""
    if is_far_from_noise(rough.cost, problem.dof):
        return rough
    try:
        end = solve(problem, rough.x, FINE, method=method)
    except FitError as error:
        return replace(rough, cost=math.inf, converged=False, message=str(error))
    return replace(end, x_start=rough.x_start, iterations=rough.iterations + end.iterations)
