"""Variants of a study: other robots than the file's, or the same read otherwise, as causes with V of their fits.

The study read otherwise: angles, and sides of encoders and of inertias of motors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise, product
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError
from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis.hypothesis import Evidence, Scores
from elastid.fit.diagnosis.prediction import AS_READ, settle, thinned
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


MOST_RESIDUALS = 2_000  # of the fit of another reading


def read_otherwise(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """By the best of the study's other readings."""
    variants = (*_angles(evidence), *_motor_inertias(evidence), *_encoders(evidence))
    return best(_settled(variant, evidence, scores) for variant in variants)


def _angles(evidence: Evidence) -> Iterator[Variant]:
    """The study with the angles of its configurations in the other unit, direction or order."""
    own = evidence.assembly
    driven = own.linearisation.model.robot.driven
    turns, n = np.array([not joint.slides for joint in driven]), len(driven)
    degree = math.radians(1)
    changes = {
        "angles of all configurations in degrees, read as radians": np.diag(np.where(turns, degree, 1.0)),
        "angles of all configurations in radians, read as degrees": np.diag(np.where(turns, 1 / degree, 1.0)),
    }
    for i, joint in enumerate(driven):
        counted = f"angle of axis {joint.name} counted in the other direction in all configurations"
        changes[counted] = np.diag([-1.0 if j == i else 1.0 for j in range(n)])
    for i, (first, second) in enumerate(pairwise(driven)):
        order = [*range(i), i + 1, i, *range(i + 2, n)]
        changes[f"angles of axes {first.name} and {second.name} exchanged in all configurations"] = np.eye(n)[order]
    stated = np.array([G.configuration.angles for G in own.responses])
    names = [G.configuration.name for G in own.responses]
    worst = names[int(np.argmax([part.normal.at(evidence.optimum.fit.theta(part, evidence.optimum.end.x))[0]
                                 / max(part.n_residuals, 1) for part in evidence.optimum.fit.parts]))]  # fmt: skip
    for (name, change), whose in product(changes.items(), ("", worst) if len(names) > 1 else ("",)):
        chosen = np.array([whose in ("", own_name) for own_name in names])
        stood = np.where(chosen[:, None], stated @ change.T, stated)
        if not np.allclose(stood, stated):
            places = [replace(G.configuration, angles=row) for G, row in zip(own.responses, stood, strict=True)]
            responses = (replace(G, configuration=place) for G, place in zip(own.responses, places, strict=True))
            where = name.replace("all configurations", f"configuration {whose}") if whose else name
            yield named(where, "postures"), replace(own, responses=tuple(responses))


def _motor_inertias(evidence: Evidence) -> Iterator[Variant]:
    """The robot with an inertia of its file, of one motor or of all, that is referred to the link side of the gear."""
    own = evidence.assembly
    robot = own.linearisation.model.robot
    given = {name: value for name, (value, _) in robot.parameters().items() if name.startswith("Jm_") and value > 0}
    every = {name: value / robot.ratio(name.removeprefix("Jm_")) ** 2 for name, value in given.items()}
    groups = {f"inertia of motor {name.removeprefix('Jm_')}": {name: value} for name, value in every.items()}
    for name, numbers in (groups | ({"inertias of all motors": every} if len(every) > 1 else {})).items():
        index = named(f"{name} given on the link side, or in kg cm^2", "side of the gear")
        yield index, of_robot(evidence, robot.with_parameters(numbers), about(own.parameters, numbers))


def _encoders(evidence: Evidence) -> Iterator[Variant]:
    """The study with encoders of an axis, or of all axes, on the other side of the elastic gear."""
    own = evidence.assembly
    elastic = [joint.name for joint in own.linearisation.model.robot.driven if joint.is_flexible]
    for side, now, then in (("behind", "motor", "joint"), ("before", "joint", "motor")):
        moved = {f"{now} {name}": f"{then} {name}" for name in elastic}
        read = [place for place in moved if any(place in G.outputs for G in own.responses)]
        for places in (*([place] for place in read), *([read] if len(read) > 1 else ())):
            whose = f"encoder of axis {places[0].partition(' ')[2]}" if len(places) == 1 else "encoders of all axes"
            outputs = {place: moved[place] for place in places}
            responses = tuple(
                replace(G, outputs=tuple(outputs.get(place, place) for place in G.outputs)) for G in own.responses
            )
            yield named(f"{whose} {side} the gear", "side of the encoder"), replace(own, responses=responses)


def _settled(variant: Variant, evidence: Evidence, scores: Scores) -> tuple[ModificationIndex, float]:
    """The index of another study, and V of all lines at the optimum that a few steps reach from the start."""
    index, assembly = variant
    cost, x = math.inf, assembly.parameters.x
    try:
        fit = thinned(assembly.at(x, assembly.spec.criterion), MOST_RESIDUALS)
        cost, x = settle(AS_READ, fit, x, np.ones(len(x), dtype=bool))
        cost *= evidence.optimum.fit.n_residuals / max(fit.n_residuals, 1)
    except ElastidError:  # no robot stands there
        pass
    return against(index, cost, x, evidence, scores), cost
