"""Other robots than the file's, each fitted with the tolerances about its own numbers.

They are mounted otherwise, do not carry the payload that the file has, have a spring that it lacks, or numbers as one
step from those of the file, with all others as they stand, suggests.  A fit that moved numbers within their tolerances
to make up for a cause ends where no step leads to it; these begin at the file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError
from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis.hypothesis import Evidence, Scores
from elastid.fit.diagnosis.missing_springs import find_missing_springs
from elastid.fit.diagnosis.ranking import ranked
from elastid.fit.diagnosis.scoring import at_file, score
from elastid.fit.result import ModificationIndex
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.parameters import Parameter, ParameterSet
from elastid.robot import Robot

Variant: TypeAlias = tuple[ModificationIndex, Robot, ParameterSet]


@dataclass(frozen=True)
class Limits:
    """Thresholds of the search among other robots.  False alarms of 300 clean logs: modification-index 1."""

    explained_share: float = 0.9  # of the excess; where something else explains more, no other robot is tried
    share: float = 0.3  # of the excess that another robot explains
    cost_ratio: float = 1.1  # of V, below which those mounted otherwise cannot be distinguished
    left: float = 1e-3  # of a payload that is not carried
    followed: int = 4  # numbers, of those likeliest by a step from the file
    iterations: int = 30  # of each fit


LIMITS = Limits()


def find_other_robots(indices: list[ModificationIndex], evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """The indices with other robots that explain a part, in place of their linear steps, where nothing explains all."""
    explained = max((index.share for index in indices), default=0.0)
    if not evidence.is_unexplained or explained > LIMITS.explained_share:
        return indices
    found = [index for index in _mounted_otherwise(evidence, scores)[:1] if index.share > LIMITS.share]
    if (there := at_file(evidence)) is not None and max((i.share for i in found), default=0.0) < LIMITS.explained_share:
        of_file = score(there)
        changed = (_changed(index, evidence) for index in ranked(of_file.test, of_file))
        followed = [variant for variant in changed if variant is not None][: LIMITS.followed]
        found += [_judged(variant, evidence, scores)[0] for variant in followed]
        for spring in find_missing_springs([], there, of_file):
            base = min(there.optimum.end.cost, of_file.cost)
            x = there.result.x + spring.effects
            found.append(_against(spring, base - spring.drop, x, evidence, scores))
    by_name = {index.name: index for index in found if index.share > LIMITS.share}
    better = {name for name, index in by_name.items() if index.share > _share_of(name, indices)}
    return [*(index for index in indices if index.name not in better), *(by_name[name] for name in better)]


def _share_of(name: str, indices: list[ModificationIndex]) -> float:
    return max((index.share for index in indices if index.name == name), default=-math.inf)


def _mounted_otherwise(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """By other directions of gravity and without the file's payload; the best first, with those that equal it."""
    robot, parameters = evidence.assembly.linearisation.model.robot, evidence.assembly.parameters
    size = float(np.linalg.norm(robot.gravity)) or 9.81
    directions = {f"gravity along {sign}{axis} of the base": size * float(f"{sign}1") * row
                  for axis, row in zip("xyz", np.eye(3), strict=True) for sign in "+-"}  # fmt: skip
    variants: list[Variant] = [
        (_named(name, "gravity"), replace(robot, gravity=tuple(gravity.tolist())), parameters)
        for name, gravity in (directions | {"no gravity": np.zeros(3)}).items()
        if not np.allclose(gravity, robot.gravity, atol=0.1 * size)
    ]
    if robot.payload is not None and robot.payload.mass > 0:
        numbers = {n: v for n, (v, _) in robot.parameters().items() if n == "m_payload" or n.startswith("I_payload")}
        left = {name: LIMITS.left * value for name, value in numbers.items()}
        name = _named("the payload of the file not carried", "payload of the file")
        variants.append((name, robot.with_parameters(left), _about(parameters, left)))
    judged = sorted((_judged(variant, evidence, scores) for variant in variants), key=lambda trial: trial[1])
    if not judged:
        return []
    equal = tuple(index.name for index, V in judged[1:] if LIMITS.cost_ratio * judged[0][1] > V)
    return [replace(judged[0][0], alike=equal), *(index for index, _ in judged[1:])]


def _named(name: str, family: str) -> ModificationIndex:
    none = np.zeros(0)
    return ModificationIndex(name, family, (), none, (), (), none, math.nan, 0.0, 0.0, none)


def _changed(index: ModificationIndex, evidence: Evidence) -> Variant | None:
    """The robot with the numbers of an index changed; None where they are no numbers of the robot."""
    robot, parameters = evidence.assembly.linearisation.model.robot, evidence.assembly.parameters
    known = {name: value for name, (value, _) in robot.parameters(tuple(robot.geometry)).items()}
    numbers = dict[str, float]()
    for name, value in zip(index.members, index.changed, strict=True):
        if name in known:
            numbers[name] = value
        elif any(p.name == name and p.ratio for p in parameters):  # a factor of an inertia
            own = {p.name for p in parameters if p.tie is not None and p.tie.to == name}
            numbers |= {n: v * value for n, v in known.items() if n in own}
        else:
            return None
    try:
        return index, robot.with_parameters(numbers), _about(parameters, numbers)
    except (ElastidError, ValueError):  # no such robot
        return None


def _about(parameters: ParameterSet, numbers: Mapping[str, float]) -> ParameterSet:
    """The same with tolerances about other numbers."""

    def moved(p: Parameter) -> Parameter:
        if p.name not in numbers or not (p.tolerated or p.tie is not None or not p.free):
            return p
        value = numbers[p.name]
        if p.tie is not None:
            return replace(p, tie=replace(p.tie, factor=value), value=value)
        by = value / p.value if p.log else 0.0
        lower, upper = (p.lower * by, p.upper * by) if p.log else (p.lower + value - p.value, p.upper + value - p.value)
        return replace(p, value=value, lower=lower, upper=upper, prior=p.prior and replace(p.prior, mean=value))

    return replace(parameters, parameters=tuple(map(moved, parameters)))


def _judged(variant: Variant, evidence: Evidence, scores: Scores) -> tuple[ModificationIndex, float]:
    """The index of another robot, and V of its fit, from the optimum's parameters and from those of the study."""
    index, robot, parameters = variant
    own, cost, x = evidence.assembly, math.inf, evidence.optimum.end.x
    asked = np.array([not p.tolerated for p in parameters.free])
    for start in (np.where(asked, x, parameters.x), parameters.x):
        try:
            assembly = Assembly.of(own.responses, robot, own.spec, parameters, own.model)
            near = solve(assembly.at(start, own.spec.criterion).problem, start, ROUGH, LIMITS.iterations)
            end = solve(assembly.at(near.x, own.spec.criterion).problem, near.x, ROUGH, LIMITS.iterations)
        except ElastidError:
            continue
        cost, x = min((cost, x), (end.cost, end.x), key=lambda each: each[0])
    return _against(index, cost, x, evidence, scores), cost


def _against(
    index: ModificationIndex, cost: float, x: FloatArray, evidence: Evidence, scores: Scores
) -> ModificationIndex:
    """The index where V (cost) and x (n_x,) are those of a fit with it."""
    drop = scores.cost - cost if math.isfinite(cost) else 0.0
    share = drop / max(scores.cost - scores.noise, drop, 1e-300)
    return replace(index, drop=drop, share=share, effects=x - evidence.result.x)
