"""CasADi functions from Python: a solver's objective and its stopping rule."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.solve.scaled_problem import ScaledProblem

Outputs: TypeAlias = list[ca.DM]
# A name and a sparsity for each argument or result.
Signature: TypeAlias = list[tuple[str, ca.Sparsity]]
# z, the return status and the iterations.
Answer: TypeAlias = tuple[FloatArray, str, int]

# The return status of a solver that `stop` ended.
STOPPED = "User_Requested_Stop"
# Of every solver of CasADi.
OPTIONS: dict[str, Any] = {
    "print_time": False,
    "no_nlp_grad": True,  # would need the gradient of the multipliers, which nobody reads
    "calc_lam_p": False,
    "show_eval_warnings": False,
}


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


def point(n: int) -> Signature:
    """Arguments of the objective and its gradient."""
    return [("x", vector(n)), ("p", ca.Sparsity(0, 0))]


def multipliers() -> Signature:
    """Further arguments of the Hessian of the Lagrangian."""
    return [("lam_f", vector(1)), ("lam_g", ca.Sparsity(0, 1))]


def objective(scaled: ScaledProblem) -> Callback:
    """V / N, and no constraints."""

    def evaluate(arguments: Sequence[ca.DM]) -> Outputs:
        return [ca.DM(scaled.weight * scaled.guarded(arguments[0]).cost), ca.DM(0, 1)]

    return Callback("objective", point(len(scaled.x0)), [("f", vector(1)), ("g", ca.Sparsity(0, 1))], evaluate)


def stop(scaled: ScaledProblem, tolerance: float) -> Callback:
    """Whether to end: after an error, or nearer to the stationary point than the tolerance."""
    n, none = vector(len(scaled.x0)), ca.Sparsity(0, 0)
    state = [("x", n), ("f", vector(1)), ("g", none), ("lam_x", n), ("lam_g", none), ("lam_p", none)]

    def evaluate(arguments: Sequence[ca.DM]) -> Outputs:
        scaled.guarded(arguments[0])
        x = scaled.to_x(np.asarray(arguments[0]).ravel())
        return [ca.DM(scaled.error is not None or scaled.distance(x) < tolerance)]

    return Callback("stop", state, [("ret", vector(1))], evaluate)


def hessian(scaled: ScaledProblem, arguments: Sequence[ca.DM]) -> FloatArray:
    """The Gauss-Newton Hessian (n_x, n_x) in z, times the multiplier of the objective."""
    here = scaled.guarded(arguments[0])
    return np.asarray(float(arguments[2]) * scaled.weight * np.outer(scaled.scale, scaled.scale) * here.hessian)


def answer(solver: ca.Function, z: FloatArray, bounds: tuple[FloatArray, FloatArray]) -> Answer:
    """Where the solver ends from z within bounds."""
    found = solver(x0=z, lbx=bounds[0], ubx=bounds[1])
    stats = solver.stats()
    return np.asarray(found["x"]).ravel(), str(stats["return_status"]), int(stats["iter_count"])
