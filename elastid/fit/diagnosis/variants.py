"""Variants of a study: other robots than the file's, or the same read otherwise, as causes with V of their fits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis.hypothesis import Evidence, Scores
from elastid.fit.result import ModificationIndex
from elastid.parameters import Parameter, Parameters
from elastid.robot import Robot

Variant: TypeAlias = tuple[ModificationIndex, Assembly]
COST_RATIO = 1.1  # of V, below which variants cannot be distinguished


def named(name: str, family: str) -> ModificationIndex:
    """The index of a cause that is no number of the model."""
    none = np.zeros(0)
    return ModificationIndex(name, family, (), none, (), (), none, math.nan, 0.0, 0.0, none)


def about(parameters: Parameters, numbers: Mapping[str, float]) -> Parameters:
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


def of_robot(evidence: Evidence, robot: Robot, parameters: Parameters) -> Assembly:
    """The study with another robot."""
    own = evidence.assembly
    return Assembly.of(own.responses, robot, own.spec, parameters, own.model, (), own.weights)


def against(
    index: ModificationIndex, cost: float, x: FloatArray, evidence: Evidence, scores: Scores
) -> ModificationIndex:
    """The index where V (cost) and x (n_x,) are those of a fit with it."""
    drop = scores.cost - cost if math.isfinite(cost) else 0.0
    share = drop / max(scores.cost - scores.noise, drop, 1e-300)
    return replace(index, drop=drop, share=share, effects=x - evidence.result.x)


def best(judged: Iterable[tuple[ModificationIndex, float]]) -> list[ModificationIndex]:
    """The index of least V, with the names of those that cannot be distinguished from it."""
    by_cost = sorted(judged, key=lambda trial: trial[1])
    equal = (index.name for index, V in by_cost[1:] if COST_RATIO * by_cost[0][1] > V)
    return [replace(by_cost[0][0], alike=tuple(equal))] if by_cost else []
