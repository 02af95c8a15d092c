"""CasADi's SQP: a Gauss-Newton step within the bounds by an active-set QP, then a line search."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from elastid.fit.solve import callbacks
from elastid.fit.solve.callbacks import STOPPED, Answer, Callback, Outputs
from elastid.fit.solve.scaled_problem import ScaledProblem

# Steps within one box.
STEPS_IN_BOX = 2
_OPTIONS: dict[str, Any] = callbacks.OPTIONS | {
    "print_header": False,
    "print_iteration": False,
    "print_status": False,
    "error_on_fail": False,
    "qpsol": "qrqp",
    "qpsol_options": {"print_header": False, "print_iter": False, "print_info": False, "error_on_fail": False},
    "min_step_size": 1e-14,
}


def sqp(scaled: ScaledProblem, tolerance: float, max_iterations: int) -> Answer:
    """Where the SQP ends from scaled.x0, its status and its iterations.

    Box after box, each about the end of the one before: a Gauss-Newton step over decades is not to be trusted.
    """
    called = callbacks.objective(scaled), _gradient(scaled), _hessian(scaled), callbacks.stop(scaled, tolerance)
    options = _OPTIONS | {"jac_fg": called[1], "hess_lag": called[2], "iteration_callback": called[3]}
    options |= {"max_iter": min(STEPS_IN_BOX, max_iterations), "tol_du": 1e-3 * tolerance * scaled.weight}
    solver = ca.nlpsol("fit", "sqpmethod", called[0], options)
    lower, upper = scaled.z_bounds
    z, used, reach = scaled.to_z(scaled.x0), 0, scaled.reach
    while True:
        box = np.maximum(lower, z - reach), np.minimum(upper, z + reach)
        ended, status, steps = callbacks.answer(solver, z, box)
        used += max(steps, 1)
        ended = np.clip(ended, lower, upper)
        moved, z = bool(np.any(ended != z)), ended
        if scaled.error is not None or status == STOPPED or used >= max_iterations or not moved:
            return z, status, used


def _gradient(scaled: ScaledProblem) -> Callback:
    """V / N and its gradient as a row; no constraints."""
    n = len(scaled.x0)

    def evaluate(arguments: Sequence[ca.DM]) -> Outputs:
        here = scaled.guarded(arguments[0])
        slope = scaled.weight * scaled.scale * here.gradient
        return [ca.DM(scaled.weight * here.cost), ca.DM(slope[None, :]), ca.DM(0, 1), ca.DM(0, n)]

    outputs = [("f", callbacks.vector(1)), ("jac_f", ca.Sparsity.dense(1, n))]
    outputs += [("g", ca.Sparsity(0, 1)), ("jac_g", ca.Sparsity(0, n))]
    return Callback("nlp_jac_fg", callbacks.point(n), outputs, evaluate)


def _hessian(scaled: ScaledProblem) -> Callback:
    """The whole Hessian of the Lagrangian."""
    n = len(scaled.x0)

    def evaluate(arguments: Sequence[ca.DM]) -> Outputs:
        return [ca.DM(callbacks.hessian(scaled, arguments))]

    inputs = callbacks.point(n) + callbacks.multipliers()
    return Callback("nlp_hess_l", inputs, [("hess_gamma_x_x", ca.Sparsity.dense(n, n))], evaluate)
