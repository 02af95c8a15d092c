r"""Misread channels, found by how much better the fit becomes once the responses are read another way.

.. math:: \hat G \to S \hat G, \quad \hat G^*, \quad j \hat G^*, \quad (j \omega)^k \hat G, \quad
          \mathrm{diag}(c_y)\, \hat G\, \mathrm{diag}(c_u)

A channel with the other sign, phases counted by exp(-j omega t), real and imaginary parts exchanged, a velocity taken
for an acceleration, units or gear ratios of channels. A few lines are enough.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.fit.diagnosis.read_again import roughly_solved, thinned, times
from elastid.fit.problem.elastic import ElasticFit, Part
from elastid.fit.result import FitResult

# Read the right way, responses have at most this share of the cost that they have read the wrong way.
MAX_COST_RATIO = 0.1
# The same with a scale of each channel found beside the parameters, which leaves some error.
MAX_COST_RATIO_SCALED = 0.2
# Rounds in which scales are found.
SCALE_ROUNDS = 3
# Up to so many configurations, two of them are left out at once.
MAX_CONFIGURATIONS_IN_PAIRS = 6
# A scale nearer to one than this factor may be an inertia that is not quite known.
MIN_SCALE = 1.7
# The spread of the factors (2 pi)^2 by which all stiffnesses are off where the unit of the frequency is wrong.
MAX_FACTOR_SPREAD = 2.5
# Relative standard deviation of a stiffness that counts there.
MAX_STIFFNESS_STD = 0.5


@dataclass(frozen=True)
class Reading:
    """Another way to read the responses: the end of a sentence that says it, and the fit to them."""

    words: str
    fit: ElasticFit


def find_misread_channels(fit: ElasticFit, x: FloatArray, cost: float) -> tuple[Note, ...]:
    """A note on the reading of all responses that makes the fit far better, solved again from its optimum x.

    cost: V at x.  An output and an input that do the same, as those of a single motor do, are named together.
    """
    thin = thinned(fit)
    here = thin.evaluate(x).cost
    costs = {kind: _costs(readings(thin), x) for kind, readings in _KINDS.items()}
    kind = min(costs, key=lambda one: min(costs[one].values()))
    best = min(costs[kind].values())
    if best > MAX_COST_RATIO * here:
        return _scale_words(thin, x, here)
    # Channels that do the same are named together; of the other ways there is one.
    least = best / MAX_COST_RATIO if kind == "sign" else best
    words = [one for one, V in costs[kind].items() if min(least, MAX_COST_RATIO * here) >= V]
    whole = min(_costs((one for one in _KINDS[kind](fit) if one.words in words), x).values())
    return (Note("misread-responses", _sentence(words, f"(V = {whole:.4g} instead of {cost:.4g})")),)


def find_foreign_configurations(fit: ElasticFit, x: FloatArray) -> tuple[Note, ...]:
    """A note on one configuration, or two of a few, without which the model explains the others far better."""
    thin, Q = thinned(fit), len(fit.parts)
    for size in range(1, 3 if Q <= MAX_CONFIGURATIONS_IN_PAIRS else 2):
        found: dict[tuple[int, ...], float] = {}
        for left_out in combinations(range(Q), size) if Q - size >= 2 else ():
            rest = replace(thin, parts=tuple(part for i, part in enumerate(thin.parts) if i not in left_out))
            here, V = rest.evaluate(x).cost, min(roughly_solved(rest, start)[0] for start in (x, fit.parameters.x))
            if MAX_COST_RATIO * here >= V:
                found[left_out] = V / here
        if found:
            best = min(found, key=lambda one: found[one])
            names = " and ".join(fit.parts[i].configuration for i in best)
            return (
                Note(
                    "foreign-configuration",
                    f"without configuration {names} the model fits the others far better (V of these falls to "
                    f"{100 * found[best]:.2g} %): are they of the same robot, with the same load, at the "
                    "stated angles?",
                ),
            )
    return ()


def find_wrong_frequency_unit(result: FitResult) -> tuple[Note, ...]:
    r"""A note where all stiffnesses suggest frequencies in rad/s instead of Hz, or the other way round.

    An acceleration per torque is the same for K, D at omega and (2 pi)^2 K, 2 pi D at 2 pi omega: no residual shows it.
    """
    known = np.sqrt(np.diag(result.covariance)) < MAX_STIFFNESS_STD
    stiff = [i for i, p in enumerate(result.parameters.free) if p.log and p.unit in ("N*m/rad", "N/m") and known[i]]
    if not stiff:
        return ()
    change = result.x[stiff] - result.parameters.x[stiff]
    expected = 2 * math.log(2 * math.pi) * np.sign(np.median(change))
    if np.any(np.abs(change - expected) > math.log(MAX_FACTOR_SPREAD)):
        return ()
    factor = math.exp(abs(float(np.median(change))))
    names = ", ".join(result.parameters.free[i].name for i in stiff)
    side, unit, other = ("above", "rad/s", "Hz") if expected > 0 else ("below", "Hz", "rad/s")
    return (
        Note(
            "frequency-unit",
            f"{factor:.0f} times {side} the start, and (2 pi)^2 is 39: are the frequencies of the responses in "
            f"{unit}, where {other} was taken? Then all stiffnesses are off by it, and no residual shows it",
            names,
        ),
    )


def _costs(readings: Iterable[Reading], x: FloatArray) -> dict[str, float]:
    """The lowest V of each way to read the responses, by its words."""
    costs: dict[str, float] = {}
    for reading in readings:
        V = min(roughly_solved(reading.fit, start)[0] for start in (x, reading.fit.parameters.x))
        costs[reading.words] = min(V, costs.get(reading.words, math.inf))
    return costs


def _sentence(words: list[str], better: str) -> str:
    if words[0].startswith(("y at", "u at")):
        return (
            f"{' or '.join(words)} fits far better with the other sign {better}: check sign, scale and gear ratio of "
            "its channel"
        )
    how, _, what_next = words[0].partition(": ")
    return f"the responses fit far better {how} {better}: {what_next}"


def _signs(fit: ElasticFit) -> Iterator[Reading]:
    models = [part.kernel.model for part in fit.parts]
    for at in dict.fromkeys(name for model in models for name in model.outputs):
        signs = [np.array([[-1.0 if name == at else 1.0] for name in model.outputs]) for model in models]
        yield Reading(f"y at {at}", times(fit, signs))
    for at in dict.fromkeys(name for model in models for name in model.inputs):
        signs = [np.array([[-1.0 if name == at else 1.0 for name in model.inputs]]) for model in models]
        yield Reading(f"u at {at}", times(fit, signs))


def _phases(fit: ElasticFit) -> Iterator[Reading]:
    """The sign is -1 where an odd power of j omega made of them what is fitted: (j omega)^* = -j omega."""
    turned = (
        "with all phases negated: they were written with the convention exp(-j omega t); take their complex conjugates"
    )
    swapped = "with real and imaginary parts exchanged: check which column or field is which"
    conjugate = replace(fit, parts=tuple(_conjugate(part) for part in fit.parts))
    for sign in (1, -1):
        yield Reading(turned, times(conjugate, [np.full((1, 1), sign)] * len(fit.parts)))
        yield Reading(swapped, times(conjugate, [np.full((1, 1), sign * 1j)] * len(fit.parts)))


def _quantities(fit: ElasticFit) -> Iterator[Reading]:
    for power in (1, 2, -1, -2):
        factors = [np.power(2j * np.pi * part.kernel.freq_hz[:, None, None], power) for part in fit.parts]
        count = "once" if abs(power) == 1 else "twice"
        how = "less" if power < 0 else "more"
        yield Reading(
            f"differentiated {count} {how} in time: check the quantity (position, velocity, acceleration) of the y "
            "channels",
            times(fit, factors),
        )


_KINDS: dict[str, Callable[[ElasticFit], Iterator[Reading]]] = {
    "sign": _signs,
    "phase": _phases,
    "quantity": _quantities,
}


def _scale_words(fit: ElasticFit, x: FloatArray, cost: float) -> tuple[Note, ...]:
    """A note on channels that are off by factors, found in alternation with the parameters."""
    outputs = list(dict.fromkeys(name for part in fit.parts for name in part.kernel.model.outputs))
    inputs = list(dict.fromkeys(name for part in fit.parts for name in part.kernel.model.inputs))
    best, scales = math.inf, np.zeros(len(outputs) + len(inputs))
    for start in (fit.parameters.x, x):
        c, z = np.zeros(len(scales)), start
        for _ in range(SCALE_ROUNDS):
            c = _scales(fit, z, outputs, inputs)
            V, z = roughly_solved(_scaled(fit, c, outputs, inputs), z)
            if best > V:
                best, scales = V, c
    if best > MAX_COST_RATIO_SCALED * cost:
        return ()
    names = [f"y at {name}" for name in outputs] + [f"u at {name}" for name in inputs]
    signs = [1] * len(outputs) + [-1] * len(inputs)  # the values of a torque are off by 1 / c
    off = [
        f"{name} times {math.exp(sign * c):.3g}"
        for name, c, sign in zip(names, scales, signs, strict=True)
        if abs(c) > math.log(MIN_SCALE)
    ]
    if not off:
        return ()
    return (
        Note(
            "misread-responses",
            f"the responses fit far better with channels scaled (V falls to {100 * best / cost:.2g} %), as by "
            f"{', '.join(off)}: check unit, scale, side (link or motor) and gear ratio of the channels, and the "
            "inertias of the robot",
        ),
    )


def _scales(fit: ElasticFit, x: FloatArray, outputs: list[str], inputs: list[str]) -> FloatArray:
    """ln c (n_y + n_u,) that makes the measured elements as large as the model's at x, in the median over lines."""
    rows, wanted = [], []
    for part in fit.parts:
        model, used = part.kernel.model, part.gain > 0
        G = np.abs(part.kernel.response(fit.theta(part, x)))
        for (i, output), (j, given) in ((o, u) for o in enumerate(model.outputs) for u in enumerate(model.inputs)):
            lines = used[:, i, j] & (G[:, i, j] > 0) & (part.measured[:, i, j] != 0)
            if lines.any():
                row = np.zeros(len(outputs) + len(inputs))
                row[outputs.index(output)] = row[len(outputs) + inputs.index(given)] = 1.0
                rows.append(row)
                wanted.append(float(np.median(np.log(G[lines, i, j] / np.abs(part.measured[lines, i, j])))))
    scales: FloatArray = np.linalg.lstsq(np.array(rows), np.array(wanted))[0]
    # Only sums c_y + c_u are known: the fewest channels are taken to be off, outputs rather than inputs.
    common = np.concatenate([np.zeros(len(outputs)), np.ones(len(inputs))]) - np.repeat(
        [1, 0], (len(outputs), len(inputs))
    )
    shifted = [scales - shift * common for shift in (*scales[len(outputs) :], *-scales[: len(outputs)])]
    return max(shifted, key=lambda c: int(np.sum(np.abs(c) < math.log(MIN_SCALE))))


def _scaled(fit: ElasticFit, c: FloatArray, outputs: list[str], inputs: list[str]) -> ElasticFit:
    factors = []
    for part in fit.parts:
        y = [c[outputs.index(name)] for name in part.kernel.model.outputs]
        u = [c[len(outputs) + inputs.index(name)] for name in part.kernel.model.inputs]
        factors.append(np.exp(np.add.outer(y, u)))
    return times(fit, factors)


def _conjugate(part: Part) -> Part:
    mixing = None if part.mixing is None else part.mixing.conj()
    return replace(part, measured=part.measured.conj(), mixing=mixing)
