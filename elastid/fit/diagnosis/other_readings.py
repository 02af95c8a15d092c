"""The study read otherwise: angles, sides of encoders, inertias of motors and a sampling rate that are far off.

A sampling rate of e times the stated one has frequencies e f, and motions from positions that are e^n of those read,
n = 2 of accelerations.  An inertia of a motor that is off by orders of magnitude is beyond any linear step, too: both
are sought on a grid from the numbers of the file, by the logarithmic criterion, and followed from the best.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError
from elastid.fit.diagnosis.hypothesis import Evidence, Scores
from elastid.fit.diagnosis.prediction import AS_READ, evaluate, logarithmic, settle, squares, start_distance, thinned
from elastid.fit.diagnosis.variants import Variant, about, against, best, named, of_robot
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.part import Part
from elastid.fit.result import ModificationIndex
from elastid.record import MOTION_ORDER


@dataclass(frozen=True)
class Limits:
    """Thresholds of the search for another reading of the study.

    rates: factors of a sampling rate, and their inverses, from which a linear step leads to any other.
    """

    whole: float = 0.99  # of the excess; where something else explains more, nothing far off is sought
    residuals: int = 2_000
    rates: tuple[float, ...] = (1.2, 1.25, 1.33, 1.5, 1.6, 2, 2.5, 3, 4, 5, 6, 8, 10, 16, 20, 32, 50, 64, 100, 1000)
    decades: float = 4.0  # to either side of an inertia of a motor
    steps_per_decade: int = 3
    usual_inertia: float = 0.05  # of ln Jm
    alike: float = 0.2  # of the logarithms of factors that are one
    cost_ratio: float = 0.7  # of V by the logarithmic criterion, that the best on a grid has of that as it is


LIMITS = Limits()


def read_otherwise(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """By the best of the study's other readings; by numbers that are far off where none of these explains all."""
    variants = (*_angles(evidence), *_motor_inertias(evidence), *_encoders(evidence))
    found = best(_settled(variant, evidence, scores) for variant in variants)
    if found and found[0].share > LIMITS.whole:
        return found
    x = evidence.assembly.parameters.x
    try:
        fit = thinned(evidence.assembly.at(x, evidence.assembly.spec.criterion), LIMITS.residuals)
    except ElastidError:
        return found
    far = (_rate(fit, x, evidence, scores), *_far_inertias(evidence, scores))
    return [*found, *best((index, -index.drop) for index in far if index is not None)]


def _logarithmic_cost(fit: ElasticFit, x: FloatArray) -> float:
    return sum(squares(evaluate(replace(fit, parts=tuple(map(logarithmic, fit.parts))), x)))


def _rate(fit: ElasticFit, x: FloatArray, evidence: Evidence, scores: Scores) -> ModificationIndex | None:
    """By a sampling rate that is a multiple or a part of the stated one."""
    factors = sorted((*LIMITS.rates, *(1 / e for e in LIMITS.rates)))
    costs = [_logarithmic_cost(replace(fit, parts=tuple(_at_rate(part, e) for part in fit.parts)), x) for e in factors]
    if not min(costs) < LIMITS.cost_ratio * _logarithmic_cost(fit, x):
        return None
    e = factors[int(np.argmin(costs))]
    read = replace(fit, parts=tuple(_at_rate(part, e) for part in fit.parts))
    cost, end = settle(AS_READ, read, x, np.ones(len(x), dtype=bool))
    cost *= evidence.optimum.fit.n_residuals / max(fit.n_residuals, 1)
    words = f"of {e:g} times" if e > 1 else f"of 1/{1 / e:g} of"
    index = named(f"a sampling rate {words} the stated one", "far rate")
    return against(replace(index, occam=start_distance(fit.parameters, end)), cost, end, evidence, scores)


