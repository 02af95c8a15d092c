r"""solve: the local optimum of any LeastSquares problem by IPOPT or an SQP with a Gauss-Newton Hessian.

.. math:: \min_x V(x) / N \quad \text{s.t.} \quad x_{lower} \le x \le x_{upper}, \qquad \nabla^2 V \approx 2 J^T J
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from signal import SIGINT, getsignal, signal
from threading import current_thread, main_thread
from types import FrameType
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.fit.problem.least_squares import LeastSquares
from elastid.fit.result import LocalOptimum
from elastid.fit.solve.callbacks import STOPPED, Answer
from elastid.fit.solve.ipopt import FOREIGN_EXCEPTION, ipopt
from elastid.fit.solve.scaled_problem import ScaledProblem
from elastid.fit.solve.sqp import sqp

SolverName: TypeAlias = Literal["ipopt", "sqp"]

# Distance to the stationary point, in standard deviations of the estimate, at which a solve stops: FINE for the
# estimate, ROUGH where another solve continues from there.
FINE = 1e-3
ROUGH = 0.1
# Below this distance a solve counts as converged, whatever made it stop.
CONVERGED = 1e-2
_SOLVERS: dict[SolverName, Callable[[ScaledProblem, float, int], Answer]] = {"ipopt": ipopt, "sqp": sqp}


def solve(
    problem: LeastSquares,
    x0: FloatArray,
    tolerance: float = FINE,
    max_iterations: int = 200,
    method: SolverName = "ipopt",
) -> LocalOptimum:
    """The local optimum that the solver reaches from x0 (n_x,), and how it ended.

    Errors of the problem are raised as they are; Ctrl-C becomes KeyboardInterrupt.  converged: by the distance to the
    stationary point, which means the same for every problem, not by the solver's status.
    Raises FitError where the cost is not finite at x0.
    """
    x0 = np.clip(x0, *problem.parameters.x_bounds)
    scaled = ScaledProblem(problem, x0)
    beginning = scaled.at(scaled.to_x(scaled.to_z(x0)))
    if not np.isfinite(beginning.cost):
        raise FitError(f"the cost is not finite at the start {problem.parameters.as_dict(x0)}; move the start")
    if len(x0) == 0:
        return LocalOptimum(x0, x0, beginning.cost, 0, True, "nothing is free")
    with _interrupt_kept(scaled):
        z, status, iterations = _SOLVERS[method](scaled, tolerance, max_iterations)
    if scaled.error is not None:
        raise scaled.error
    # Ctrl-C inside IPOPT does not raise; it returns this status and an x that is no solution.
    if status == FOREIGN_EXCEPTION:
        raise KeyboardInterrupt
    x = np.clip(scaled.to_x(z), *problem.parameters.x_bounds)
    ending, off = scaled.at(x), scaled.distance(x)
    ended = f"{iterations} iterations" if status == STOPPED else f"{status} after {iterations} iterations"
    message = f"{ended}, {off:.1e} standard deviations from the stationary point"
    return LocalOptimum(x0, x, ending.cost, iterations, off < CONVERGED, message)


@contextmanager
def _interrupt_kept(scaled: ScaledProblem) -> Iterator[None]:
    """Ctrl-C as an error that the problem keeps: raised within CasADi and its callbacks it would be swallowed."""
    before = getsignal(SIGINT)
    if current_thread() is not main_thread() or not callable(before):
        yield
        return

    def keep(number: int, frame: FrameType | None) -> None:
        scaled.error = KeyboardInterrupt()

    signal(SIGINT, keep)
    try:
        yield
    finally:
        signal(SIGINT, before)
