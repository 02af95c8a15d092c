r"""IPOPT with a Gauss-Newton Hessian, through CasADi (Wachter and Biegler, Mathematical Programming 106, 2006).

.. math:: \min_z V(z) / N \quad \text{s.t.} \quad z_{lower} \le z \le z_{upper}, \qquad \nabla^2 V \approx 2 J^T J
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.problem.least_squares import Ending, Evaluation, LeastSquares

# The return status of success, and of an exception outside IPOPT, such as Ctrl-C.
_SUCCESS, _FOREIGN_EXCEPTION = "Solve_Succeeded", "NonIpopt_Exception_Thrown"
_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "no_nlp_grad": True,  # would compute derivatives with respect to multipliers, which are not used
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
    """Return the optimum that IPOPT reaches from x0 (n_x,) within bounds; beginning: the problem at x0.

    Errors of the problem are raised as they are; Ctrl-C becomes KeyboardInterrupt.
    """
    nlp, n = _ScaledProblem(problem, x0, beginning), len(x0)
    x, number, none, no_rows = (ca.Sparsity.dense(n, 1), ca.Sparsity.dense(1, 1), ca.Sparsity(0, 0), ca.Sparsity(0, 1))
    point = [("x", x), ("p", none)]
    at_multipliers = [*point, ("lam_f", number), ("lam_g", no_rows)]
    objective = _Callback("objective", point, [("f", number), ("g", no_rows)], nlp.objective)
    gradient = _Callback("nlp_grad_f", point, [("f", number), ("grad_f_x", x)], nlp.gradient)
    hessian = _Callback("nlp_hess_l", at_multipliers, [("hess_gamma_x_x", ca.Sparsity.upper(n))], nlp.hessian)
    options = _OPTIONS | {"grad_f": gradient, "hess_lag": hessian}
    options |= {"ipopt.max_iter": max_iterations, "ipopt.tol": tolerance * nlp.weight}
    solver = ca.nlpsol("fit", "ipopt", objective, options)
    lower, upper = map(nlp.to_z, problem.parameters.x_bounds)
    solution = solver(x0=nlp.to_z(x0), lbx=lower, ubx=upper)
    stats = solver.stats()
    if nlp.error is not None:
        raise nlp.error
    # Ctrl-C inside IPOPT does not raise; it returns this status and an x that is no solution.
    if stats["return_status"] == _FOREIGN_EXCEPTION:
        raise KeyboardInterrupt
    end = np.clip(nlp.to_x(solution["x"]), *problem.parameters.x_bounds)
    status = "" if stats["return_status"] == _SUCCESS else str(stats["return_status"])
    return Ending(end, nlp.at(end), status, int(stats["iter_count"]))


class _ScaledProblem:
    """V / N and its derivatives in z, evaluated once for each x; `error` is the first exception of a callback.

    Bounded variables are scaled to unit range, so that a delay in seconds and ln k have the same size for a solver.
    """

    def __init__(self, problem: LeastSquares, x0: FloatArray, beginning: Evaluation) -> None:
        lower, upper = problem.parameters.x_bounds
        is_bounded = np.isfinite(upper - lower)
        self.problem = problem
        self.origin = np.where(is_bounded, lower, 0.0)
        self.scale = np.where(is_bounded, upper - lower, np.maximum(np.abs(x0), 1.0))
        self.weight = 1.0 / max(1, problem.n_residuals)
        self.error: BaseException | None = None
        self._cache = (x0.tobytes(), beginning)

    def to_x(self, z: ca.DM) -> FloatArray:
        return self.origin + self.scale * np.asarray(z).ravel()

    def to_z(self, x: FloatArray) -> FloatArray:
        return (x - self.origin) / self.scale

    def at(self, x: FloatArray) -> Evaluation:
        """Return the problem at x; cost, gradient and Hessian are requested one after the other at the same x."""
        key = x.tobytes()
        if self._cache[0] != key:
            self._cache = (key, self.problem.evaluate(x))
        return self._cache[1]

    def guarded(self, z: ca.DM) -> Evaluation:
        """Evaluate the problem for a callback, and store its first exception in `error`: CasADi ignores exceptions.

        After an exception the function is constant, so that the solver ends at once.
        """
        if self.error is None:
            try:
                return self.at(self.to_x(z))
            except BaseException as error:
                self.error = error
        n = len(self.scale)
        return Evaluation(0.0, np.zeros(n), np.eye(n))

    def objective(self, arguments: Sequence[ca.DM]) -> "_Outputs":
        """Return V / N, and no constraints."""
        return [ca.DM(self.weight * self.guarded(arguments[0]).cost), ca.DM(0, 1)]

    def gradient(self, arguments: Sequence[ca.DM]) -> "_Outputs":
        """Return V / N and its gradient as a column."""
        return [self.objective(arguments)[0], ca.DM(self.weight * self.scale * self.guarded(arguments[0]).gradient)]

    def hessian(self, arguments: Sequence[ca.DM]) -> "_Outputs":
        """Return the upper triangle of the Lagrangian's Gauss-Newton Hessian in z times the multiplier of V / N."""
        weights, n = self.weight * np.outer(self.scale, self.scale), len(self.scale)
        hessian = float(arguments[2]) * weights * self.guarded(arguments[0]).hessian
        # The upper triangle column by column is the lower one row by row.
        return [ca.DM(ca.Sparsity.upper(n), hessian[np.tril_indices(n)])]


_Outputs: TypeAlias = list[ca.DM]
_Signature: TypeAlias = list[tuple[str, ca.Sparsity]]  # of each argument or result


class _Callback(ca.Callback):
    """CasADi function that evaluates a Python function; the caller must keep a reference to it."""

    def __init__(
        self, name: str, inputs: _Signature, outputs: _Signature, function: Callable[[Sequence[ca.DM]], _Outputs]
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

    def eval(self, arguments: Sequence[ca.DM]) -> _Outputs:
        return self.function(arguments)
