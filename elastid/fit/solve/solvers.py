r"""IPOPT or SQP with a Gauss-Newton Hessian for any LeastSquares problem; it knows neither robot nor response.

.. math:: \min_x V(x) / N \quad \text{s.t.} \quad x_{lower} \le x \le x_{upper}, \qquad \nabla^2 V \approx 2 J^T J
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from signal import SIGINT, getsignal, signal
from threading import current_thread, main_thread
from types import FrameType
from typing import Any, Literal, TypeAlias

import casadi as ca
import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import FitError
from elastid.fit.problem.least_squares import Evaluation, LeastSquares
from elastid.fit.result import LocalOptimum

Outputs: TypeAlias = list[ca.DM]
Method: TypeAlias = Literal["ipopt", "sqp"]

# Distance to the stationary point, in standard deviations of the estimate, at which a solve stops: FINE for the
# estimate, ROUGH where another solve goes on from there.
FINE = 1e-3
ROUGH = 0.1
# The same where it counts as converged, whatever made it stop.
CONVERGED = 1e-2

# The SQP changes a logarithmic parameter by this factor at most, a linear one by this share of its bounds, in so many
# steps, before it looks farther.
BOX = 2.0
BOX_OF_LINEAR = 0.2
STEPS_IN_BOX = 2

_STOPPED = "User_Requested_Stop"
_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "no_nlp_grad": True,  # would need the gradient of the multipliers, which nobody reads
    "calc_lam_p": False,
    "show_eval_warnings": False,
    "ipopt.sb": "yes",
    "ipopt.print_level": 0,
    "ipopt.acceptable_iter": 0,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.nlp_scaling_method": "none",  # V / N in unit variables is scaled already
    # Half the iterations of the monotone strategy, whose first barriers outweigh weakly determined parameters.
    "ipopt.mu_strategy": "adaptive",
}

# CasADi's SQP: a step of Gauss-Newton within the bounds by an active-set QP, then a line search.
_SQP_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "print_header": False,
    "print_iteration": False,
    "print_status": False,
    "no_nlp_grad": True,
    "calc_lam_p": False,
    "show_eval_warnings": False,
    "error_on_fail": False,
    "qpsol": "qrqp",
    "qpsol_options": {"print_header": False, "print_iter": False, "print_info": False, "error_on_fail": False},
    "min_step_size": 1e-14,
}


def solve(
    problem: LeastSquares,
    x0: FloatArray,
    tolerance: float = FINE,
    max_iterations: int = 200,
    method: Method = "ipopt",
) -> LocalOptimum:
    """The local optimum that the solver reaches from x0 (n_x,), and how it ended.

    Errors of the problem are raised as they are; Ctrl-C becomes KeyboardInterrupt. `converged` looks at the distance
    to the stationary point in standard deviations, which means the same for every problem, not at the solver's word.
    Raises FitError where the cost is not finite at x0.
    """
    x0 = np.clip(x0, *problem.parameters.x_bounds)
    evaluator = _Evaluator(problem, x0)
    beginning = evaluator.at(evaluator.to_x(evaluator.to_z(x0)))
    if not np.isfinite(beginning.cost):
        raise FitError(f"the cost is not finite at the start {problem.parameters.as_dict(x0)}; move the start")
    if len(x0) == 0:
        return LocalOptimum(x0, x0, beginning.cost, 0, True, "nothing is free")
    x, status, iterations = _run(evaluator, tolerance, max_iterations, method)
    ending, off = evaluator.at(x), evaluator.distance(x)
    ended = f"{iterations} iterations" if status == _STOPPED else f"{status} after {iterations} iterations"
    message = f"{ended}, {off:.1e} standard deviations from the stationary point"
    return LocalOptimum(x0, x, ending.cost, iterations, off < CONVERGED, message)


def distance_to_optimum(ending: Evaluation, dof: int, pushed_out: BoolArray) -> float:
    """How far the stationary point is, one Gauss-Newton step, in standard deviations of the estimate.

    Over the variables that no bound holds back; inf where the cost is not finite.
    """
    if not np.isfinite(ending.cost):
        return np.inf
    free = ~pushed_out
    step = np.zeros(len(free))
    step[free] = np.linalg.lstsq(ending.hessian[np.ix_(free, free)], ending.gradient[free], rcond=1e-12)[0]
    return distance(step, ending, dof)


def distance(step: FloatArray, ending: Evaluation, dof: int) -> float:
    r"""Length of a step (n_x,) in standard deviations, \delta^2 = dx^T J^T J dx / max(1, V / dof)."""
    information = 0.5 * float(step @ ending.hessian @ step)
    return float(np.sqrt(max(0.0, information) / max(1.0, ending.cost / max(dof, 1))))


def _pushed_out(problem: LeastSquares, x: FloatArray, ending: Evaluation) -> BoolArray:
    """Variables at a bound that the cost would rather have beyond it."""
    lower, upper = problem.parameters.x_bounds
    reach = 1e-6 * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    below, above = x <= lower + reach, x >= upper - reach
    held: BoolArray = (below & (ending.gradient > 0)) | (above & (ending.gradient < 0))
    return held


def _run(evaluator: _Evaluator, tolerance: float, max_iterations: int, method: Method) -> tuple[FloatArray, str, int]:
    """x, the solver's status and its number of iterations; errors kept by the evaluator are raised here."""
    with _interrupt_kept(evaluator):
        callbacks = _callbacks(evaluator, tolerance, method)
        answer, status, iterations = _SOLVERS[method](evaluator, callbacks, tolerance, max_iterations)
    if evaluator.error is not None:
        raise evaluator.error
    # Ctrl-C inside IPOPT does not raise; it returns this status and an x that is no solution.
    if status == "NonIpopt_Exception_Thrown":
        raise KeyboardInterrupt
    x = np.clip(evaluator.to_x(answer), *evaluator.problem.parameters.x_bounds)
    return x, status, iterations


