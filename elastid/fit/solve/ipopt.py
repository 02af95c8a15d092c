"""IPOPT with a Gauss-Newton Hessian (Wachter and Biegler, Mathematical Programming 106, 2006)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from elastid.fit.solve import callbacks
from elastid.fit.solve.callbacks import Answer, Callback, Outputs
from elastid.fit.solve.scaled_problem import ScaledProblem

# The return status of an exception that is none of IPOPT's own, such as Ctrl-C.
FOREIGN_EXCEPTION = "NonIpopt_Exception_Thrown"
_OPTIONS: dict[str, Any] = callbacks.OPTIONS | {
    "ipopt.sb": "yes",
    "ipopt.print_level": 0,
    "ipopt.acceptable_iter": 0,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.nlp_scaling_method": "none",  # V / N in unit variables is scaled already
    # Half the iterations of the monotone strategy, whose first barriers outweigh weakly determined parameters.
    "ipopt.mu_strategy": "adaptive",
}


def ipopt(scaled: ScaledProblem, tolerance: float, max_iterations: int) -> Answer:
    """Where IPOPT ends from scaled.x0, its status and its iterations."""
    called = callbacks.objective(scaled), _gradient(scaled), _hessian(scaled), callbacks.stop(scaled, tolerance)
    options = _OPTIONS | {"grad_f": called[1], "hess_lag": called[2], "iteration_callback": called[3]}
    options |= {"ipopt.max_iter": max_iterations, "ipopt.tol": 1e-3 * tolerance * scaled.weight}
    return callbacks.answer(ca.nlpsol("fit", "ipopt", called[0], options), scaled.to_z(scaled.x0), scaled.z_bounds)


def _gradient(scaled: ScaledProblem) -> Callback:
    """V / N and its gradient as a column."""
    n = len(scaled.x0)

    def evaluate(arguments: Sequence[ca.DM]) -> Outputs:
        here = scaled.guarded(arguments[0])
        return [ca.DM(scaled.weight * here.cost), ca.DM(scaled.weight * scaled.scale * here.gradient)]

    outputs = [("f", callbacks.vector(1)), ("grad_f_x", callbacks.vector(n))]
    return Callback("nlp_grad_f", callbacks.point(n), outputs, evaluate)


def _hessian(scaled: ScaledProblem) -> Callback:
    """The upper triangle of the Hessian of the Lagrangian."""
    n = len(scaled.x0)
    upper, rows_of_columns = ca.Sparsity.upper(n), np.tril_indices(n)

    def evaluate(arguments: Sequence[ca.DM]) -> Outputs:
        # The upper triangle column by column is the lower one row by row.
        return [ca.DM(upper, callbacks.hessian(scaled, arguments)[rows_of_columns])]

    inputs = callbacks.point(n) + callbacks.multipliers()
    return Callback("nlp_hess_l", inputs, [("hess_gamma_x_x", upper)], evaluate)
