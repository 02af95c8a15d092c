r"""Readings: responses that were read wrongly, or late, as changes of the model's, each followed to an optimum.

.. math:: \hat G \approx S G, \quad P G, \quad G^*, \quad (j \omega)^k G, \quad
          |\hat G_{ij}| \approx \frac{|G_{ij}|}{c_i c_j}

A channel of the other sign, channels or postures exchanged, phases counted by exp(-j omega t), a velocity taken for an
acceleration, channels in another unit.  A fit of responses that were read wrongly may end anywhere: one evaluation at
its optimum and one at its start predict V of every reading, and the best of them take some steps on a few lines.

Late by T is a channel, or all, by a delay D or a low pass L, which differ in gain and curvature and to first order are
both a delay:

.. math:: D = e^{-j \omega T}, \qquad L = \frac{1}{1 + j \omega T}

T follows by a search in one dimension, the parameters of the fit by one Gauss-Newton step at each. A negative T is that
of one that was taken out where none is.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import combinations, product
from typing import NamedTuple, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.errors import ElastidError
from elastid.fit.diagnosis.hypothesis import SCALE, Changes, Evidence, Hypothesis, Scores, against
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.sensitivities import (
    AS_READ,
    Change,
    Evaluated,
    Reading,
    evaluate,
    logarithmic,
    predict,
    settle,
    squares,
    start_distance,
    thinned,
)
from elastid.fit.parameter_selection import MAX_TIME
from elastid.fit.problem.frf_residuals import ElasticFit, Part
from elastid.fit.result import ModificationIndex
from elastid.linear.linear_model import DELAY
from elastid.robot import channel_name, low_pass_response


def find_channel_errors(
    indices: list[ModificationIndex], evidence: Evidence, scores: Scores
) -> list[ModificationIndex]:
    """The indices with the best reading, and the names of those that cannot be distinguished from it."""
    optimum, result, assembly = evidence.optimum, evidence.result, evidence.assembly
    fit, x = thinned(optimum.fit), optimum.end.x
    every, of_all = np.ones(len(x), dtype=bool), optimum.fit.n_residuals / max(fit.n_residuals, 1)
    costs = np.array(squares(evaluate(fit, x)))
    starts = [(fit, x, ~result.at_bound)]
    with suppress(ElastidError):  # no equilibrium there
        file = thinned(assembly.at(assembly.parameters.x, assembly.spec.criterion))
        # A fit of responses that were read wrongly may have moved the numbers of the file far within their tolerances.
        starts.append((file, assembly.parameters.x, np.array([not p.is_nuisance for p in assembly.parameters.free])))
    predicted = [  # V of every reading after one step from each start
        (predict(reading, evaluated, problem.prior_slopes, free)[0], reading, (problem, start, free))
        for problem, start, free in starts
        for evaluated in (evaluate(problem, start),)
        for hypothesis in evidence.hypotheses
        for reading in (_changes(hypothesis.changes, evaluated, costs) if hypothesis.changes is not None else ())
    ]
    followed: dict[str, tuple[float, FloatArray, Reading]] = {}
    for cost, reading, (problem, start, free) in sorted(predicted, key=lambda trial: trial[0]):
        if len(followed) >= LIMITS.followed or cost > LIMITS.predicted_ratio * costs.sum():
            break
        if reading.name not in followed:
            near = settle(reading, problem, start, free)[1]
            V, x_end = settle(reading, problem, near, every)
            followed[reading.name] = (of_all * V, x_end, reading)
    as_read = min(of_all * float(costs.sum()), scores.cost)
    excess = max(as_read - scores.noise, 1e-300)
    least = min((cost for cost, _, _ in followed.values()), default=math.inf)
    if as_read - least <= LIMITS.whole * excess:
        for name, cost, x_end in _scaled(fit, (fit.parameters.x, x)):
            followed[name] = (of_all * cost, x_end, Reading(name, SCALE, lambda _, values: values))
    least = as_read - LIMITS.explained_share * excess
    good = sorted((curve for curve in followed.values() if curve[0] < least), key=lambda curve: curve[0])
    if not good:
        return indices
    cost, x_end, best = good[0]
    equal = tuple(reading.name for V, _, reading in good[1:] if cost > LIMITS.equal_drop * V)
    occam = start_distance(fit.parameters, x_end) if best.family == SCALE else 0.0
    index = ModificationIndex(best.name, best.family, alike=equal, occam=occam)
    return [*indices, against(index, cost, x_end, evidence, scores)]


def _changes(changes: Changes, evaluated: Sequence[Evaluated], costs: FloatArray) -> Iterator[Reading]:
    """Readings of all configurations, and of each alone of those that fit worst."""
    yield from changes(evaluated, costs)
    for i in np.argsort(-costs)[: LIMITS.followed] if len(costs) > 2 else ():
        part = evaluated[i].part
        for reading in changes([evaluated[i]], costs[[i]]):
            name = f"{reading.name} in configuration {part.configuration} alone"
            yield replace(reading, name=name, change=partial(_of_one, part, reading.change))


def _of_one(part: Part, change: Change, evaluated: Evaluated, values: ComplexArray) -> ComplexArray:
    return change(evaluated, values) if evaluated.part.configuration == part.configuration else values


def _channels(evaluated: Sequence[Evaluated]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    models = [e.part.kernel.model for e in evaluated]
    outputs = tuple(dict.fromkeys(name for model in models for name in model.outputs))
    return outputs, tuple(dict.fromkeys(name for model in models for name in model.inputs))


def signs(evaluated: Sequence[Evaluated], _: FloatArray) -> Iterator[Reading]:
    """Channels with the other sign."""
    outputs, inputs = _channels(evaluated)
    for place in outputs:
        yield Reading(f"y at {place} with the other sign", "sign", partial(_times, {place: -1.0}, {}))
    for place in inputs:
        yield Reading(f"u at {place} with the other sign", "sign", partial(_times, {}, {place: -1.0}))


def directions(evaluated: Sequence[Evaluated], _: FloatArray) -> Iterator[Reading]:
    """Motors that count torque and motion in the other direction."""
    outputs, inputs = _channels(evaluated)
    for place in (place for place in inputs if place in outputs):
        name = f"{place} counted in the other direction, torque and motion"
        yield Reading(name, "direction", partial(_times, {place: -1.0}, {place: -1.0}))


def _times(
    outputs: dict[str, float], inputs: dict[str, float], evaluated: Evaluated, values: ComplexArray
) -> ComplexArray:
    model = evaluated.part.kernel.model
    rows, columns = [outputs.get(p, 1.0) for p in model.outputs], [inputs.get(p, 1.0) for p in model.inputs]
    return values * np.outer(rows, columns)


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
    return values[..., rows, :][..., columns]


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


def conjugates(_: Sequence[Evaluated], __: FloatArray) -> Iterator[Reading]:
    """Responses with phases by exp(-j omega t), also negated by an odd power of j omega."""
    yield Reading("all phases negated", "phase", lambda _, values: values.conj())
    yield Reading("all phases negated", "phase", lambda _, values: -values.conj())


def quantities(_: Sequence[Evaluated], __: FloatArray) -> Iterator[Reading]:
    """Positions, velocities and accelerations taken for each other."""
    for power in (1, 2, -1, -2):
        count, direction = "once" if abs(power) == 1 else "twice", "less" if power > 0 else "more"
        name = f"responses differentiated {count} {direction} in time"
        yield Reading(name, "quantity", partial(_differentiated, power))


def _differentiated(power: int, evaluated: Evaluated, values: ComplexArray) -> ComplexArray:
    s = 2j * np.pi * evaluated.part.kernel.freq_hz
    return values * (s**power)[:, None, None]


# How responses were read: the family, its changes, and the advice.
_READINGS: tuple[tuple[str, Changes, str], ...] = (
    ("sign", signs, "check sign, scale and gear ratio of the channel"),
    ("direction", directions, "check the axis of its joint, the sign of its ratio and the signs of its channels"),
    ("exchanged channels", exchanged_channels, "check which channel is which"),
    ("exchanged postures", exchanged_postures, "check which record is of which posture, and the angles of both"),
    ("phase", conjugates, "take the complex conjugates of the responses: their convention is exp(-j omega t)"),
    ("quantity", quantities, "check the quantity (position, velocity, acceleration) of the y channels"),
)
READINGS = tuple(Hypothesis(family, changes=changes, advice=advice) for family, changes, advice in _READINGS)


def _scaled(fit: ElasticFit, starts: Sequence[FloatArray]) -> Iterator[tuple[str, float, FloatArray]]:
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
            # As channels with these ln c read the response of the model.
            of_y, of_u = ({place: math.exp(-c) for place, c in side.items()} for side in (outputs, inputs))
            reading = Reading("", SCALE, partial(_times, of_y, of_u))
            V, x = settle(reading, fit, x, np.ones(len(x), dtype=bool))
        if words:
            yield words, V, x


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


Factor: TypeAlias = Callable[[FloatArray, float], ComplexArray]


def delay(freq_hz: FloatArray, T: float) -> ComplexArray:
    """D (F,) of a signal that is T late."""
    return np.asarray(np.exp(-2j * np.pi * freq_hz * T))


def low_pass(freq_hz: FloatArray, T: float) -> ComplexArray:
    """L (F,) of a filter of first order with the time constant T, its inverse where T is negative."""
    return low_pass_response((2j * np.pi * freq_hz).astype(np.complex128), T)


FORMS: dict[str, Factor] = {"delay": delay, "low_pass": low_pass}


class Late(NamedTuple):
    """A form of time delay, `delay` or a low pass, the T in s that fits best, V with it, and the step of x."""

    name: str
    time: float
    cost: float
    step: FloatArray


def as_delay(name: str) -> str:
    """Return the first-order equivalent delay of a delay or filter; other names unchanged."""
    form = next((form for form in FORMS if name.startswith(form)), name)
    return f"delay{name.removeprefix(form)}" if form in FORMS else name


def best_forms(
    evaluated: Sequence[Evaluated], prior: FloatArray, free: BoolArray, near: str, channel: tuple[str, str], T_0: float
) -> Iterator[Late]:
    """The best T of each form near a delay of that name and size T_0.

    channel: y or u with the place; ("", "") of all.  prior (n_x,): 1 / s of the priors.  free (n_x,): what may follow.
    """
    from scipy.optimize import minimize_scalar  # slow to load, for the few fits that are beyond the noise

    limit = LIMITS.edge_phase / max(float(e.part.kernel.freq_hz.max()) for e in evaluated)

    def at(T: float, form: str) -> tuple[float, FloatArray]:
        return predict(Reading("", "time", partial(_late, FORMS[form], T, *channel)), evaluated, prior, free)

    for form in FORMS:
        low, high = np.clip(sorted((0.3 * T_0, 2.0 * T_0)), -limit, limit).tolist()
        options = {"maxiter": LIMITS.iterations, "xatol": 1e-4 * max(abs(low), abs(high))}
        least = minimize_scalar(lambda T, form=form: at(T, form)[0], bounds=(low, high), options=options)
        yield Late(near.replace("delay", form, 1), float(least.x), *at(float(least.x), form))


def _late(factor: Factor, T: float, role: str, place: str, evaluated: Evaluated, values: ComplexArray) -> ComplexArray:
    model = evaluated.part.kernel.model
    H = factor(evaluated.part.kernel.freq_hz, T)[:, None, None]
    if not role:
        return H * values
    # A torque that is logged late divides its column.
    named = np.array([name == place for name in (model.outputs if role == "y" else model.driven)])
    return np.where(named[:, None] if role == "y" else named, 1 / H if role == "u" else H, 1.0) * values


def common_delay(fit: ElasticFit, x: FloatArray) -> float:
    """Return the delay in s of all motions relative to the torques at which V is least, with x (n_x,) fixed.

    A global search: V is periodic in the delay at each line, and a solver finds the nearest minimum only.  Logarithmic
    criterion; steps of an eighth of the shortest period, up to half the inverse of the distance of two lines.
    """
    few = thinned(fit, LIMITS.residuals)
    evaluated = evaluate(replace(few, parts=tuple(map(logarithmic, few.parts))), x)
    step = 0.125 / max(e.part.kernel.freq_hz[-1] for e in evaluated)
    far = min(MAX_TIME[1], *(0.5 / float(np.diff(e.part.kernel.freq_hz).max(initial=1.0)) for e in evaluated))
    delays = step * np.array(sorted(range(-int(far / step), int(far / step) + 1), key=abs))
    costs = [sum(squares([replace(e, G=_late(delay, T, "", "", e, e.G)) for e in evaluated])) for T in delays]
    return float(delays[np.argmin(costs)])


def find_delays(indices: list[ModificationIndex], evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """Return the indices with the forms (delay, filter) of significant delays and of `common_delay`."""
    optimum, result, assembly = evidence.optimum, evidence.result, evidence.assembly
    if not optimum.fit.n_residuals:
        return indices
    fit, x, free = thinned(optimum.fit), optimum.end.x, ~result.at_bound
    evaluated, prior, share = evaluate(fit, x), fit.prior_slopes, fit.n_residuals / optimum.fit.n_residuals
    cost, noise = min(predict(AS_READ, evaluated, prior, free)[0], scores.cost * share), scores.noise * share
    models = [e.part.kernel.model for e in evaluated]
    # A delay of all references delays all motions, one of the torques is within the loop.
    common = DELAY if all(model.controller is None for model in models) else channel_name(DELAY, "r")
    channels = {common: ("", "")} | {
        channel_name(DELAY, role, place): (role, place)
        for model in models
        for role, places in (("y", model.outputs), (model.input_role, model.driven))
        for place in places
    }
    late = [row for row in indices if row.name in channels and row.explained_fraction > LIMITS.stated_share]
    late = late[: LIMITS.followed]
    others = [index for index in indices if index not in late]
    points = {row.name: (evaluated, x, free) for row in late}
    with suppress(ElastidError):  # no equilibrium there
        start, every = assembly.parameters.x, free | True
        file = thinned(assembly.at(start, assembly.spec.criterion))
        if common not in result.parameters.free_names and (T := common_delay(file, start)):
            start = settle(Reading("", "time", partial(_late, delay, T, "", "")), file, start, every)[1]
            points[common] = evaluate(file, start), start, every
            row = ModificationIndex(common, "time", (common,), np.zeros(1), ("s",), (False,), np.array([T]))
            late, others = ([row, *(r for r in late if r.name != common)], [r for r in others if r.name != common])
    for row in late:
        at, near, may_follow = points[row.name]
        best = [*best_forms(at, prior, may_follow, row.name, channels[row.name], float(row.steps[0]))]
        least = min(form.cost for form in best)
        tolerance = LIMITS.variances * scores.level + LIMITS.form_share * max(least - noise, 0.0)
        equal = [form for form in sorted(best, key=lambda form: form.cost) if form.cost < least + tolerance]
        for form in equal:  # those that cannot be distinguished
            explained = (cost - form.cost) / max(cost - noise, 1e-300)
            of_form = replace(row, name=form.name, members=(form.name,), values=row.values * (form.name == row.name))
            of_form = replace(of_form, steps=np.array([form.time]), effects=near + form.step - result.x)
            drop = explained * scores.excess / scores.lines
            alike = (*(other.name for other in equal if other is not form), *row.alike)
            others.append(replace(of_form, drop=drop, explained_fraction=explained, alike=alike))
    return others
