r"""solve: the local optimum of any LeastSquares problem, by a trust-region method or by IPOPT.

.. math:: \min_x V(x) \quad \text{s.t.} \quad x_{lower} \le x \le x_{upper}, \qquad \nabla^2 V \approx 2 J^T J
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.fit.problem.least_squares import Evaluation, LeastSquares
from elastid.fit.solve.ipopt import ipopt
from elastid.fit.solve.local_optimum import Ending, LocalOptimum, distance_to_optimum, held_by_bounds
from elastid.fit.solve.trust_region import CREEPING, trust_region

SolverName: TypeAlias = Literal["trust_region", "ipopt"]

# Distance to the stationary point, in standard deviations of the estimate, at which a solve stops: FINE for the
# estimate, ROUGH where another solve continues from there, NEAR where that one has another criterion or other lines,
# and so another optimum.
FINE = 1e-3
ROUGH = 0.1
NEAR = 3.0
# Below this distance a solve counts as converged, whatever made it stop; so does one that creeps far from any noise,
# where the model is what is wrong, and not the search.
CONVERGED = 1e-2
_Solver: TypeAlias = Callable[[LeastSquares, FloatArray, Evaluation, float, int], Ending]
_SOLVERS: dict[SolverName, _Solver] = {"trust_region": trust_region, "ipopt": ipopt}


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
        raise FitError(f"the cost is not finite at the start {problem.parameters.as_dict(x0)}; move the start")
    if len(x0) == 0:
        return LocalOptimum(x0, x0, beginning.cost, 0, True, "nothing is free")
    end = _SOLVERS[method](problem, x0, beginning, tolerance, max_iterations)
    off = distance_to_optimum(end.evaluation, problem.dof, held_by_bounds(problem, end.x, end.evaluation))
    ended = f"{end.status} after {end.iterations} iterations" if end.status else f"{end.iterations} iterations"
    message = f"{ended}, {off:.1e} standard deviations from the stationary point"
    converged = off < CONVERGED or end.status == CREEPING
    return LocalOptimum(x0, end.x, end.evaluation.cost, end.iterations, converged, message)
