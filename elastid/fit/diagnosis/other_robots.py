"""Other robots than the file's, each fitted with the tolerances about its own numbers.

They stand at the angles as another unit, direction or order has them, are mounted otherwise, do not carry the payload
that the file has, have inertias of motors or encoders on the other side of the gears, or have a spring that it lacks.
A fit that moved numbers within their tolerances to make up for a cause ends where no step leads to it; these begin at
the file.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError
from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis.hypothesis import Evidence, Scores
from elastid.fit.diagnosis.missing_springs import find_missing_springs
from elastid.fit.diagnosis.payload_search import Load, find_load, steps_of
from elastid.fit.diagnosis.prediction import AS_READ, settle, thinned
from elastid.fit.diagnosis.ranking import temper
from elastid.fit.diagnosis.scoring import at_file, score
from elastid.fit.diagnosis.swinging_part import find_swinging_part
from elastid.fit.result import ModificationIndex
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.parameters import Parameter, ParameterSet, Prior
from elastid.robot import Payload, Robot

Variant: TypeAlias = tuple[ModificationIndex, Assembly]


@dataclass(frozen=True)
class Limits:
    """Thresholds of the search among other robots.  False alarms of 300 clean logs: modification-index 2."""

    explained_share: float = 0.9  # of the excess; where something else explains more, no other robot is tried
    whole: float = 0.99  # of it; where something else explains more, nor is another reading of the study
    share: float = 0.3  # of the excess that another robot explains
    cost_ratio: float = 1.1  # of V, below which those mounted otherwise cannot be distinguished
    slope: float = 0.1  # tangent of the tilts of a base that are tried
    slope_excess: float = 1.5  # of V over the noise's, from which on it is sought: it takes six fits
    steepest: float = 0.5  # of one that is found
    left: float = 1e-3  # of a payload that is not carried
    iterations: int = 30  # of each fit
    rounds: int = 5  # of linearisations, in which a load is found
    settled: float = 0.99  # of V of the round before, from which on there is no further one
    load_radius: float = 0.1  # of gyration of a load at the start, m
    mass_std: float = 1.0  # of the logarithm of its mass about its linear step
    inertia_std: float = 1.5  # of that of its inertia about the start
    place_std: float = 0.5  # m
    residuals: int = 2_000  # of a study that is read otherwise
    enough: float = 0.5  # of V as read, below which a fit needs no further start


LIMITS = Limits()


def find_other_robots(indices: list[ModificationIndex], evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """The indices with other robots that explain a part, in place of their linear steps, where nothing explains all."""
    explained = max((index.share for index in indices), default=0.0)
    if not evidence.is_unexplained or explained > LIMITS.whole:
        return indices
    found = list[ModificationIndex]()
    for search in (
        _read_otherwise,
        _with_load,
        _mounted_otherwise,
        _on_a_slope,
        _with_springs,
        _with_swinging_part,
    ):  # by their time
        if search is _read_otherwise or explained <= LIMITS.explained_share:
            found += search(evidence, scores)
            explained = max((explained, *(index.share for index in found)))
    by_name = {index.name: index for index in found if index.share > LIMITS.share}
    better = {name for name, index in by_name.items() if index.share > _share_of(name, indices)}
    return [*(index for index in indices if index.name not in better), *(by_name[name] for name in better)]


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
    return [_against(index, cost, x, evidence, scores)]


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
    parameters = ParameterSet((*in_order, *every.values()))
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
    except ElastidError:
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
        found.append(_against(spring, cost, of_file.result.x + spring.effects, evidence, scores))
    return found


def _with_swinging_part(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """By a part of the last body that swings, with the numbers of the file as they stand."""
    there = at_file(evidence) or evidence
    part = find_swinging_part(there)
    if part is None:
        return []
    name = f"swing_{part.body}"
    index = replace(_named(name, "swinging part"), members=(name,), values=np.zeros(1), units=("Hz",), log=(False,),
                    steps=np.array([part.freq_hz]), occam=part.occam)  # fmt: skip
    lines = thinned(there.optimum.fit).n_residuals / max(evidence.optimum.fit.n_residuals, 1)
    return [_against(index, part.cost / lines, part.x, evidence, scores)]


def _share_of(name: str, indices: list[ModificationIndex]) -> float:
    return max((index.share for index in indices if index.name == name), default=-math.inf)


def _mounted_otherwise(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """By other directions of gravity and without the file's payload; the best, with those that equal it."""
    robot, parameters = evidence.assembly.linearisation.model.robot, evidence.assembly.parameters
    size = float(np.linalg.norm(robot.gravity)) or 9.81
    directions = {f"gravity along {sign}{axis} of the base": size * float(f"{sign}1") * row
                  for axis, row in zip("xyz", np.eye(3), strict=True) for sign in "+-"}  # fmt: skip
    variants: list[Variant] = [
        (_named(name, "gravity"), _of_robot(evidence, replace(robot, gravity=tuple(gravity.tolist())), parameters))
        for name, gravity in (directions | {"no gravity": np.zeros(3)}).items()
        if not np.allclose(gravity, robot.gravity, atol=0.1 * size)
    ]
    if robot.payload is not None and robot.payload.mass > 0:
        numbers = {n: v for n, (v, _) in robot.parameters().items() if n == "m_payload" or n.startswith("I_payload")}
        left = {name: LIMITS.left * value for name, value in numbers.items()}
        name = _named("the payload of the file not carried", "payload of the file")
        variants.append((name, _of_robot(evidence, robot.with_parameters(left), _about(parameters, left))))
    return _best(_judged(variant, evidence, scores) for variant in variants)


