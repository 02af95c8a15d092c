r"""Whether the configurations split into two groups with different parameters, as those of two robots do.

.. math:: \min_{S} \Big[ \min_x \sum_{c \in S} V_c(x) + \min_x \sum_{c \notin S} V_c(x) \Big]

It starts with the two configurations whose own parameters describe all of them best, and alternates: fit each group,
move every configuration to the group that describes it better, until none moves. Where own parameters hardly describe
a configuration better than common ones, no grouping does.
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

# Two groups must remove a larger share of V beyond the noise; parameters of each configuration's own so much of it.
MIN_REMOVED_SHARE = 0.8
MIN_REMOVED_ALONE = 0.5
MAX_ROUNDS = 4
MAX_ITERATIONS = 40
# Standard deviation (of ln p) of the prior about the common optimum: one configuration does not determine everything.
PRIOR_STD = 0.3
# A note names at most so many parameters, those that differ by more than so many standard deviations.
MAX_NAMED = 3
MIN_DIFFERENCE = 5.0


@dataclass(frozen=True)
class Split:
    """in_second (Q,): of the configurations.  first, second (n_x,): their parameters.  cost: V of both together."""

    in_second: BoolArray
    first: FloatArray
    second: FloatArray
    cost: float


def costs_alone(fit: ElasticFit, x: FloatArray) -> FloatArray | None:
    """V_c (Q, Q) of each configuration, by column, with the parameters of each one's own, near x (n_x,).

    None of fewer than two configurations, and where one of them cannot be fitted.
    """
    fit = measured(fit)
    if len(fit.parts) < 2:
        return None
    near = _held_near(fit, x)
    try:
        return np.array([_costs(fit, _solved(replace(near, parts=(part,)), x)) for part in fit.parts])
    except FitError:
        return None


def find_two_groups(
    fit: ElasticFit,
    x: FloatArray,
    alone: FloatArray,
    cost: float,
    noise_cost: float,
    robots: Mapping[str, Sequence[str]],
) -> tuple[Note, ...]:
    """A note where two groups of configurations agree with parameters of their own, and not with common ones.

    x (n_x,): the optimum of all, cost: V there.  alone: of `costs_alone`.  noise_cost: V by the noise alone.
    robots: of fit.robots.
    """
    fit = measured(fit)
    parts = fit.parts
    if float(np.trace(alone)) - noise_cost > (1 - MIN_REMOVED_ALONE) * (cost - noise_cost):
        return ()
    try:
        split = _split(fit, x, alone)
    except FitError:
        return ()
    if split is None or split.cost - noise_cost > (1 - MIN_REMOVED_SHARE) * (cost - noise_cost):
        return ()
    names = [part.configuration for part in parts]
    ones = ", ".join(name for name, other in zip(names, split.in_second, strict=True) if not other)
    others = ", ".join(name for name, other in zip(names, split.in_second, strict=True) if other)
    return (
        Note(
            "two-groups",
            f"configurations {ones} on the one side and {others} on the other disagree: fitted apart they leave V = "
            f"{split.cost:.4g} instead of {cost:.4g}{_differing(fit, split)}; {_advice(ones, others, robots)}",
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


def measured(fit: ElasticFit) -> ElasticFit:
    """The fit without configurations that are left out as a whole."""
    return replace(fit, parts=tuple(part for part in fit.parts if part.n_residuals))


def _split(fit: ElasticFit, x: FloatArray, costs: FloatArray) -> Split | None:
    """The best two groups, from V (Q, Q) of `costs_alone`; None where one of them loses all its configurations."""
    both = np.minimum(costs[:, None, :], costs[None, :, :]).sum(axis=2)
    a, b = np.unravel_index(int(np.argmin(both)), both.shape)
    in_second = costs[b] < costs[a]
    for _ in range(MAX_ROUNDS):
        if in_second.all() or not in_second.any():
            return None
        first, second = (_solved(replace(fit, parts=_chosen(fit, chosen)), x) for chosen in (~in_second, in_second))
        of_first, of_second = _costs(fit, first), _costs(fit, second)
        split = Split(in_second, first, second, float(np.where(in_second, of_second, of_first).sum()))
        moved = of_second < of_first
        if np.array_equal(moved, in_second):
            break
        in_second = moved
    return split


def _chosen(fit: ElasticFit, chosen: BoolArray) -> tuple[Part, ...]:
    return tuple(part for part, one in zip(fit.parts, chosen, strict=True) if one)


def _held_near(fit: ElasticFit, x: FloatArray) -> ElasticFit:
    """The fit with a loose prior at x for what has none and is logarithmic."""
    at = dict(zip(fit.parameters.free_names, x.tolist(), strict=True))

    def of(p: Parameter) -> Parameter:
        if p.name not in at or p.prior is not None or not p.log:
            return p
        return replace(p, prior=Prior(math.exp(at[p.name]), PRIOR_STD))

    return replace(fit, parameters=replace(fit.parameters, parameters=tuple(map(of, fit.parameters))))


def _solved(fit: ElasticFit, x: FloatArray) -> FloatArray:
    return solve(fit.problem, x, ROUGH, MAX_ITERATIONS).x


def _costs(fit: ElasticFit, x: FloatArray) -> FloatArray:
    """V_c (Q,) of each configuration at x."""
    with np.errstate(all="ignore"):
        costs = np.array([part.normal.at(fit.theta(part, x))[0] for part in fit.parts])
    return np.where(np.isfinite(costs), costs, np.inf)


def _differing(fit: ElasticFit, split: Split) -> str:
    """The parameters that differ most, with both values."""
    variance = sum(
        np.diag(np.linalg.pinv(replace(fit, parts=_chosen(fit, chosen)).evaluate(x).hessian / 2, hermitian=True))
        for chosen, x in ((~split.in_second, split.first), (split.in_second, split.second))
    )
    apart = np.abs(split.first - split.second) / np.sqrt(np.maximum(variance, 1e-300))
    far = [i for i in np.argsort(-apart)[:MAX_NAMED] if apart[i] > MIN_DIFFERENCE]
    one, other = (fit.parameters.as_dict(x) for x in (split.first, split.second))
    free = fit.parameters.free
    said = [f"{free[i].name} {one[free[i].name]:.4g} against {other[free[i].name]:.4g} {free[i].unit}" for i in far]
    return f", with {', '.join(said)}" if said else ""