def _at_rate(part: Part, e: float) -> Part:
    """The responses at e times their frequencies, as logs of positions have them."""
    model, power = part.kernel.model, e ** MOTION_ORDER[part.kernel.model.quantity]
    hold = model.hold and replace(model.hold, rates_hz=tuple(e * rate for rate in model.hold.rates_hz))
    kernel = replace(part.kernel, model=replace(model, hold=hold), freq_hz=e * part.kernel.freq_hz)
    gain = part.gain if part.criterion == "log" else part.gain / power
    return replace(part, kernel=kernel, measured=power * part.measured, gain=gain, whitening=None, compressed=None)


def _far_inertias(evidence: Evidence, scores: Scores) -> Iterator[ModificationIndex]:
    """By inertias of motors, one or all by one factor, that are orders of magnitude off."""
    own, known = evidence.assembly, evidence.assembly.parameters
    given = [p for p in known if p.name.startswith("Jm_") and p.value > 0 and (p.tolerated or not p.is_free)]
    groups = [[p.name] for p in given] + ([[p.name for p in given]] if len(given) > 1 else [])
    span = math.log(10) * LIMITS.decades
    steps = np.linspace(-span, span, 2 * round(LIMITS.decades * LIMITS.steps_per_decade) + 1)
    for names in groups:
        wide = math.exp(2 * span)
        freed = tuple(
            replace(p, free=True, tie=None, prior=None, log=True, lower=p.value / wide, upper=p.value * wide,
                    tolerated=True) if p.name in names else p for p in known
        )  # fmt: skip
        parameters = replace(known, parameters=freed)
        try:
            fit = thinned(replace(own, parameters=parameters).at(parameters.x, own.spec.criterion), LIMITS.residuals)
        except ElastidError:
            continue
        moved = np.array([name in names for name in parameters.free_names])
        costs = [_logarithmic_cost(fit, parameters.x + step * moved) for step in steps.tolist()]
        start = float(steps[int(np.argmin(costs))])
        if not min(costs) < LIMITS.cost_ratio * _logarithmic_cost(fit, parameters.x):
            continue
        cost, x = settle(AS_READ, fit, parameters.x + start * moved, np.ones(len(moved), dtype=bool))
        cost *= evidence.optimum.fit.n_residuals / max(fit.n_residuals, 1)
        found = dict(zip(parameters.free_names, x.tolist(), strict=True))
        factors = [found[p.name] - math.log(p.value) for p in given if p.name in names]
        if max(factors) - min(factors) > LIMITS.alike:
            continue
        yield against(_inertia(names, found, evidence), cost, _as_fitted(found, evidence), evidence, scores)


def _inertia(names: Sequence[str], found: dict[str, float], evidence: Evidence) -> ModificationIndex:
    """The index of inertias with these logarithms; of several their mean factor."""
    values = np.array([evidence.assembly.parameters[name].value for name in names])
    own = np.array([found[name] for name in names]) - np.log(values)
    steps = np.full(len(names), own.mean())
    name = names[0] if len(names) == 1 else "Jm_*"
    n = len(names)
    return replace(
        named(name, "motor inertia"), members=tuple(names), values=values, units=("kg*m^2",) * n, log=(True,) * n,
        steps=steps, occam=2 * n * math.log1p((float(own[0]) / LIMITS.usual_inertia) ** 2),
    )  # fmt: skip


def _as_fitted(found: dict[str, float], evidence: Evidence) -> FloatArray:
    """x (n_x,) of the parameters of the fit."""
    names, x = evidence.result.parameters.free_names, evidence.result.x.tolist()
    return np.array([found.get(name, value) for name, value in zip(names, x, strict=True)])


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
        fit = thinned(assembly.at(x, assembly.spec.criterion), LIMITS.residuals)
        cost, x = settle(AS_READ, fit, x, np.ones(len(x), dtype=bool))
        cost *= evidence.optimum.fit.n_residuals / max(fit.n_residuals, 1)
    except ElastidError:  # no robot stands there
        pass
    return against(index, cost, x, evidence, scores), cost
