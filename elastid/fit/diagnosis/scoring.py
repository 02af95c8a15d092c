"""The score test of everything that a fit held, at its optimum."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.diagnosis.hypothesis import Columns, Evidence, Hypothesis, Scores, hypothesis_of
from elastid.fit.diagnosis.prediction import spread_out, thinned
from elastid.fit.diagnosis.response_columns import inertial
from elastid.fit.diagnosis.score_test import Candidate, HeldNumber, ScoreTest, free_step
from elastid.fit.diagnosis.sensitivities import HeldModel, evaluate_held
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.part import Part
from elastid.robot import Robot

RESIDUALS = 60_000  # real ones of the score test; with more, every so many lines are taken


# J^T J (n, n), J^T r (n,) and r^T r, and the names of the columns of J after those of x (n_x,).
_Sums: TypeAlias = tuple[FloatArray, FloatArray, float, tuple[str, ...]]


def score(evidence: Evidence) -> Scores:
    """The score test at the optimum; parameters at a bound stay there."""
    assembly, fit, x = evidence.assembly, evidence.optimum.fit, evidence.optimum.end.x
    held = HeldModel.of(assembly, fit.parts[0].kernel.model)
    # Each configuration brings some twenty numbers.
    thin = thinned(replace(fit, parts=fit.parts[spread_out(len(fit.parts))]), RESIDUALS)
    columns = tuple(h.columns for h in evidence.hypotheses if h.columns is not None)
    sums = partial(_sums, held, replace(thin, parts=()), x, columns)  # each part goes by itself
    A, b, V, names = _added(evidence.execution.ordered(sums, [part for part in thin.parts if part.n_residuals]), len(x))
    numbers, scale = _held_numbers(names, evidence, held, x)
    every, lines = np.concatenate([np.ones(len(x)), scale]), thin.n_residuals / max(fit.n_residuals, 1)
    A, b, beyond, pull = _with_priors(A * np.outer(every, every), b * every, evidence, lines)
    numbers += beyond
    test = ScoreTest.of(numbers, A, b, ~evidence.result.at_bound)
    freed = tuple(candidates(numbers, held.linearisation.model.robot, evidence.hypotheses))
    moved, drop = free_step(A, b, ~evidence.result.at_bound)
    noise, V = evidence.noise_cost * lines, V + pull - drop
    level = (noise or V) / max(thin.n_residuals - len(x), 1)
    return Scores(held, test, freed, V - noise, level, lines, evidence.noise_cost, moved)


def _with_priors(
    A: FloatArray, b: FloatArray, evidence: Evidence, lines: float
) -> tuple[FloatArray, FloatArray, list[HeldNumber], float]:
    """A and b with priors and static loads, and numbers that are off by more than their tolerance; those, and that V.

    Such a number shifts the mean of its prior, whose residual is (x - mean - shift) / s.  lines: share of all.
    """
    distance, slope = evidence.optimum.fit.priors(evidence.optimum.end.x)
    weight, pull, free = lines * slope**2, lines * slope * distance, evidence.result.parameters.free
    n_x = len(free)
    A[range(n_x), range(n_x)] += weight
    b[:n_x] += pull
    r, J = evidence.optimum.fit.static(evidence.optimum.end.x)
    A[:n_x, :n_x] += lines * J.T @ J
    b[:n_x] += lines * J.T @ r
    shifted = [i for i, p in enumerate(free) if p.tolerated and slope[i] > 0]
    A, b = np.pad(A, (0, len(shifted))), np.append(b, -pull[shifted])
    numbers = []
    for place, i in zip(range(len(b) - len(shifted), len(b)), shifted, strict=True):
        A[place, place], A[i, place], A[place, i] = weight[i], -weight[i], -weight[i]
        parameter, prior = free[i], free[i].prior
        hypothesis = hypothesis_of(parameter.name, evidence.hypotheses)
        number = hypothesis.number(parameter.name, prior.mean if prior is not None else 0.0, parameter.unit, True)
        numbers.append(replace(number, log=parameter.log))
    return A, b, numbers, float(lines * (distance @ distance + r @ r))


def _sums(held: HeldModel, fit: ElasticFit, x: FloatArray, columns: Sequence[Columns], part: Part) -> _Sums:
    # Residuals are those of the fit's own model: what is rigid there gives way a little in the other.
    G = part.kernel.response(fit.theta(part, x))
    evaluated = replace(evaluate_held(held, fit.parameters, x, columns, part), G=G)
    J = -evaluated.whitened(np.concatenate([evaluated.free, np.stack(list(evaluated.held.values()))]))
    r = evaluated.residual
    return J @ J.T, J @ r, float(r @ r), tuple(evaluated.held)


def _added(every: Iterable[_Sums], n_x: int) -> _Sums:
    names: dict[str, int] = {}
    A, b, V = np.zeros((n_x, n_x)), np.zeros(n_x), 0.0
    for own_A, own_b, own_V, held in every:
        for name in held:
            names.setdefault(name, len(names))
        more = n_x + len(names) - len(b)
        A, b = np.pad(A, (0, more)), np.pad(b, (0, more))
        places = np.concatenate([np.arange(n_x), [n_x + names[name] for name in held]]).astype(int)
        A[np.ix_(places, places)] += own_A
        b[places] += own_b
        V += own_V
    return A, b, V, tuple(names)


def _held_numbers(
    names: Sequence[str], evidence: Evidence, held: HeldModel, x: FloatArray
) -> tuple[list[HeldNumber], FloatArray]:
    """The numbers by name, and dp / d ln p (n_h,) of the logarithmic ones."""
    assembly, robot = evidence.assembly, held.linearisation.model.robot
    theta = held.theta(assembly.parameters, x, assembly.responses[0].configuration.name)
    values = dict(zip(held.parameters, theta.tolist(), strict=True))
    units = {name: unit for name, (_, unit) in robot.parameters(held.linearisation.model.parameters).items()}
    numbers, scale = [], []
    units |= {f"angle_{joint.name}": "m" for joint in robot.driven if joint.slides}
    turning = (joint for joint in robot.joints if not joint.slides and f"k_{joint.name}" not in held.rigid)
    springs = [joint.spring.stiffness for joint in turning if joint.spring is not None]
    for name in names:
        stem, is_ratio = name.partition("@")[0], name.startswith("ratio_")
        value, unit = values.get(stem, 0.0), units.get(stem, "")
        if name in held.rigid:
            name, value, unit = held.rigid[name], 0.0, ""
        elif is_ratio:
            value = abs(robot.ratio(name.removeprefix("ratio_")))
        number = hypothesis_of(name, evidence.hypotheses).number(name, value, unit)
        if math.isinf(number.usual) and name in held.rigid.values() and springs:
            number = replace(number, usual=1 / float(np.median(springs)))  # rad/(N*m), as of the robot's own springs
        numbers.append(number)
        scale.append(number.value if number.log and not is_ratio else 1.0)  # the slope of a ratio is to its logarithm
    return numbers, np.array(scale)


def candidates(numbers: Sequence[HeldNumber], robot: Robot, hypotheses: Sequence[Hypothesis]) -> list[Candidate]:
    """Each number alone, then common factors of several, then what one cause changes together.

    A torque constant that is wrong in every drive is one error and not six: gain_u_* is a factor of all of them.  A
    payload changes mass, centre and inertia of a body; the angle of an axis may be off in every posture.
    """
    place = {number.name: i for i, number in enumerate(numbers)}
    doubled = {f"angle_{name.removeprefix('zero_')}" for name in place if name.startswith("zero_")}
    parts = doubled | {
        name for name in place for prefix in ("m_", "c_", "I_") if name.startswith(prefix) and "@" in name
    }
    every = [
        Candidate(n.name, n.family, np.array([i]), np.eye(1)) for i, n in enumerate(numbers) if n.name not in parts
    ]

    def add_common(name: str, members: list[int]) -> None:
        if len(members) > 1 and len({numbers[i].log for i in members}) == 1:
            every.append(Candidate(name, numbers[members[0]].family, np.array(members), np.ones((len(members), 1))))

    def add_together(name: str, family: str, members: list[int]) -> None:
        if len(members) > 1:
            every.append(Candidate(name, family, np.array(members), np.eye(len(members))))

    for prefix in (prefix for h in hypotheses if h.is_common for prefix in h.numbers):
        add_common(f"{prefix}_*", [i for name, i in place.items() if name.startswith(f"{prefix}_")])
    for body in robot.bodies:
        moments = [f"I_{body.name}_{axis}" for axis in ("xx", "yy", "zz")]
        if f"I_{body.name}" not in place:
            add_common(f"I_{body.name}_*", [place[name] for name in moments if name in place])
    for name, family, members in _of_one_cause(robot, place):
        add_together(name, family, [place[member] for member in members if member in place])
    return every


def _of_one_cause(robot: Robot, place: dict[str, int]) -> Iterator[tuple[str, str, list[str]]]:
    """Name, family and members: of payloads, and of angles that are off in all postures."""
    postures = sorted({name.partition("@")[2] for name in place if "@" in name})
    for body in robot.bodies:
        yield f"payload_{body.name}", "payload", inertial(body)
        for posture in postures:
            own = [f"{name}@{posture}" for name in inertial(body)]  # none but of the last body
            yield f"payload_{body.name}@{posture}", "payload of one posture", own
    for joint in robot.driven:
        yield f"angles_{joint.name}", "angles by posture", [f"angle_{joint.name}@{posture}" for posture in postures]
