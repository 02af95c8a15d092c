r"""Misreadings: responses that were read wrongly, as changes of the model's, each followed to an optimum.

.. math:: \hat G \approx S G, \quad P G, \quad G^*, \quad j G^*, \quad (j \omega)^k G, \quad
          |\hat G_{ij}| \approx \frac{|G_{ij}|}{c_i c_j}

A channel of the other sign, channels or postures exchanged, phases counted by exp(-j omega t), real and imaginary parts
exchanged, a velocity taken for an acceleration, channels in another unit.  A fit of responses that were read wrongly
may end anywhere: one evaluation at its optimum and one at its start predict V of every reading, and the best of them
take some steps on a few lines.  Where these end in a valley too, the best is solved from the study's start with the
numbers of the file held, as every fit begins.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import ElastidError
from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis.hypothesis import SCALE, Changes, Evidence, Hypothesis, Scores
from elastid.fit.diagnosis.prediction import Reading, evaluate, predict, settle, squares, start_distance, thinned
from elastid.fit.diagnosis.sensitivities import Evaluated
from elastid.fit.parameter_choice import choose
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.least_squares import ResidualKind
from elastid.fit.result import ModificationIndex
from elastid.fit.solve.solvers import NEAR, ROUGH, solve


@dataclass(frozen=True)
class Limits:
    """Thresholds of the judgement of readings."""

    exchanged: int = 8  # configurations that fit worst, which are tried in each other's place
    alone: int = 2  # configurations that fit worst, of which one alone may be read otherwise
    followed: int = 3  # readings
    predicted_ratio: float = 1.5  # V over that of the fit up to which readings are followed
    iterations: int = 60  # of a solution from the study's start
    share: float = 0.8  # of the excess that a reading explains
    whole: float = 0.99  # of it, below which a reading is solved from the study's start, too
    cost_ratio: float = 1.1  # of V, below which readings cannot be distinguished
    scale: float = 1.7  # a factor nearer to one may be an inertia that is not quite known
    scale_rounds: int = 2  # in which scales and parameters are found in turn


LIMITS = Limits()
OF_ONE = ("sign", "direction", "exchanged channels")  # families that may be of one configuration alone


def find_misreading(indices: list[ModificationIndex], evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """The indices with the best reading, and the names of those that cannot be distinguished from it."""
    if not evidence.is_unexplained:
        return indices
    optimum, result = evidence.optimum, evidence.result
    fit, x = thinned(optimum.fit), optimum.end.x
    every = np.ones(len(x), dtype=bool)
    costs = np.array(squares(evaluate(fit, x)))
    predicted = [  # V of every reading after one step from each start
        (predict(reading, evaluated, fit.prior_slopes, free).cost, reading, start)
        for start, free in ((x, ~result.at_bound), (fit.parameters.x, every))
        for evaluated in (evaluate(fit, start),)
        for hypothesis in evidence.hypotheses
        for common in (hypothesis.changes(evaluated, costs) if hypothesis.changes is not None else ())
        for reading in (common, *_of_one(common, evaluated, costs))
    ]
    followed: dict[str, tuple[float, FloatArray, Reading]] = {}
    for cost, reading, start in sorted(predicted, key=lambda trial: trial[0]):
        if len(followed) >= LIMITS.followed or cost > LIMITS.predicted_ratio * costs.sum():
            break
        if reading.name not in followed:
            followed[reading.name] = (*settle(reading, fit, start, every), reading)
    noise = scores.noise * fit.n_residuals / max(optimum.fit.n_residuals, 1)
    as_read = min(float(costs.sum()), scores.cost * fit.n_residuals / max(optimum.fit.n_residuals, 1))
    excess = max(as_read - noise, 1e-300)

    def explains(cost: float, share: float = LIMITS.share) -> bool:
        return as_read - cost > share * excess

    if followed and not any(explains(cost, LIMITS.whole) for cost, _, _ in followed.values()):
        lowest = min(cost for cost, _, _ in followed.values())
        for name, (cost, _, reading) in tuple(followed.items()):  # all that cannot be distinguished from the best
            if cost > LIMITS.cost_ratio * lowest:
                continue
            with suppress(ElastidError):  # no robot stands there
                there, start = _from_the_file(reading, evidence)
                trials = (followed[name], (*settle(reading, there, start, every), reading))
                followed[name] = min(trials, key=lambda trial: trial[0])
    if not any(explains(cost, LIMITS.whole) for cost, _, _ in followed.values()):
        for name, cost, x_end in _scaled(fit, (fit.parameters.x, x)):
            followed[name] = (cost, x_end, Reading(name, SCALE, lambda _, values: values))
    good = sorted((trial for trial in followed.values() if explains(trial[0])), key=lambda trial: trial[0])
    if not good:
        return indices
    cost, x_end, best = good[0]
    equal = tuple(reading.name for V, _, reading in good[1:] if LIMITS.cost_ratio * cost > V)
    share, none = (as_read - cost) / excess, np.zeros(0)
    drop = share * max(scores.cost - scores.noise, 0.0)
    index = ModificationIndex(best.name, best.family, (), none, (), (), none, math.nan, drop, share, x_end - x, equal)
    occam = start_distance(fit.parameters, x_end) if best.family == SCALE else 0.0
    return [*indices, replace(index, occam=occam)]


def _from_the_file(reading: Reading, evidence: Evidence) -> tuple[ElasticFit, FloatArray]:
    """The fit linearised where one with the file's numbers held explains responses as a reading has them; and x (n_x,).

    The measured responses are changed, from the study's start.  A fit of responses that were read wrongly may have
    moved numbers so far within their tolerances that its own linearisation is of another robot.
    """
    own, robot = evidence.assembly, evidence.assembly.linearisation.model.robot
    parameters, x = choose(own.spec, robot, [G.configuration.name for G in own.responses]), own.parameters.x
    held, end = Assembly.of(own.responses, robot, own.spec, parameters, own.model, (), own.weights), parameters.x
    stages: tuple[tuple[ResidualKind, float], ...] = (("log", NEAR), (own.spec.criterion, ROUGH))
    for criterion, tolerance in stages:
        fit = _read(reading, thinned(held.at(end, criterion)), end)
        end = solve(fit.problem, end, tolerance, LIMITS.iterations).x
    x[[own.parameters.free_names.index(name) for name in parameters.free_names]] = end
    return thinned(own.at(x, own.spec.criterion)), x


def _read(reading: Reading, fit: ElasticFit, x: FloatArray) -> ElasticFit:
    """The fit to measured responses with the change of a reading undone, element by element."""
    undo = reading.undo or reading.change
    parts = []
    for i, e in enumerate(evaluate(fit, x)):
        source = fit.parts[reading.order[i]] if reading.order else e.part
        measured, gain = undo(e, source.measured), np.abs(reading.change(e, source.gain.astype(np.complex128)))
        parts.append(replace(e.part, measured=measured, gain=gain, whitening=None, compressed=None))
    return replace(fit, parts=tuple(parts))


def _of_one(reading: Reading, evaluated: Sequence[Evaluated], costs: FloatArray) -> Iterator[Reading]:
    """The reading of one of the configurations alone that fit worst, of several."""
    if reading.family not in OF_ONE or len(evaluated) < 2:
        return
    for i in np.argsort(-costs)[: LIMITS.alone].tolist():
        name = evaluated[i].part.configuration
        yield Reading(f"{reading.name} in configuration {name} alone", reading.family, partial(_alone, reading, name))


def _alone(reading: Reading, name: str, evaluated: Evaluated, values: ComplexArray) -> ComplexArray:
    return reading.change(evaluated, values) if evaluated.part.configuration == name else values


def _channels(evaluated: Sequence[Evaluated]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    models = [e.part.kernel.model for e in evaluated]
    outputs = tuple(dict.fromkeys(name for model in models for name in model.outputs))
    return outputs, tuple(dict.fromkeys(name for model in models for name in model.inputs))


def signs(evaluated: Sequence[Evaluated], _: FloatArray) -> Iterator[Reading]:
    """Channels with the other sign."""
    outputs, inputs = _channels(evaluated)
    for place in outputs:
        yield Reading(f"y at {place} with the other sign", "sign", partial(_turned, {place}, set()))
    for place in inputs:
        yield Reading(f"u at {place} with the other sign", "sign", partial(_turned, set(), {place}))


def directions(evaluated: Sequence[Evaluated], _: FloatArray) -> Iterator[Reading]:
    """Motors that count torque and motion in the other direction."""
    outputs, inputs = _channels(evaluated)
    for place in (place for place in inputs if place in outputs):
        name = f"{place} counted in the other direction, torque and motion"
        yield Reading(name, "direction", partial(_turned, {place}, {place}))


def _turned(outputs: set[str], inputs: set[str], evaluated: Evaluated, values: ComplexArray) -> ComplexArray:
    model = evaluated.part.kernel.model
    rows = np.array([-1.0 if name in outputs else 1.0 for name in model.outputs])
    columns = np.array([-1.0 if name in inputs else 1.0 for name in model.inputs])
    return np.asarray(values * np.outer(rows, columns))


def exchanged_channels(evaluated: Sequence[Evaluated], _: FloatArray) -> Iterator[Reading]:
    """Pairs of channels that were taken for each other."""
    (outputs, inputs), family = _channels(evaluated), "exchanged channels"
    for a, b in combinations(outputs, 2):
        yield Reading(f"y at {a} and at {b} exchanged", family, partial(_permuted, {a: b, b: a}, {}))
    for a, b in combinations(inputs, 2):
        both = {a: b, b: a}
        yield Reading(f"u at {a} and at {b} exchanged", family, partial(_permuted, {}, both))
        if a in outputs and b in outputs:
            yield Reading(f"{a} and {b} exchanged, torques and motions", family, partial(_permuted, both, both))


def _permuted(
    outputs: dict[str, str], inputs: dict[str, str], evaluated: Evaluated, values: ComplexArray
) -> ComplexArray:
    def places(names: Sequence[str], swapped: dict[str, str]) -> list[int]:
        wanted = [swapped.get(name, name) for name in names]
        return [names.index(name) if name in names else i for i, name in enumerate(wanted)]

    model = evaluated.part.kernel.model
    rows, columns = places(model.outputs, outputs), places(model.inputs, inputs)
    return np.asarray(values[..., rows, :][..., columns])


def exchanged_postures(evaluated: Sequence[Evaluated], costs: FloatArray) -> Iterator[Reading]:
    """Pairs among the configurations that fit worst, if they have the same lines and channels."""
    kernels = [e.part.kernel for e in evaluated]
    for a, b in combinations(sorted(np.argsort(-costs)[: LIMITS.exchanged].tolist()), 2):
        first, second = kernels[a].model, kernels[b].model
        if (first.outputs, first.inputs) == (second.outputs, second.inputs) and np.array_equal(
            kernels[a].freq_hz, kernels[b].freq_hz
        ):
            order = tuple({a: b, b: a}.get(i, i) for i in range(len(evaluated)))
            name = f"responses of configurations {first.configuration.name} and {second.configuration.name} exchanged"
            yield Reading(name, "exchanged postures", lambda _, values: values, order)


def conjugates(name: str, family: str, factor: complex, _: Sequence[Evaluated], __: FloatArray) -> Iterator[Reading]:
    """Phases by exp(-j omega t), factor 1; real parts taken for imaginary ones, factor j.

    The sign is -1 where an odd power of j omega made of the responses what is fitted: (j omega)^* = -j omega.
    """
    for sign in (1, -1):
        yield Reading(name, family, partial(_conjugated, factor * sign))


def _conjugated(factor: complex, _: Evaluated, values: ComplexArray) -> ComplexArray:
    return np.asarray(factor * values.conj())


def quantities(_: Sequence[Evaluated], __: FloatArray) -> Iterator[Reading]:
    """Positions, velocities and accelerations taken for each other."""
    for power in (1, 2, -1, -2):
        count, direction = "once" if abs(power) == 1 else "twice", "less" if power > 0 else "more"
        name = f"responses differentiated {count} {direction} in time"
        yield Reading(name, "quantity", partial(_differentiated, power), undo=partial(_differentiated, -power))


def _differentiated(power: int, evaluated: Evaluated, values: ComplexArray) -> ComplexArray:
    s = 2j * np.pi * evaluated.part.kernel.freq_hz
    return np.asarray(values * (s**power)[:, None, None])


# How responses were read: the family, its changes, and the advice.
_READINGS: tuple[tuple[str, Changes, str], ...] = (
    ("sign", signs, "check sign, scale and gear ratio of the channel"),
    ("direction", directions, "check the axis of its joint, the sign of its ratio and the signs of its channels"),
    ("exchanged channels", exchanged_channels, "check which channel is which"),
    ("exchanged postures", exchanged_postures, "check which record is of which posture, and the angles of both"),
    (
        "phase",
        partial(conjugates, "all phases negated", "phase", 1),
        "they were written with the convention exp(-j omega t); take their complex conjugates",
    ),
    (
        "parts",
        partial(conjugates, "real and imaginary parts exchanged", "parts", 1j),
        "check which column or field is which",
    ),
    ("quantity", quantities, "check the quantity (position, velocity, acceleration) of the y channels"),
)
READINGS = tuple(Hypothesis(family, changes=changes, advice=advice) for family, changes, advice in _READINGS)


def _scaled(fit: ElasticFit, starts: Sequence[FloatArray]) -> Iterator[tuple[str, float, FloatArray]]:
    """From each start the channels that are off by factors, in words, with V and x (n_x,) of the optimum with them."""
    for x in starts:
        V, words = math.inf, ""
        for _ in range(LIMITS.scale_rounds):
            outputs, inputs = _scales(evaluate(fit, x))
            # The values of a torque are off by 1 / c.
            factors = {f"y at {p}": c for p, c in outputs.items()} | {f"u at {p}": -c for p, c in inputs.items()}
            far = {name: c for name, c in factors.items() if abs(c) > math.log(LIMITS.scale)}
            words = ", ".join(f"{name} times {math.exp(c):.3g}" for name, c in far.items())
            if not words:
                break
            reading = Reading("", SCALE, partial(_rescaled, outputs, inputs))
            V, x = settle(reading, fit, x, np.ones(len(x), dtype=bool))
        if words:
            yield words, V, x


def _rescaled(
    outputs: dict[str, float], inputs: dict[str, float], evaluated: Evaluated, values: ComplexArray
) -> ComplexArray:
    """The response of the model as channels with these ln c read it."""
    model = evaluated.part.kernel.model
    rows, columns = [outputs[place] for place in model.outputs], [inputs[place] for place in model.inputs]
    return np.asarray(values * np.exp(-np.add.outer(rows, columns)))


def _scales(evaluated: Sequence[Evaluated]) -> tuple[dict[str, float], dict[str, float]]:
    """ln c of outputs and inputs that make the measured elements as large as the model's, by the median of lines."""
    outputs, inputs = _channels(evaluated)
    rows, wanted = [], []
    for e in evaluated:
        model, used, G = e.part.kernel.model, e.part.gain > 0, np.abs(e.G)
        for (i, output), (j, given) in product(enumerate(model.outputs), enumerate(model.inputs)):
            lines = used[:, i, j] & (G[:, i, j] > 0) & (e.part.measured[:, i, j] != 0)
            if lines.any():
                row = np.zeros(len(outputs) + len(inputs))
                row[outputs.index(output)] = row[len(outputs) + inputs.index(given)] = 1.0
                rows.append(row)
                wanted.append(float(np.median(np.log(G[lines, i, j] / np.abs(e.part.measured[lines, i, j])))))
    c, n_y = np.linalg.lstsq(np.array(rows), np.array(wanted))[0], len(outputs)
    # Only sums of output and input are known: as few channels as possible are off, outputs rather than inputs.
    common = np.where(np.arange(len(c)) < n_y, -1.0, 1.0)
    shifted = [c - shift * common for shift in (*c[n_y:], *-c[:n_y])]
    fewest = max(shifted, key=lambda scales: int(np.sum(np.abs(scales) < math.log(LIMITS.scale)))).tolist()
    return dict(zip(outputs, fewest, strict=False)), dict(zip(inputs, fewest[n_y:], strict=True))
