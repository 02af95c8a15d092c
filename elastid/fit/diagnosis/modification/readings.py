r"""Other ways to read the responses, as what each would do to those of the model.

.. math:: \hat G \approx S G, \quad P G, \quad G^*, \quad j G^*, \quad (j \omega)^k G

A channel of the other sign, channels or postures exchanged, phases counted by exp(-j omega t), real and imaginary parts
exchanged, a velocity taken for an acceleration.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.diagnosis.modification.reading import Reading
from elastid.fit.diagnosis.modification.sensitivities import Evaluated

# Configurations that fit worst are tried in each other's place, so many.
MAX_EXCHANGED = 8


def readings(evaluated: Sequence[Evaluated], costs: FloatArray) -> Iterator[Reading]:
    """All that are tried; costs (Q,): V of each configuration."""
    outputs = tuple(dict.fromkeys(name for one in evaluated for name in one.part.kernel.model.outputs))
    inputs = tuple(dict.fromkeys(name for one in evaluated for name in one.part.kernel.model.inputs))
    yield from _signs(outputs, inputs)
    yield from _exchanged_channels(outputs, inputs)
    yield from _exchanged_postures(evaluated, costs)
    yield from _phases()
    yield from _quantities()


def _signs(outputs: Sequence[str], inputs: Sequence[str]) -> Iterator[Reading]:
    for at in outputs:
        yield Reading(f"y at {at} with the other sign", "sign", partial(_turned, {at}, set()))
    for at in inputs:
        yield Reading(f"u at {at} with the other sign", "sign", partial(_turned, set(), {at}))
    for at in inputs:
        if at in outputs:
            name = f"{at} counted in the other direction, torque and motion"
            yield Reading(name, "direction", partial(_turned, {at}, {at}))


def _turned(outputs: set[str], inputs: set[str], one: Evaluated, values: ComplexArray) -> ComplexArray:
    model = one.part.kernel.model
    rows = np.array([-1.0 if name in outputs else 1.0 for name in model.outputs])
    columns = np.array([-1.0 if name in inputs else 1.0 for name in model.inputs])
    return np.asarray(values * np.outer(rows, columns))


def _exchanged_channels(outputs: Sequence[str], inputs: Sequence[str]) -> Iterator[Reading]:
    for a, b in combinations(outputs, 2):
        yield Reading(f"y at {a} and at {b} exchanged", "exchanged channels", partial(_permuted, {a: b, b: a}, {}))
    for a, b in combinations(inputs, 2):
        both = {a: b, b: a}
        yield Reading(f"u at {a} and at {b} exchanged", "exchanged channels", partial(_permuted, {}, both))
        if a in outputs and b in outputs:
            name = f"{a} and {b} exchanged, torques and motions"
            yield Reading(name, "exchanged channels", partial(_permuted, both, both))


def _permuted(outputs: dict[str, str], inputs: dict[str, str], one: Evaluated, values: ComplexArray) -> ComplexArray:
    def places(names: Sequence[str], swapped: dict[str, str]) -> list[int]:
        wanted = [swapped.get(name, name) for name in names]
        return [names.index(name) if name in names else i for i, name in enumerate(wanted)]

    model = one.part.kernel.model
    rows, columns = places(model.outputs, outputs), places(model.inputs, inputs)
    return np.asarray(values[..., rows, :][..., columns])


def _exchanged_postures(evaluated: Sequence[Evaluated], costs: FloatArray) -> Iterator[Reading]:
    """Pairs among those that fit worst, and have the same lines and channels."""
    worst = sorted(np.argsort(-costs)[:MAX_EXCHANGED].tolist())
    for a, b in combinations(worst, 2):
        if not _are_alike(evaluated[a], evaluated[b]):
            continue
        order = list(range(len(evaluated)))
        order[a], order[b] = b, a
        first, second = (evaluated[i].part.configuration for i in (a, b))
        name = f"responses of configurations {first} and {second} exchanged"
        yield Reading(name, "exchanged postures", lambda _, values: values, tuple(order))


def _are_alike(one: Evaluated, other: Evaluated) -> bool:
    first, second = one.part.kernel, other.part.kernel
    same = (first.model.outputs, first.model.inputs) == (second.model.outputs, second.model.inputs)
    return same and np.array_equal(first.freq_hz, second.freq_hz)


def _phases() -> Iterator[Reading]:
    """The sign is -1 where an odd power of j omega made of them what is fitted: (j omega)^* = -j omega."""
    for sign in (1, -1):
        yield Reading("all phases negated", "phase", partial(_conjugated, sign))
        yield Reading("real and imaginary parts exchanged", "parts", partial(_conjugated, 1j * sign))


def _conjugated(factor: complex, _: Evaluated, values: ComplexArray) -> ComplexArray:
    return np.asarray(factor * values.conj())


def _quantities() -> Iterator[Reading]:
    for power in (1, 2, -1, -2):
        count, how = "once" if abs(power) == 1 else "twice", "less" if power > 0 else "more"
        name = f"responses differentiated {count} {how} in time"
        yield Reading(name, "quantity", partial(_differentiated, power))


def _differentiated(power: int, one: Evaluated, values: ComplexArray) -> ComplexArray:
    s = 2j * np.pi * one.part.kernel.freq_hz
    return np.asarray(values * (s**power)[:, None, None])
