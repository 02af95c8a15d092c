r"""Whether the configurations fall into two lots that one set of parameters cannot describe, as two robots do.

.. math:: \min_{S} \Big[ \min_x \sum_{c \in S} V_c(x) + \min_x \sum_{c \notin S} V_c(x) \Big]

Begun with the two configurations whose own parameters describe all of them best, each that of its lot, and refined in
turn: fit each lot, move every configuration to the lot that describes it better, until none moves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import FitError
from elastid.base.note import Note
from elastid.fit.problem.elastic import ElasticFit, Part
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.parameters import Parameter, Prior

# Two lots that take less of what V exceeds the noise by are no better than one.
REMOVED = 0.8
ROUNDS = 4
ITERATIONS = 40
# One configuration does not tell all parameters: what it leaves open stays within so much (of ln p) of the common ones.
LOOSE = 0.3
# Parameters named in a message: those that differ by the most standard deviations, and how many they must be.
NAMED = 3
APART = 5.0


@dataclass(frozen=True)
class Lots:
    """in_second (Q,): of the configurations.  first, second (n_x,): their parameters.  cost: V of both together."""

    in_second: BoolArray
    first: FloatArray
    second: FloatArray
    cost: float


def disagreement(
    fit: ElasticFit, x: FloatArray, cost: float, noise_cost: float, robots: Mapping[str, Sequence[str]]
) -> tuple[Note, ...]:
    """A sentence where two lots of configurations agree with parameters of their own, and not with common ones.

    x (n_x,): the optimum of all, cost: V there.  noise_cost: what the noise leaves of it.  robots: of fit.robots.
    """
    parts = tuple(part for part in fit.parts if part.n_residuals)
    if len(parts) < 2:
        return ()
    fit = replace(fit, parts=parts)
    try:
        lots = _lots(fit, x)
    except FitError:
        return ()
    if lots is None or lots.cost - noise_cost > (1 - REMOVED) * (cost - noise_cost):
        return ()
    names = [part.configuration for part in parts]
    ones = ", ".join(name for name, other in zip(names, lots.in_second, strict=True) if not other)
    others = ", ".join(name for name, other in zip(names, lots.in_second, strict=True) if other)
    return (
        Note(
            "two-groups",
            f"configurations {ones} on the one side and {others} on the other disagree: fitted apart they leave V = "
            f"{lots.cost:.4g} instead of {cost:.4g}{_differing(fit, lots)}; {_advice(ones, others, robots)}",
        ),
    )


def _advice(ones: str, others: str, robots: Mapping[str, Sequence[str]]) -> str:
    known = [name for name, members in robots.items() if set(members) & set(ones.split(", "))]
    more = [name for name, members in robots.items() if set(members) & set(others.split(", "))]
    if robots and not set(known) & set(more):
        return f"these are the robots {', '.join(known)} and {', '.join(more)}: give what differs `per: robot`"
    return (
        "are they of two robots of one type, or with two loads? name them in fit.robots and give what differs `per: "
        "robot`, or fit one of them alone"
    )


def _lots(fit: ElasticFit, x: FloatArray) -> Lots | None:
    """The best two lots; None where one of them loses all its configurations."""
    loose = _held_near(fit, x)
    alone = [_solved(replace(loose, parts=(part,)), x) for part in fit.parts]
    costs = np.array([_costs(fit, each) for each in alone])
    both = np.minimum(costs[:, None, :], costs[None, :, :]).sum(axis=2)
    a, b = np.unravel_index(int(np.argmin(both)), both.shape)
    in_second = costs[b] < costs[a]
    for _ in range(ROUNDS):
        if in_second.all() or not in_second.any():
            return None
        first, second = (_solved(replace(fit, parts=_chosen(fit, chosen)), x) for chosen in (~in_second, in_second))
        of_first, of_second = _costs(fit, first), _costs(fit, second)
        lots = Lots(in_second, first, second, float(np.where(in_second, of_second, of_first).sum()))
        moved = of_second < of_first
        if np.array_equal(moved, in_second):
            break
        in_second = moved
    return lots


def _chosen(fit: ElasticFit, chosen: BoolArray) -> tuple[Part, ...]:
    return tuple(part for part, one in zip(fit.parts, chosen, strict=True) if one)


def _held_near(fit: ElasticFit, x: FloatArray) -> ElasticFit:
    """The fit with a loose prior at x for what has none and is logarithmic."""
    at = dict(zip(fit.parameters.free_names, x.tolist(), strict=True))

    def of(p: Parameter) -> Parameter:
        if p.name not in at or p.prior is not None or not p.log:
            return p
        return replace(p, prior=Prior(math.exp(at[p.name]), LOOSE))

    return replace(fit, parameters=replace(fit.parameters, parameters=tuple(map(of, fit.parameters))))


def _solved(fit: ElasticFit, x: FloatArray) -> FloatArray:
    return solve(fit.problem, x, ROUGH, ITERATIONS).x


def _costs(fit: ElasticFit, x: FloatArray) -> FloatArray:
    """V_c (Q,) of each configuration at x."""
    with np.errstate(all="ignore"):
        costs = np.array([part.normal.at(fit.theta(part, x))[0] for part in fit.parts])
    return np.where(np.isfinite(costs), costs, np.inf)


def _differing(fit: ElasticFit, lots: Lots) -> str:
    """The parameters that differ most, with both values."""
    variance = sum(
        np.diag(np.linalg.pinv(replace(fit, parts=_chosen(fit, chosen)).evaluate(x).hessian / 2, hermitian=True))
        for chosen, x in ((~lots.in_second, lots.first), (lots.in_second, lots.second))
    )
    apart = np.abs(lots.first - lots.second) / np.sqrt(np.maximum(variance, 1e-300))
    far = [i for i in np.argsort(-apart)[:NAMED] if apart[i] > APART]
    one, other = (fit.parameters.as_dict(x) for x in (lots.first, lots.second))
    free = fit.parameters.free
    said = [f"{free[i].name} {one[free[i].name]:.4g} against {other[free[i].name]:.4g} {free[i].unit}" for i in far]
    return f", with {', '.join(said)}" if said else ""
