r"""Configurations that disagree: two groups with different parameters, as of two robots, or single ones.

.. math:: \min_{S} \Big[ \min_x \sum_{c \in S} V_c(x) + \min_x \sum_{c \notin S} V_c(x) \Big]

The search for two groups starts with the two configurations whose own parameters describe all of them best, and
alternates: fit each group, move every configuration to the group that describes it better, until none moves.  Where own
parameters describe no configuration better than common ones, no grouping does.

The amplitudes of one posture are one configuration here: its response depends on them where gears are not linear, and
no two robots are needed for that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import FitError, Note
from elastid.base.names import posture_of
from elastid.fit.diagnosis.hypothesis import Evidence
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.part import Part
from elastid.fit.result import largest_by_chance
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.parameters import Parameter, Prior


@dataclass(frozen=True)
class Limits:
    """Thresholds of the judgement of configurations."""

    explained_share: float = 0.8  # of the excess; where a cause explains more, no configurations are sought that differ
    residual_ratio: float = 5.0  # of a configuration to the median of all, beyond which it is unlike the others
    # Of V beyond the noise, that two groups, and own parameters of each configuration, remove.
    removed_share: float = 0.8
    removed_alone: float = 0.5
    difference: float = 5.0  # of a parameter between groups, in standard deviations
    rounds: int = 4  # of the search for two groups
    iterations: int = 40  # of its fits
    prior_std: float = 0.3  # of ln p about the common optimum: one configuration does not determine everything
    named: int = 3  # parameters in a note


LIMITS = Limits()
# The fits of two groups, x (n_x,) of each, and V of both together.
_Split: TypeAlias = tuple[list[ElasticFit], list[FloatArray], float]


def find_disagreement(evidence: Evidence) -> tuple[Note, ...]:
    """Notes on configurations unlike the others; else on two groups of them."""
    result, fit, x = evidence.result, evidence.optimum.fit, evidence.optimum.end.x
    # What a cause leaves may be chance where V is little above the noise.
    left, by_chance = result.cost - evidence.best_drop, largest_by_chance(result.cost_dof) * result.cost_expected
    if evidence.best_share >= LIMITS.explained_share or (evidence.best_drop and left < by_chance):
        return ()
    unlike = find_unlike_configurations(fit, x) if result.model_error > 1 else ()
    if unlike or not evidence.is_unexplained:
        return unlike
    groups, alone = tuple[Note, ...](), costs_alone(fit, x)
    if result.exceeds_noise and alone is not None:
        robots = evidence.assembly.spec.robots
        groups = find_two_groups(fit, x, alone, evidence.optimum.end.cost, result.cost_expected, robots)
    return groups


def find_unlike_configurations(fit: ElasticFit, x: FloatArray) -> tuple[Note, ...]:
    """A note on each configuration that the model at x explains far worse than the others."""
    fit = measured(fit)
    postures = _postures(fit)
    if len(postures) < 3:
        return ()
    counts = [sum(part.n_residuals for part in parts) for parts in postures.values()]
    level = np.sqrt(_costs(fit, x) / np.array(counts))
    level = level / float(np.median(level))
    others = "those of the other configurations; is it of the same robot, with the same load, at the stated angles?"
    return tuple(
        Note("fit/unlike-responses", f"its residuals are {ratio:.0f} times {others}", f"configuration {name}")
        for name, ratio in zip(postures, level, strict=True)
        if ratio > LIMITS.residual_ratio
    )


def costs_alone(fit: ElasticFit, x: FloatArray) -> FloatArray | None:
    """V_c (Q, Q) of each configuration, by column, with the parameters of each one's own, near x (n_x,).

    None for fewer than two configurations, and where one of them cannot be fitted.
    """
    fit = measured(fit)
    postures = _postures(fit)
    if len(postures) < 2:
        return None
    values = dict(zip(fit.parameters.free_names, x.tolist(), strict=True))

    def near(p: Parameter) -> Parameter:
        if p.name not in values or p.prior is not None or not p.log:
            return p
        return replace(p, prior=Prior(math.exp(values[p.name]), LIMITS.prior_std))

    own = replace(fit, parameters=replace(fit.parameters, parameters=tuple(map(near, fit.parameters.parameters))))
    try:
        return np.array([_costs(fit, _solve(replace(own, parts=parts), x)) for parts in postures.values()])
    except FitError:
        return None


def measured(fit: ElasticFit) -> ElasticFit:
    """The responses of the fit without configurations that are left out as a whole."""
    return replace(fit, parts=tuple(part for part in fit.parts if part.n_residuals), loads=None)


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
    if float(np.trace(alone)) - noise_cost > (1 - LIMITS.removed_alone) * (cost - noise_cost):
        return ()
    try:
        split = _split(fit, x, alone)
    except FitError:
        return ()
    if split is None or split[2] - noise_cost > (1 - LIMITS.removed_share) * (cost - noise_cost):
        return ()
    groups, ends, cost_apart = split
    first, second = (list(_postures(group)) for group in groups)
    members = f"configurations {', '.join(first)} on the one side and {', '.join(second)} on the other disagree"
    part = math.sqrt(cost_apart / cost)
    left = f"fitted apart they leave {part:.2g} times the rms residual{_differences(groups, ends)}"
    return (Note("fit/unlike-responses", f"{members}: {left}; {_advice(first, second, robots)}"),)


def _advice(first: Sequence[str], second: Sequence[str], robots: Mapping[str, Sequence[str]]) -> str:
    of_first, of_second = ([name for name, own in robots.items() if set(own) & set(g)] for g in (first, second))
    if robots and not set(of_first) & set(of_second):
        return f"these are the robots {', '.join(of_first)} and {', '.join(of_second)}: give what differs `per: robot`"
    return (
        "are they of two robots of one type, or with two loads? name them in fit.robots and give what differs `per: "
        "robot`, or fit one of them alone"
    )


def _split(fit: ElasticFit, x: FloatArray, costs: FloatArray) -> _Split | None:
    """The best two groups, from V (Q, Q) of `costs_alone`; None where one of them loses all its configurations."""
    both = np.minimum(costs[:, None, :], costs[None, :, :]).sum(axis=2)
    a, b = np.unravel_index(int(np.argmin(both)), both.shape)
    in_second = costs[b] < costs[a]
    for _ in range(LIMITS.rounds):
        if in_second.all() or not in_second.any():
            return None
        groups = [_group(fit, members) for members in (~in_second, in_second)]
        ends = [_solve(group, x) for group in groups]
        of_first, of_second = (_costs(fit, end) for end in ends)
        split = groups, ends, float(np.where(in_second, of_second, of_first).sum())
        moved = of_second < of_first
        if np.array_equal(moved, in_second):
            break
        in_second = moved
    return split


def _group(fit: ElasticFit, members: BoolArray) -> ElasticFit:
    """Some of the postures (Q,)."""
    pairs = zip(_postures(fit).values(), members, strict=True)
    return replace(fit, parts=tuple(part for parts, is_member in pairs if is_member for part in parts))


def _postures(fit: ElasticFit) -> dict[str, tuple[Part, ...]]:
    """The responses of each posture, at one amplitude or several, by its name."""
    postures: dict[str, tuple[Part, ...]] = {}
    for part in fit.parts:
        name = posture_of(part.configuration)
        postures[name] = (*postures.get(name, ()), part)
    return postures


def _solve(fit: ElasticFit, x: FloatArray) -> FloatArray:
    return solve(fit.problem, x, ROUGH, LIMITS.iterations).x


def _costs(fit: ElasticFit, x: FloatArray) -> FloatArray:
    """V_c (Q,) of each configuration at x."""
    with np.errstate(all="ignore"):
        costs = np.array(
            [sum(part.normal.at(fit.theta(part, x))[0] for part in parts) for parts in _postures(fit).values()]
        )
    return np.where(np.isfinite(costs), costs, np.inf)


def _differences(groups: Sequence[ElasticFit], ends: Sequence[FloatArray]) -> str:
    parameters, (x, x_second) = groups[0].parameters, ends
    pairs = zip(groups, ends, strict=True)
    variance = sum(np.diag(np.linalg.pinv(group.evaluate(end).hessian / 2, hermitian=True)) for group, end in pairs)
    z = np.abs(x - x_second) / np.sqrt(np.maximum(variance, 1e-300))
    far = [i for i in np.argsort(-z)[: LIMITS.named] if z[i] > LIMITS.difference]
    (first, second), free = map(parameters.as_dict, ends), parameters.free
    words = [f"{free[i].name} {first[free[i].name]:.4g} against {second[free[i].name]:.4g} {free[i].unit}" for i in far]
    return f", with {', '.join(words)}" if words else ""