def _ipopt(
    evaluator: _Evaluator, callbacks: _Callbacks, tolerance: float, max_iterations: int
) -> tuple[FloatArray, str, int]:
    options = _OPTIONS | {"grad_f": callbacks.gradient, "hess_lag": callbacks.hessian}
    options |= {"iteration_callback": callbacks.stop, "ipopt.max_iter": max_iterations}
    options |= {"ipopt.tol": 1e-3 * tolerance * evaluator.weight}
    return _answer(evaluator, ca.nlpsol("fit", "ipopt", callbacks.objective, options))


def _sqp(
    evaluator: _Evaluator, callbacks: _Callbacks, tolerance: float, max_iterations: int
) -> tuple[FloatArray, str, int]:
    """Box after box about where the one before ended: a step of Gauss-Newton over decades is believed by nobody."""
    options = _SQP_OPTIONS | {"jac_fg": callbacks.gradient, "hess_lag": callbacks.hessian}
    options |= {"iteration_callback": callbacks.stop, "max_iter": min(STEPS_IN_BOX, max_iterations)}
    options |= {"tol_du": 1e-3 * tolerance * evaluator.weight}
    solver = ca.nlpsol("fit", "sqpmethod", callbacks.objective, options)
    lower, upper = (evaluator.to_z(bound) for bound in evaluator.problem.parameters.x_bounds)
    z, used, reach = evaluator.to_z(evaluator.x0), 0, evaluator.reach
    while True:
        box = np.maximum(lower, z - reach), np.minimum(upper, z + reach)
        ended, status, steps = _answer(evaluator, solver, z, box)
        used += max(steps, 1)
        ended = np.clip(ended, lower, upper)
        moved, z = bool(np.any(ended != z)), ended
        if evaluator.error is not None or status == _STOPPED or used >= max_iterations or not moved:
            return z, status, used


def _answer(
    evaluator: _Evaluator,
    solver: ca.Function,
    z: FloatArray | None = None,
    bounds: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, str, int]:
    """From z or the start, within the parameters' bounds or narrower ones: z, the status and the iterations."""
    lower, upper = bounds or tuple(evaluator.to_z(bound) for bound in evaluator.problem.parameters.x_bounds)
    answer = solver(x0=evaluator.to_z(evaluator.x0) if z is None else z, lbx=lower, ubx=upper)
    stats = solver.stats()
    return np.asarray(answer["x"]).ravel(), str(stats["return_status"]), int(stats["iter_count"])


_SOLVERS = {"ipopt": _ipopt, "sqp": _sqp}


@contextmanager
def _interrupt_kept(evaluator: _Evaluator) -> Iterator[None]:
    """Ctrl-C as an error that the evaluator keeps: raised amid CasADi and its callbacks it would be swallowed."""
    before = getsignal(SIGINT)
    if current_thread() is not main_thread() or not callable(before):
        yield
        return

    def keep(number: int, frame: FrameType | None) -> None:
        evaluator.error = KeyboardInterrupt()

    signal(SIGINT, keep)
    try:
        yield
    finally:
        signal(SIGINT, before)


