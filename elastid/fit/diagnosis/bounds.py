"""Notes on parameters that ended at a bound, with where the responses would have them without it.

Of such a parameter V is least elsewhere, or nowhere: of a damping that the responses do not show, or show as less than
none, it falls to zero, whose logarithm has no end.  No bound is wide enough there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import Note
from elastid.fit.diagnosis.hypothesis import Evidence
from elastid.fit.result import Result
from elastid.fit.solve.solvers import DAMPING_UNITS, ROUGH, ROUGH_ITERATIONS, solve
from elastid.parameters import Parameter, Parameters


@dataclass(frozen=True)
class Limits:
    """Thresholds of notes on bounds."""

    near: float = 1e-4  # share of a range within which x is at its bound
    starts: float = 0.5  # share of those that end at a bound
    beyond: float = 1e3  # by which bounds that hold a number are widened, to see where V is least
    std: float = 1.0  # of ln p there, from which p is not to be told from zero, or from infinity
    drop: float = 4.0  # of V without the bounds, over the noise's level, below which they cost nothing


LIMITS = Limits()


@dataclass(frozen=True)
class Unbound:
    """The optimum without bounds that hold numbers: x (n_x,) and std (n_x,) there; drop: of V, over its level."""

    x: FloatArray
    std: FloatArray
    drop: float


def at_bound(parameters: Parameters, x: FloatArray) -> BoolArray:
    """True for each free parameter (n_x,) that ended at a bound."""
    lower, upper = parameters.x_bounds
    reach = LIMITS.near * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    return np.asarray((x - lower < reach) | (upper - x < reach))


def unbound_optimum(evidence: Evidence) -> Unbound | None:
    """Where V is least nearby once bounds that hold positive numbers are `beyond` times as far out; None without any.

    std: by the curvature of V along each parameter alone.
    """
    result, problem = evidence.result, evidence.optimum.fit.problem
    wider = {
        p.name: replace(p, lower=p.lower / LIMITS.beyond, upper=p.upper * LIMITS.beyond)
        for p, held in zip(result.parameters.free, result.at_bound, strict=True)
        if held and p.log and not p.tolerated
    }
    if not wider:
        return None
    parameters = Parameters(tuple(wider.get(p.name, p) for p in problem.parameters))
    end = solve(replace(problem, parameters=parameters), result.x, ROUGH, ROUGH_ITERATIONS)
    level = max(1.0, end.cost / max(problem.dof, 1))
    curvature = np.maximum(np.diag(problem.evaluate(end.x).hessian), 1e-300)
    drop = problem.evaluate(result.x).cost - end.cost
    return Unbound(end.x, np.sqrt(2 * level / curvature), drop / level)


def bound_notes(result: Result, unbound: Unbound | None) -> Iterator[Note]:
    """On parameters that ended at a bound, and on bounds at which most starts ended, the best one not among them."""
    for i in np.flatnonzero(result.at_bound):
        parameter, x = result.parameters.free[i], float(result.x[i])
        low = x - parameter.to_x(parameter.lower) < parameter.to_x(parameter.upper) - x
        side, value = ("lower", parameter.lower) if low else ("upper", parameter.upper)
        text = f"{parameter.name} ended at its {side} bound of {value:.4g} {parameter.unit}"
        yield Note("fit/at-bound", f"{text}: {_advice(parameter, low, x, int(i), unbound, result.exceeds_noise)}")
    ends = [start.x for start in result.starts if math.isfinite(start.cost)]
    if len(ends) < 3 or result.has_tolerances:  # those ended with the file's numbers
        return
    share = np.mean([at_bound(result.parameters, x) for x in ends], axis=0)
    for name, part, held in zip(result.parameters.free_names, share, result.at_bound, strict=True):
        if part > LIMITS.starts and not held:
            often = f"in {round(100 * part)} % of the starts"
            text = f"{name} ended at a bound {often}: widen its bounds, or start it elsewhere"
            yield Note("fit/at-bound", text)


def _advice(parameter: Parameter, low: bool, x: float, i: int, unbound: Unbound | None, exceeds_noise: bool) -> str:
    lacks = "the model lacks something that the data show"
    if parameter.tolerated:
        return f"it is a number of the robot's file, and that is far outside its tolerance: {lacks}"
    if unbound is None or not parameter.log:
        return f"widen the bound if values beyond it are plausible; otherwise {lacks}"
    is_lost = unbound.drop < LIMITS.drop or unbound.std[i] > LIMITS.std
    if is_lost and not exceeds_noise:
        return f"values beyond it fit as well, since the responses do not show so {'little' if low else 'much'}"
    if is_lost:
        early = ", and torques and motions that are apart in time take damping away"
        why = early if low and parameter.unit in DAMPING_UNITS else ""
        less = "less" if low else "more"
        return f"a wider one does not help, since the responses ask for {less} than any{why}: {lacks}"
    if (unbound.x[i] - x) * (-1 if low else 1) < LIMITS.near:
        return "it leaves it where the others at a bound have wider ones"
    value = f"{math.exp(unbound.x[i]):.3g} {parameter.unit}"
    return f"widen the bound to beyond {value} if that is plausible; otherwise {lacks}"
