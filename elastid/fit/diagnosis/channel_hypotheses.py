r"""Channel hypotheses: wrong signs, units, order or phase convention of measured responses, as changes of the model.

.. math:: \hat G \approx S G, \quad P G, \quad G^*, \quad (j \omega)^k G, \quad
          |\hat G_{ij}| \approx \frac{|G_{ij}|}{c_i c_j}

The hypotheses: a channel with inverted sign, exchanged channels or postures, phases for exp(-j omega t), a velocity
instead of an acceleration, channels in another unit.  Wrong channels can bias the optimum by any amount, so V of every
hypothesis is predicted at the optimum and at the start values. The best hypotheses are refitted by a few steps.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import combinations, product

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, laplace_variable
from elastid.base.errors import ElastidError
from elastid.fit.diagnosis.hypothesis import SCALE, Changes, Evidence, Hypothesis, Scores, with_refit
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.refit import (
    Change,
    EvaluatedResponse,
    ResponseChange,
    evaluate,
    frf_costs,
    gauss_newton_step,
    on_line_subset,
    refit,
    start_distance,
)
from elastid.fit.problem.frf_residuals import ElasticFit, FrfResiduals
from elastid.fit.result_rows import ModificationIndex


def find_channel_error(indices: list[ModificationIndex], evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """Append the best channel hypothesis to the indices, with the names of hypotheses indistinguishable from it."""
    optimum, result, assembly = evidence.optimum, evidence.result, evidence.assembly
    fit, x = on_line_subset(optimum.fit), optimum.x
    of_all, costs = optimum.fit.n_residuals / max(fit.n_residuals, 1), np.array(frf_costs(evaluate(fit, x)))
    starts = [(fit, x, ~result.at_bound)]
    with suppress(ElastidError):  # no equilibrium there
        file = on_line_subset(assembly.at(assembly.parameters.x))
        # With wrong channels, the fit may have changed the nuisance parameters by many of their tolerances.
        starts.append((file, assembly.parameters.x, np.array([not p.is_nuisance for p in assembly.parameters.free])))
    predicted = [  # V of every hypothesis after one step from each start
        (gauss_newton_step(change, evaluated, problem.parameters.prior_slopes, free)[0], change, (problem, start, free))
        for problem, start, free in starts
        for evaluated in (evaluate(problem, start),)
        for hypothesis in evidence.hypotheses
        for change in (_changes(hypothesis.changes, evaluated, costs) if hypothesis.changes is not None else ())
    ]
    refits: dict[str, tuple[float, FloatArray, ResponseChange]] = {}
    for cost, change, (problem, start, free) in sorted(predicted, key=lambda trial: trial[0]):
        if len(refits) >= LIMITS.n_refits or cost > LIMITS.predicted_ratio * costs.sum():
            break
        if change.name not in refits:
            V, x_end = refit(change, problem, refit(change, problem, start, free)[1])
            refits[change.name] = (of_all * V, x_end, change)
    cost_as_stated = min(of_all * float(costs.sum()), scores.cost)
    excess = max(cost_as_stated - scores.noise, 1e-300)
    min_cost = min((cost for cost, _, _ in refits.values()), default=math.inf)
    if cost_as_stated - min_cost <= LIMITS.complete_fraction * excess:
        for name, cost, x_end in _scale_channels(fit, (fit.parameters.x, x)):
            refits[name] = (of_all * cost, x_end, ResponseChange(name, SCALE, lambda _, values: values))
    min_cost = cost_as_stated - LIMITS.sufficient_fraction * excess
    good = sorted((curve for curve in refits.values() if curve[0] < min_cost), key=lambda curve: curve[0])
    if not good:
        return indices
    cost, x_end, best = good[0]
    equal = tuple(change.name for V, _, change in good[1:] if cost > LIMITS.equal_drop * V)
    occam = start_distance(fit.parameters, x_end) if best.family == SCALE else 0.0
    index = ModificationIndex(best.name, best.family, alike=equal, occam=occam)
    return [*indices, with_refit(index, cost, x_end, evidence, scores)]


def _changes(changes: Changes, evaluated: Sequence[EvaluatedResponse], costs: FloatArray) -> Iterator[ResponseChange]:
    """Yield interpretations of all configurations, and of the single configurations with the worst fit."""
    yield from changes(evaluated, costs)
    for i in np.argsort(-costs)[: LIMITS.n_refits] if len(costs) > 2 else ():
        frf = evaluated[i].frf
        for change in changes([evaluated[i]], costs[[i]]):
            name = f"{change.name} in configuration {frf.configuration} alone"
            yield replace(change, name=name, apply=partial(_change_one, frf, change.apply))


def _change_one(frf: FrfResiduals, change: Change, evaluated: EvaluatedResponse, values: ComplexArray) -> ComplexArray:
    return change(evaluated, values) if evaluated.frf.configuration == frf.configuration else values


def _channels(evaluated: Sequence[EvaluatedResponse]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    models = [e.frf.kernel.model for e in evaluated]
    outputs = tuple(dict.fromkeys(name for model in models for name in model.outputs))
    return outputs, tuple(dict.fromkeys(name for model in models for name in model.inputs))


def sign_errors(evaluated: Sequence[EvaluatedResponse], _: FloatArray) -> Iterator[ResponseChange]:
    """Yield the hypotheses of a channel with the opposite sign."""
    outputs, inputs = _channels(evaluated)
    for location in outputs:
        yield ResponseChange(f"y at {location} with the other sign", "sign", partial(_times, {location: -1.0}, {}))
    for location in inputs:
        yield ResponseChange(f"u at {location} with the other sign", "sign", partial(_times, {}, {location: -1.0}))


def direction_errors(evaluated: Sequence[EvaluatedResponse], _: FloatArray) -> Iterator[ResponseChange]:
    """Yield the hypotheses of a motor that counts torque and motion in the opposite direction."""
    outputs, inputs = _channels(evaluated)
    for location in (location for location in inputs if location in outputs):
        name = f"{location} counted in the other direction, torque and motion"
        yield ResponseChange(name, "direction", partial(_times, {location: -1.0}, {location: -1.0}))


def _times(
    outputs: dict[str, float], inputs: dict[str, float], evaluated: EvaluatedResponse, values: ComplexArray
) -> ComplexArray:
    model = evaluated.frf.kernel.model
    rows, columns = [outputs.get(p, 1.0) for p in model.outputs], [inputs.get(p, 1.0) for p in model.inputs]
    return values * np.outer(rows, columns)


def channel_exchanges(evaluated: Sequence[EvaluatedResponse], _: FloatArray) -> Iterator[ResponseChange]:
    """Yield the hypotheses of two exchanged channels."""
    (outputs, inputs), family = _channels(evaluated), "exchanged channels"
    for a, b in combinations(outputs, 2):
        yield ResponseChange(f"y at {a} and at {b} exchanged", family, partial(_permute, {a: b, b: a}, {}))
    for a, b in combinations(inputs, 2):
        exchange = {a: b, b: a}
        yield ResponseChange(f"u at {a} and at {b} exchanged", family, partial(_permute, {}, exchange))
        if a in outputs and b in outputs:
            yield ResponseChange(
                f"{a} and {b} exchanged, torques and motions", family, partial(_permute, exchange, exchange)
            )


def _permute(
    outputs: dict[str, str], inputs: dict[str, str], evaluated: EvaluatedResponse, values: ComplexArray
) -> ComplexArray:
    def places(names: Sequence[str], exchange: dict[str, str]) -> list[int]:
        order = [exchange.get(name, name) for name in names]
        return [names.index(name) if name in names else i for i, name in enumerate(order)]

    model = evaluated.frf.kernel.model
    rows, columns = places(model.outputs, outputs), places(model.inputs, inputs)
    return values[..., rows, :][..., columns]


def posture_exchanges(evaluated: Sequence[EvaluatedResponse], costs: FloatArray) -> Iterator[ResponseChange]:
    """Yield the hypotheses of two exchanged configurations with large residuals and with equal lines and channels."""
    kernels = [e.frf.kernel for e in evaluated]
    for a, b in combinations(sorted(np.argsort(-costs)[: LIMITS.n_exchange_candidates].tolist()), 2):
        first, second = kernels[a].model, kernels[b].model
        if (first.outputs, first.inputs) == (second.outputs, second.inputs) and np.array_equal(
            kernels[a].freq_hz, kernels[b].freq_hz
        ):
            order = tuple({a: b, b: a}.get(i, i) for i in range(len(evaluated)))
            name = f"responses of configurations {first.configuration.name} and {second.configuration.name} exchanged"
            yield ResponseChange(name, "exchanged postures", lambda _, values: values, order)


def phase_errors(_: Sequence[EvaluatedResponse], __: FloatArray) -> Iterator[ResponseChange]:
    """Yield the hypotheses of phases for exp(-j omega t), with both signs because of odd powers of j omega."""
    yield ResponseChange("all phases negated", "phase", lambda _, values: values.conj())
    yield ResponseChange("all phases negated", "phase", lambda _, values: -values.conj())


def quantity_errors(_: Sequence[EvaluatedResponse], __: FloatArray) -> Iterator[ResponseChange]:
    """Yield the hypotheses of a confused position, velocity or acceleration."""
    for power in (1, 2, -1, -2):
        count, direction = "once" if abs(power) == 1 else "twice", "less" if power > 0 else "more"
        name = f"responses differentiated {count} {direction} in time"
        yield ResponseChange(name, "quantity", partial(_differentiate, power))


def _differentiate(power: int, evaluated: EvaluatedResponse, values: ComplexArray) -> ComplexArray:
    return values * (laplace_variable(evaluated.frf.kernel.freq_hz) ** power)[:, None, None]


# Family, changes of the model, error in words, simulated fault of the tests, advice.
_CHANNEL_ROWS: tuple[tuple[str, Changes, str, str, str], ...] = (
    ("sign", sign_errors, "sign of a channel", "sign of torque 2", "check sign, scale and gear ratio of the channel"),
    ("direction", direction_errors, "sign convention of a motor (torque and position)", "mirrored motor",
     "check the axis of its joint, the sign of its ratio and the signs of its channels"),
    ("exchanged channels", channel_exchanges, "channels exchanged", "channels y 1 and 2 exchanged",
     "check which channel is which"),
    ("exchanged postures", posture_exchanges, "responses of two configurations exchanged", "exchanged postures",
     "check which record is of which posture, and the angles of both"),
    ("phase", phase_errors, "sign of all phases", "negated",
     "take the complex conjugates of the responses: their convention is exp(-j omega t)"),
    ("quantity", quantity_errors, "position, velocity or acceleration confused", "velocities",
     "check the quantity (position, velocity, acceleration) of the y channels"),
)  # fmt: skip
CHANNEL_HYPOTHESES = tuple(
    Hypothesis(family, changes=changes, summary=summary, plant=plant, advice=advice)
    for family, changes, summary, plant, advice in _CHANNEL_ROWS
)


def _scale_channels(fit: ElasticFit, starts: Sequence[FloatArray]) -> Iterator[tuple[str, float, FloatArray]]:
    for x in starts:
        V, text = math.inf, ""
        for _ in range(LIMITS.n_scale_rounds):
            outputs, inputs = _scales(evaluate(fit, x))
            # A torque that is wrong by c scales the response by 1 / c.
            factors = {f"y at {p}": c for p, c in outputs.items()} | {f"u at {p}": -c for p, c in inputs.items()}
            far = {name: c for name, c in factors.items() if abs(c) > math.log(LIMITS.min_scale)}
            text = ", ".join(f"{name} times {math.exp(c):.3g}" for name, c in far.items())
            if not text:
                break
            # The modelled response as these channels would measure it.
            of_y, of_u = ({location: math.exp(-c) for location, c in side.items()} for side in (outputs, inputs))
            V, x = refit(ResponseChange("", SCALE, partial(_times, of_y, of_u)), fit, x)
        if text:
            yield text, V, x


def _scales(evaluated: Sequence[EvaluatedResponse]) -> tuple[dict[str, float], dict[str, float]]:
    """Return ln c of outputs and inputs that match measured and modelled magnitudes, by the median of lines."""
    outputs, inputs = _channels(evaluated)
    rows, values = [], []
    for e in evaluated:
        model, is_used, G = e.frf.kernel.model, e.frf.gain > 0, np.abs(e.G)
        for (i, output), (j, input_) in product(enumerate(model.outputs), enumerate(model.inputs)):
            lines = is_used[:, i, j] & (G[:, i, j] > 0) & (e.frf.measured[:, i, j] != 0)
            if lines.any():
                row = np.zeros(len(outputs) + len(inputs))
                row[outputs.index(output)] = row[len(outputs) + inputs.index(input_)] = 1.0
                rows.append(row)
                values.append(float(np.median(np.log(G[lines, i, j] / np.abs(e.frf.measured[lines, i, j])))))
    c, n_y = np.linalg.lstsq(np.array(rows), np.array(values))[0], len(outputs)
    # Only sums of ln c of an output and an input are identifiable: choose the fewest wrong channels.
    common = np.where(np.arange(len(c)) < n_y, -1.0, 1.0)
    shifted = [c - shift * common for shift in (*c[n_y:], *-c[:n_y])]
    fewest = max(shifted, key=lambda scales: int(np.sum(np.abs(scales) < math.log(LIMITS.min_scale)))).tolist()
    return dict(zip(outputs, fewest, strict=False)), dict(zip(inputs, fewest[n_y:], strict=True))