class _Evaluator:
    """V / N and its derivatives in scaled variables, z = (x - origin) / scale, each x evaluated once.

    Bounded variables are scaled to unit range, so that a delay in seconds and ln k are alike to IPOPT.
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
    def reach(self) -> FloatArray:
        """How far the SQP's steps go at once (n_x,), in z."""
        log = np.array([parameter.log for parameter in self.problem.parameters.free])
        bounded = np.isfinite(np.subtract(*self.problem.parameters.x_bounds))
        far = np.where(log, math.log(BOX) / self.scale, np.where(bounded, BOX_OF_LINEAR, np.inf))
        return np.asarray(far, dtype=np.float64)

    def to_x(self, z: FloatArray) -> FloatArray:
        x: FloatArray = self.origin + self.scale * z
        return x

    def to_z(self, x: FloatArray) -> FloatArray:
        z: FloatArray = (x - self.origin) / self.scale
        return z

    def at(self, x: FloatArray) -> Evaluation:
        """The problem at x; cost, gradient and Hessian are asked for one after the other at the same x."""
        key = x.tobytes()
        if self._cache is None or self._cache[0] != key:
            self._cache = (key, self.problem.evaluate(x))
        return self._cache[1]

    def distance(self, x: FloatArray) -> float:
        """From x to the stationary point, in standard deviations."""
        here = self.at(x)
        return distance_to_optimum(here, self.problem.dof, _pushed_out(self.problem, x, here))

    def guarded(self, z: ca.DM) -> Evaluation:
        """The same for a callback, in which CasADi would swallow an exception: it is kept for `_run`.

        From then on the solver sees a flat function, with which it ends at once and without a word.
        """
        if self.error is None:
            try:
                return self.at(self.to_x(np.asarray(z).ravel()))
            except BaseException as error:
                self.error = error
        n = len(self.x0)
        return Evaluation(0.0, np.zeros(n), np.eye(n))


class _Callback(ca.Callback):
    """A CasADi function from Python: names and sparsities in and out, and what to evaluate."""

    def __init__(
        self,
        name: str,
        inputs: Sequence[tuple[str, ca.Sparsity]],
        outputs: Sequence[tuple[str, ca.Sparsity]],
        function: Callable[[Sequence[ca.DM]], Outputs],
    ) -> None:
        ca.Callback.__init__(self)
        self.inputs, self.outputs, self.function = inputs, outputs, function
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.inputs)

    def get_n_out(self) -> int:
        return len(self.outputs)

    def get_name_in(self, i: int) -> str:
        return self.inputs[i][0]

    def get_name_out(self, i: int) -> str:
        return self.outputs[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self.inputs[i][1]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self.outputs[i][1]

    def eval(self, arguments: Sequence[ca.DM]) -> Outputs:
        return self.function(arguments)


@dataclass(frozen=True, eq=False)
class _Callbacks:
    """What a solver calls; kept together, since CasADi deletes a Callback that goes out of scope."""

    objective: _Callback
    gradient: _Callback
    hessian: _Callback
    stop: _Callback


def _callbacks(evaluator: _Evaluator, tolerance: float, method: Method) -> _Callbacks:
    """Objective, gradient, Hessian of the Lagrangian and when to stop.

    IPOPT wants the upper triangle of the Hessian and the gradient as a column, sqpmethod the whole matrix and a row.
    """
    n = len(evaluator.x0)
    vector, scalar, none = ca.Sparsity.dense(n, 1), ca.Sparsity.dense(1, 1), ca.Sparsity(0, 0)
    no_rows = ca.Sparsity(0, 1)
    upper, rows_of_columns = ca.Sparsity.upper(n), np.tril_indices(n)
    point = [("x", vector), ("p", none)]
    multipliers = [("lam_f", scalar), ("lam_g", no_rows)]
    scale, weight, triangular = evaluator.scale, evaluator.weight, method == "ipopt"

    def objective(arguments: Sequence[ca.DM]) -> Outputs:
        return [ca.DM(weight * evaluator.guarded(arguments[0]).cost), ca.DM(0, 1)]

    def gradient(arguments: Sequence[ca.DM]) -> Outputs:
        here = evaluator.guarded(arguments[0])
        slope = weight * scale * here.gradient
        if triangular:
            return [ca.DM(weight * here.cost), ca.DM(slope)]
        return [ca.DM(weight * here.cost), ca.DM(slope[None, :]), ca.DM(0, 1), ca.DM(0, n)]

    def hessian(arguments: Sequence[ca.DM]) -> Outputs:
        here = evaluator.guarded(arguments[0])
        H = float(arguments[2]) * weight * np.outer(scale, scale) * here.hessian
        # The upper triangle column by column is the lower one row by row.
        return [ca.DM(upper, H[rows_of_columns]) if triangular else ca.DM(H)]

    def stop(arguments: Sequence[ca.DM]) -> Outputs:
        evaluator.guarded(arguments[0])
        x = evaluator.to_x(np.asarray(arguments[0]).ravel())
        return [ca.DM(evaluator.error is not None or evaluator.distance(x) < tolerance)]

    row = [("f", scalar), ("jac_f", ca.Sparsity.dense(1, n)), ("g", no_rows), ("jac_g", ca.Sparsity(0, n))]
    column = [("f", scalar), ("grad_f_x", vector)]
    answer = [("x", vector), ("f", scalar), ("g", none), ("lam_x", vector), ("lam_g", none), ("lam_p", none)]
    whole = upper if triangular else ca.Sparsity.dense(n, n)
    return _Callbacks(
        _Callback("objective", point, [("f", scalar), ("g", no_rows)], objective),
        _Callback("nlp_grad_f" if triangular else "nlp_jac_fg", point, column if triangular else row, gradient),
        _Callback("nlp_hess_l", point + multipliers, [("hess_gamma_x_x", whole)], hessian),
        _Callback("stop", answer, [("ret", scalar)], stop),
    )
