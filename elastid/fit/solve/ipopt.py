r"""IPOPT with a Gauss-Newton Hessian, through CasADi (Wachter and Biegler, Mathematical Programming 106, 2006).

.. math:: \min_z V(z) / N \quad \text{s.t.} \quad z_{lower} \le z \le z_{upper}, \qquad \nabla^2 V \approx 2 J^T J
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from signal import SIGINT, getsignal, signal
from threading import current_thread, main_thread
from types import FrameType
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.problem.least_squares import Ending, Evaluation, LeastSquares, distance_to_optimum, held_by_bounds

# The return status of an iteration callback that ends it, and that of an exception none of IPOPT's own, such as Ctrl-C.
_STOPPED, _FOREIGN_EXCEPTION = "User_Requested_Stop", "NonIpopt_Exception_Thrown"
_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "no_nlp_grad": True,  # would need the gradient of the multipliers, which is not read
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


def ipopt(
    problem: LeastSquares, x0: FloatArray, beginning: Evaluation, tolerance: float, max_iterations: int
) -> Ending:
    """Where IPOPT ends from x0 (n_x,), within its bounds; beginning: the problem there.

    Errors of the problem are raised as they are; Ctrl-C becomes KeyboardInterrupt.
    """
    scaled = ScaledProblem(problem, x0, beginning)
    called = _objective(scaled), _gradient(scaled), _hessian(scaled), _stop(scaled, tolerance)
    options = _OPTIONS | {"grad_f": called[1], "hess_lag": called[2], "iteration_callback": called[3]}
    options |= {"ipopt.max_iter": max_iterations, "ipopt.tol": 1e-3 * tolerance * scaled.weight}
    solver = ca.nlpsol("fit", "ipopt", called[0], options)
    lower, upper = scaled.z_bounds
    with _interrupt_kept(scaled):
        solution = solver(x0=scaled.to_z(x0), lbx=lower, ubx=upper)
    stats = solver.stats()
    if scaled.error is not None:
        raise scaled.error
    # Ctrl-C inside IPOPT does not raise; it returns this status and an x that is no solution.
    if stats["return_status"] == _FOREIGN_EXCEPTION:
        raise KeyboardInterrupt
    x = np.clip(scaled.to_x(np.asarray(solution["x"]).ravel()), *problem.parameters.x_bounds)
    status = "" if stats["return_status"] == _STOPPED else str(stats["return_status"])
    return Ending(x, scaled.at(x), status, int(stats["iter_count"]))


def _point(n: int) -> Signature:
    """Arguments of the objective and its gradient."""
    return [("x", vector(n)), ("p", ca.Sparsity(0, 0))]


def _objective(scaled: ScaledProblem) -> Callback:
    """V / N, and no constraints."""

    def evaluate(arguments: Sequence[ca.DM]) -> Outputs:
        return [ca.DM(scaled.weight * scaled.guarded(arguments[0]).cost), ca.DM(0, 1)]

    return Callback("objective", _point(len(scaled.x0)), [("f", vector(1)), ("g", ca.Sparsity(0, 1))], evaluate)


def _gradient(scaled: ScaledProblem) -> Callback:
    """V / N and its gradient as a column."""
    n = len(scaled.x0)

    def evaluate(arguments: Sequence[ca.DM]) -> Outputs:
        evaluation = scaled.guarded(arguments[0])
        return [ca.DM(scaled.weight * evaluation.cost), ca.DM(scaled.weight * scaled.scale * evaluation.gradient)]

    return Callback("nlp_grad_f", _point(n), [("f", vector(1)), ("grad_f_x", vector(n))], evaluate)


def _hessian(scaled: ScaledProblem) -> Callback:
    """The upper triangle of the Hessian of the Lagrangian, Gauss-Newton's in z times the multiplier of V / N."""
    n = len(scaled.x0)
    upper, rows_of_columns = ca.Sparsity.upper(n), np.tril_indices(n)
    weights = scaled.weight * np.outer(scaled.scale, scaled.scale)

    def evaluate(arguments: Sequence[ca.DM]) -> Outputs:
        hessian = float(arguments[2]) * weights * scaled.guarded(arguments[0]).hessian
        # The upper triangle column by column is the lower one row by row.
        return [ca.DM(upper, hessian[rows_of_columns])]

    inputs = [*_point(n), ("lam_f", vector(1)), ("lam_g", ca.Sparsity(0, 1))]
    return Callback("nlp_hess_l", inputs, [("hess_gamma_x_x", upper)], evaluate)


def _stop(scaled: ScaledProblem, tolerance: float) -> Callback:
    """True to end: after an error, or nearer to the stationary point than the tolerance."""
    n, none = vector(len(scaled.x0)), ca.Sparsity(0, 0)
    state = [("x", n), ("f", vector(1)), ("g", none), ("lam_x", n), ("lam_g", none), ("lam_p", none)]

    def evaluate(arguments: Sequence[ca.DM]) -> Outputs:
        scaled.guarded(arguments[0])
        x = scaled.to_x(np.asarray(arguments[0]).ravel())
        return [ca.DM(scaled.error is not None or scaled.distance(x) < tolerance)]

    return Callback("stop", state, [("ret", vector(1))], evaluate)


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


class ScaledProblem:
    """V / N and its derivatives in z, each x evaluated once; an error of a callback is kept in `error`.

    Bounded variables are scaled to unit range, so that a delay in seconds and ln k have the same size for a solver.
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
        evaluation = self.at(x)
        return distance_to_optimum(evaluation, self.problem.dof, held_by_bounds(self.problem, x, evaluation))

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


Outputs: TypeAlias = list[ca.DM]
# A name and a sparsity for each argument or result.
Signature: TypeAlias = list[tuple[str, ca.Sparsity]]


class Callback(ca.Callback):
    """A CasADi function that evaluates a Python function; CasADi deletes one that goes out of scope."""

    def __init__(
        self, name: str, inputs: Signature, outputs: Signature, function: Callable[[Sequence[ca.DM]], Outputs]
    ) -> None:
        ca.Callback.__init__(self)
        self.inputs, self.outputs, self.function = inputs, outputs, function
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Number of arguments."""
        return len(self.inputs)

    def get_n_out(self) -> int:
        """Number of results."""
        return len(self.outputs)

    def get_name_in(self, i: int) -> str:
        """Name of an argument."""
        return self.inputs[i][0]

    def get_name_out(self, i: int) -> str:
        """Name of a result."""
        return self.outputs[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Sparsity of an argument."""
        return self.inputs[i][1]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """Sparsity of a result."""
        return self.outputs[i][1]

    def eval(self, arguments: Sequence[ca.DM]) -> Outputs:
        """The results."""
        return self.function(arguments)


def vector(n: int) -> ca.Sparsity:
    """A dense column."""
    return ca.Sparsity.dense(n, 1)