def _on_a_slope(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """By a base that is tilted, as far and where to as a paraboloid of V through tilts about two axes has it."""
    robot = evidence.assembly.linearisation.model.robot
    size = float(np.linalg.norm(robot.gravity))
    if size == 0 or scores.cost < LIMITS.slope_excess * scores.noise:
        return []
    down = np.array(robot.gravity) / size
    across = np.linalg.svd(down[None])[2][1:]

    def judged(slopes: FloatArray) -> tuple[ModificationIndex, float]:
        along = down + slopes @ across
        along /= np.linalg.norm(along)
        name = f"gravity along ({', '.join(f'{v:.2g}' for v in along + 0.0)}) of the base"
        tilted = replace(robot, gravity=tuple((size * along).tolist()))
        variant = _named(name, "gravity"), _of_robot(evidence, tilted, evidence.assembly.parameters)
        return _judged(variant, evidence, scores)

    h, V = LIMITS.slope, scores.cost
    further, less = (np.array([judged(sign * h * one)[1] for one in np.eye(2)]) for sign in (1, -1))
    # V(s) = V + g s + s H s / 2, in units of h.
    g, H = (further - less) / 2, np.diag(further + less - 2 * V)
    H[0, 1] = H[1, 0] = judged(h * np.ones(2))[1] - further.sum() + V
    if not np.all(np.isfinite(H)) or np.linalg.eigvalsh(H)[0] <= 0:
        return []
    slopes = -np.linalg.solve(H, g)
    _, narrowed = np.linalg.slogdet(np.eye(2) + H / 2 * scores.lines / temper(scores))
    index = judged(np.clip(h * slopes, -LIMITS.steepest, LIMITS.steepest))[0]
    return [replace(index, occam=float(narrowed + 2 * np.sum(np.log1p(slopes**2))))]


def _best(judged: Iterable[tuple[ModificationIndex, float]]) -> list[ModificationIndex]:
    """The index of least V, with the names of those that cannot be distinguished from it."""
    by_cost = sorted(judged, key=lambda trial: trial[1])
    equal = (index.name for index, V in by_cost[1:] if LIMITS.cost_ratio * by_cost[0][1] > V)
    return [replace(by_cost[0][0], alike=tuple(equal))] if by_cost else []


def _of_robot(evidence: Evidence, robot: Robot, parameters: ParameterSet) -> Assembly:
    own = evidence.assembly
    return Assembly.of(own.responses, robot, own.spec, parameters, own.model, (), own.weights)


def _read_otherwise(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """By angles of all configurations, inertias of motors or places of encoders that the study does not mean so."""
    if not evidence.is_suspect:
        return []
    variants = (*_angles(evidence), *_motor_inertias(evidence), *_encoders(evidence))
    return _best(_settled(variant, evidence, scores) for variant in variants)


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
            yield _named(name, "postures"), replace(own, responses=tuple(responses))


def _motor_inertias(evidence: Evidence) -> Iterator[Variant]:
    """The robot with an inertia of its file, of one motor or of all, that is referred to the link side of the gear."""
    own = evidence.assembly
    robot = own.linearisation.model.robot
    given = {name: value for name, (value, _) in robot.parameters().items() if name.startswith("Jm_") and value > 0}
    every = {name: value / robot.ratio(name.removeprefix("Jm_")) ** 2 for name, value in given.items()}
    groups = {f"inertia of motor {name.removeprefix('Jm_')}": {name: value} for name, value in every.items()}
    for name, numbers in (groups | ({"inertias of all motors": every} if len(every) > 1 else {})).items():
        index = _named(f"{name} given on the link side, or in kg cm^2", "side of the gear")
        yield index, _of_robot(evidence, robot.with_parameters(numbers), _about(own.parameters, numbers))


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
            yield _named(f"{whose} {side} the gear", "side of the encoder"), replace(own, responses=responses)


def _settled(variant: Variant, evidence: Evidence, scores: Scores) -> tuple[ModificationIndex, float]:
    """The index of another study, and V of all lines at the optimum that a few steps reach from the start."""
    index, assembly = variant
    cost, x = math.inf, assembly.parameters.x
    try:
        fit = thinned(assembly.at(x, assembly.spec.criterion), LIMITS.residuals)
        cost, x = settle(AS_READ, fit, x, np.ones(len(x), dtype=bool))
        cost *= evidence.optimum.fit.n_residuals / max(fit.n_residuals, 1)
    except ElastidError:  # no robot stands there
        pass
    return _against(index, cost, x, evidence, scores), cost


def _named(name: str, family: str) -> ModificationIndex:
    none = np.zeros(0)
    return ModificationIndex(name, family, (), none, (), (), none, math.nan, 0.0, 0.0, none)


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
    """The index of another robot, and V of its fit on thinned lines, from the optimum's parameters and the study's."""
    index, assembly = variant
    cost, x, parameters = math.inf, evidence.optimum.end.x, assembly.parameters
    asked = np.array([not p.tolerated for p in parameters.free])
    for start in (np.where(asked, evidence.optimum.end.x, parameters.x), parameters.x):
        try:
            fit = thinned(assembly.at(start, assembly.spec.criterion))
            end = solve(fit.problem, start, ROUGH, LIMITS.iterations)
        except ElastidError:
            continue
        lines = fit.n_residuals / max(evidence.optimum.fit.n_residuals, 1)
        cost, x = min((cost, x), (end.cost / lines, end.x), key=lambda each: each[0])
        if cost < LIMITS.enough * scores.cost:
            break
    return _against(index, cost, x, evidence, scores), cost


def _against(
    index: ModificationIndex, cost: float, x: FloatArray, evidence: Evidence, scores: Scores
) -> ModificationIndex:
    """The index where V (cost) and x (n_x,) are those of a fit with it."""
    drop = scores.cost - cost if math.isfinite(cost) else 0.0
    share = drop / max(scores.cost - scores.noise, drop, 1e-300)
    return replace(index, drop=drop, share=share, effects=x - evidence.result.x)
