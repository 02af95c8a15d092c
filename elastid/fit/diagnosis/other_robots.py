"""Other robots than the file's, each fitted with the tolerances about its own numbers.

They stand at the angles as another unit, direction or order has them, are mounted otherwise, do not carry the payload
that the file has, have inertias of motors or encoders on the other side of the gears, or have a spring that it lacks.
A fit that moved numbers within their tolerances to make up for a cause ends where no step leads to it; these begin at
the file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError
from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis.hypothesis import SCALE, Evidence, Scores
from elastid.fit.diagnosis.missing_springs import find_missing_springs
from elastid.fit.diagnosis.prediction import AS_READ, settle, thinned
from elastid.fit.diagnosis.score_test import Load, find_load, steps_of
from elastid.fit.diagnosis.scoring import at_file, score
from elastid.fit.diagnosis.variants import Variant, about, against, best, named, of_robot, read_otherwise
from elastid.fit.result import ModificationIndex
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.parameters import Parameter, Parameters, Prior
from elastid.robot import Payload


@dataclass(frozen=True)
class Limits:
    """Thresholds of the search among other robots."""

    explained_share: float = 0.9  # of the excess; where something else explains more, no other robot is tried
    whole: float = 0.99  # of it; where something else explains more, nor is another reading of the study
    share: float = 0.3  # of the excess that another robot explains
    discrete_share: float = 0.5  # the same of one that is mounted or read otherwise, which is so or is not
    left: float = 1e-3  # of a payload that is not carried
    iterations: int = 30  # of each fit
    rounds: int = 5  # of linearisations, in which a load is found
    settled: float = 0.99  # of V of the round before, from which on there is no further one
    load_radius: float = 0.1  # of gyration of a load at the start, m
    mass_std: float = 1.0  # of the logarithm of its mass about its linear step
    inertia_std: float = 1.5  # of that of its inertia about the start
    place_std: float = 0.5  # m
    enough: float = 0.5  # of V as read, below which a fit needs no further start


LIMITS = Limits()
EARTH = 9.81  # m/s^2


def find_other_robots(indices: list[ModificationIndex], evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """The indices with other robots that explain a part, in place of their linear steps, where nothing explains all."""
    explained = max((index.share for index in indices), default=0.0)
    if not evidence.is_unexplained or (explained > LIMITS.whole and not any(i.group == SCALE for i in indices)):
        return indices
    found = read_otherwise(evidence, scores) if evidence.is_suspect or explained <= LIMITS.explained_share else []
    searches = (_with_load, _mounted_otherwise, _with_springs)  # by their time
    # V that the file's own robot reaches from the starts of the others is no merit of theirs.
    own = (
        _judged((named("", ""), evidence.assembly), evidence, scores)[0]
        if explained <= LIMITS.explained_share
        else None
    )
    for search in searches:
        if max((explained, *(index.share for index in found))) <= LIMITS.explained_share:
            found += [_beyond(own, index) for index in search(evidence, scores)]
    # A direction of gravity or another reading has no size by which it could be a part of the cause.
    by_name = {
        index.name: index
        for index in found
        if index.share > (LIMITS.share if index.members or index.occam else LIMITS.discrete_share)
    }
    shares = {index.name: index.share for index in indices}
    better = {name for name, index in by_name.items() if index.share > shares.get(name, -math.inf)}
    return [*(index for index in indices if index.name not in better), *(by_name[name] for name in better)]


def _beyond(own: ModificationIndex | None, index: ModificationIndex) -> ModificationIndex:
    """The index with its drop of V below that of the file's own robot from the same starts."""
    if own is None or own.drop <= 0:
        return index
    return replace(index, drop=index.drop - own.drop, share=index.share - own.share)


