"""Variants of a study, each fitted from the study's start: other robots than the file's, or the same read otherwise.

They stand at the angles as another unit, direction or order has them, have inertias of motors or encoders on the other
side of the gears, are mounted otherwise, or do not carry the payload that the file has.  A fit that moved numbers
within their tolerances to make up for such a cause ends where no step leads to it; these begin at the file, with the
tolerances about their own numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from elastid.base.errors import ElastidError
from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis.hypothesis import LIMITS, SCALE, Evidence, Scores
from elastid.fit.diagnosis.prediction import AS_READ, settle, thinned
from elastid.fit.diagnosis.score_test import LEAST
from elastid.fit.result import ModificationIndex
from elastid.parameters import Parameter, Parameters
from elastid.robot import Robot


class Variant(NamedTuple):
    """The study otherwise: of another robot, or with other responses."""

    name: str
    family: str
    assembly: Assembly


def find_variants(indices: list[ModificationIndex], evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """The indices with the best variant, where nothing explains all."""
    explained = max((index.share for index in indices), default=0.0)
    is_explained = explained > LIMITS.whole and not any(i.group == SCALE for i in indices)
    if not evidence.is_unexplained or is_explained:
        return indices
    judged = sorted((_judged(each, evidence, scores) for each in _variants(evidence)), key=lambda trial: trial[1])
    # V that the file's own robot reaches from the study's start is no merit of a variant.
    as_stated = min(_judged(Variant("", "", evidence.assembly), evidence, scores)[1], scores.cost)
    first, least = judged[0]
    if not (as_stated - least > LIMITS.half * (as_stated - scores.noise) and first.share > explained):
        return indices
    equal = tuple(index.name for index, V in judged[1:] if LIMITS.equal_cost * least > V)
    return [*indices, replace(first, alike=equal)]


def _judged(variant: Variant, evidence: Evidence, scores: Scores) -> tuple[ModificationIndex, float]:
    """The index of a variant, and V of all lines at the best optimum that a few steps reach."""
    cost, x, parameters = math.inf, variant.assembly.parameters.x, variant.assembly.parameters
    asked = np.array([not p.tolerated for p in parameters.free])
    for start in (parameters.x, np.where(asked, evidence.optimum.end.x, parameters.x)):
        with suppress(ElastidError, np.linalg.LinAlgError):  # no robot stands there, or V has no slope
            fit = thinned(variant.assembly.at(start, variant.assembly.spec.criterion), LIMITS.residuals)
            V, end = settle(AS_READ, fit, start, np.ones(len(start), dtype=bool))
            V *= evidence.optimum.fit.n_residuals / max(fit.n_residuals, 1)
            cost, x = min((cost, x), (V, end), key=lambda each: each[0])
    drop = scores.cost - cost if math.isfinite(cost) else 0.0
    share, effects = drop / max(scores.cost - scores.noise, drop, 1e-300), x - evidence.result.x
    return ModificationIndex(variant.name, variant.family, drop=drop, share=share, effects=effects), cost


def _variants(evidence: Evidence) -> Iterator[Variant]:
    """Every variant by its name."""
    yield from _angles(evidence)
    yield from _encoders(evidence)
    own = evidence.assembly
    robot, parameters = own.linearisation.model.robot, own.parameters
    for name, family, other, numbers in (*_motor_inertias(robot), *_mounted_otherwise(robot)):
        about = _about(parameters, numbers)
        yield Variant(name, family, Assembly.of(own.responses, other, own.spec, about, own.model, (), own.weights))


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
    for name, change in changes.items():
        stood = stated @ change.T
        if not np.allclose(stood, stated):
            places = [replace(G.configuration, angles=row) for G, row in zip(own.responses, stood, strict=True)]
            responses = (replace(G, configuration=place) for G, place in zip(own.responses, places, strict=True))
            yield Variant(name, "postures", replace(own, responses=tuple(responses)))


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
            yield Variant(f"{whose} {side} the gear", "side of the encoder", replace(own, responses=responses))


# Name, family, robot, and the numbers about which tolerances are.
_Other: TypeAlias = tuple[str, str, Robot, Mapping[str, float]]


def _motor_inertias(robot: Robot) -> Iterator[_Other]:
    """The robot with an inertia of its file, of one motor or of all, that is referred to the link side of the gear."""
    given = {name: value for name, (value, _) in robot.parameters().items() if name.startswith("Jm_") and value > 0}
    every = {name: value / robot.ratio(name.removeprefix("Jm_")) ** 2 for name, value in given.items()}
    groups = {f"inertia of motor {name.removeprefix('Jm_')}": {name: value} for name, value in every.items()}
    for name, numbers in (groups | ({"inertias of all motors": every} if len(every) > 1 else {})).items():
        words = f"{name} given on the link side, or in kg cm^2"
        yield words, "side of the gear", robot.with_parameters(numbers), numbers


def _mounted_otherwise(robot: Robot) -> Iterator[_Other]:
    """The robot with other directions of gravity, and without the payload of its file."""
    size = float(np.linalg.norm(robot.gravity)) or 9.81
    directions = {f"gravity along {sign}{axis} of the base": size * float(f"{sign}1") * row
                  for axis, row in zip("xyz", np.eye(3), strict=True) for sign in "+-"}  # fmt: skip
    for name, gravity in (directions | {"no gravity": np.zeros(3)}).items():
        if not np.allclose(gravity, robot.gravity, atol=0.1 * size):
            yield name, "gravity", replace(robot, gravity=tuple(gravity.tolist())), {}
    if robot.payload is not None and robot.payload.mass > 0:
        numbers = {n: v for n, (v, _) in robot.parameters().items() if n == "m_payload" or n.startswith("I_payload")}
        left = {name: LEAST * value for name, value in numbers.items()}
        yield "the payload of the file not carried", "payload of the file", robot.with_parameters(left), left


def _about(parameters: Parameters, numbers: Mapping[str, float]) -> Parameters:
    """Parameters with tolerances about other numbers."""

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