def _with_load(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """By a load on the body where it explains most, fitted from there with its mass, place and inertia free.

    Resonances move farther with it than they are wide, so that its linear step is only a start.
    """
    loads = _loads(scores)
    body = max(loads, key=lambda name: loads[name].drop, default="")
    if evidence.assembly.linearisation.model.robot.payload is not None or not body or not loads[body].mass > 0:
        return []
    mass, place = loads[body].mass, _centre(scores, body) + loads[body].place
    loaded = _carrying(evidence, body, mass, place)
    if loaded is None or not loaded[0] < scores.cost:
        return []
    cost, p, x = loaded
    candidate = next(c for c in scores.candidates if c.name == f"payload_{body}")
    members = [scores.test.numbers[i] for i in candidate.places]
    p[1:] -= _centre(scores, body)
    index = ModificationIndex(
        name=candidate.name, group="payload", members=tuple(n.name for n in members),
        values=np.array([n.value for n in members]), units=tuple(n.unit for n in members),
        log=tuple(n.log for n in members), steps=steps_of(members, p), std=math.nan, drop=0.0, share=0.0,
        effects=np.zeros(0),
    )  # fmt: skip
    return [against(index, cost, x, evidence, scores)]


def _loads(scores: Scores) -> dict[str, Load]:
    """The best load of each body, by its name."""
    bodies = (c for c in scores.candidates if c.family == "payload" and c.directions.shape[1] > 1)
    loads = {c.name.removeprefix("payload_"): find_load(scores.test, c, scores.level, 0.0) for c in bodies}
    return {name: load for name, load in loads.items() if load is not None}


def _centre(scores: Scores, body: str) -> FloatArray:
    """The centre of mass (3,) of a body in the file, in its axes."""
    value = {number.name: number.value for number in scores.test.numbers}
    return np.array([value.get(f"c_{body}_{axis}", 0.0) for axis in "xyz"])


def _carrying(
    evidence: Evidence, body: str, mass: float, place: FloatArray
) -> tuple[float, FloatArray, FloatArray] | None:
    """V, mass (kg) and place (m) of a load (4,) in the axes of a body, and x (n_x,) of the fit with it from a start."""
    own, criterion = evidence.assembly, evidence.assembly.spec.criterion
    inertia, names = mass * LIMITS.load_radius**2, tuple(f"c_payload_{axis}" for axis in "xyz")
    robot = replace(own.linearisation.model.robot, payload=Payload(mass, tuple(place.tolist()), inertia, body))
    numbers = (
        Parameter("m_payload", mass, "kg", log=True, prior=Prior(mass, LIMITS.mass_std)),
        *(Parameter(n, float(v), "m", prior=Prior(float(v), LIMITS.place_std))
          for n, v in zip(names, place, strict=True)),
        Parameter("I_payload", inertia, "kg*m^2", log=True, prior=Prior(inertia, LIMITS.inertia_std)),
    )  # fmt: skip
    file, known = own.parameters, dict(zip(own.parameters.free_names, evidence.result.x.tolist(), strict=True))
    every = {p.name: p for p in (*file, *numbers)}
    in_order = tuple(every.pop(name) for name in robot.parameters(every) if name in every)
    parameters = Parameters((*in_order, *every.values()))
    asked = {p.name for p in file.free if not p.tolerated}
    x = np.array([known[p.name] if p.name in asked else p.to_x(p.value) for p in parameters.free])
    cost = math.inf
    try:
        assembly = Assembly.of(own.responses, robot, own.spec, parameters, own.model, (), own.weights)
        for _ in range(LIMITS.rounds):
            fit = assembly.at(x, criterion)
            _, near = settle(AS_READ, thinned(fit), x, np.ones(len(x), dtype=bool))
            x = solve(fit.problem, near, ROUGH, LIMITS.iterations).x
            before, cost = cost, assembly.at(x, criterion).evaluate(x).cost
            if not cost < LIMITS.settled * before:
                break
    except (ElastidError, np.linalg.LinAlgError):  # no robot stands on the way, or V has no slope there
        return None
    values = dict(zip(parameters.free_names, x.tolist(), strict=True))
    p = np.array([math.exp(values["m_payload"]), *(values.get(name, 0.0) for name in names)])
    return cost, p, np.array([values[name] for name in file.free_names])


def _with_springs(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """By springs that the file lacks, with its numbers as they stand."""
    of_file, found = at_file(evidence), list[ModificationIndex]()
    if of_file is None:
        return []
    scores_there = score(of_file)
    for spring in find_missing_springs([], of_file, scores_there):
        cost = min(of_file.optimum.end.cost, scores_there.cost) - spring.drop
        found.append(against(spring, cost, of_file.result.x + spring.effects, evidence, scores))
    return found


def _mounted_otherwise(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """By other directions of gravity and without the file's payload; the best, with those that equal it."""
    robot, parameters = evidence.assembly.linearisation.model.robot, evidence.assembly.parameters
    size = float(np.linalg.norm(robot.gravity)) or EARTH
    directions = {f"gravity along {sign}{axis} of the base": size * float(f"{sign}1") * row
                  for axis, row in zip("xyz", np.eye(3), strict=True) for sign in "+-"}  # fmt: skip
    variants: list[Variant] = [
        (named(name, "gravity"), of_robot(evidence, replace(robot, gravity=tuple(gravity.tolist())), parameters))
        for name, gravity in (directions | {"no gravity": np.zeros(3)}).items()
        if not np.allclose(gravity, robot.gravity, atol=0.1 * size)
    ]
    if robot.payload is not None and robot.payload.mass > 0:
        numbers = {n: v for n, (v, _) in robot.parameters().items() if n == "m_payload" or n.startswith("I_payload")}
        left = {name: LIMITS.left * value for name, value in numbers.items()}
        name = named("the payload of the file not carried", "payload of the file")
        variants.append((name, of_robot(evidence, robot.with_parameters(left), about(parameters, left))))
    return best(_judged(variant, evidence, scores) for variant in variants)


def _judged(variant: Variant, evidence: Evidence, scores: Scores) -> tuple[ModificationIndex, float]:
    """The index of another robot, and V of its fit on thinned lines, from the optimum's parameters and the study's."""
    index, assembly = variant
    cost, x, parameters = math.inf, evidence.optimum.end.x, assembly.parameters
    asked = np.array([not p.tolerated for p in parameters.free])
    for start in (np.where(asked, evidence.optimum.end.x, parameters.x), parameters.x):
        try:
            fit = thinned(assembly.at(start, assembly.spec.criterion))
            end = solve(fit.problem, start, ROUGH, LIMITS.iterations)
        except (ElastidError, np.linalg.LinAlgError):
            continue
        lines = fit.n_residuals / max(evidence.optimum.fit.n_residuals, 1)
        cost, x = min((cost, x), (end.cost / lines, end.x), key=lambda each: each[0])
        if cost < LIMITS.enough * scores.cost:
            break
    return against(index, cost, x, evidence, scores), cost
