r"""Channels in another unit, found by how large the measured elements are beside those of the model.

.. math:: |\hat G_{ij}| \approx \frac{|G_{ij}|}{c_i c_j}

in the median over lines; only products are known, and the fewest channels are taken to be off.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.diagnosis.modification.reading import Reading, evaluated_at, settled
from elastid.fit.diagnosis.modification.sensitivities import Evaluated
from elastid.fit.problem.elastic import ElasticFit

# A scale nearer to one than this factor may be an inertia that is not quite known.
MIN_SCALE = 1.7
# Scales and parameters are found in turn.
ROUNDS = 2


@dataclass(frozen=True)
class Scales:
    """ln c of outputs and inputs, by their places."""

    outputs: dict[str, float]
    inputs: dict[str, float]

    def change(self, one: Evaluated, values: ComplexArray) -> ComplexArray:
        """The response of the model as the channels read it."""
        model = one.part.kernel.model
        rows, columns = [self.outputs[at] for at in model.outputs], [self.inputs[at] for at in model.inputs]
        return np.asarray(values * np.exp(-np.add.outer(rows, columns)))

    @property
    def words(self) -> str:
        """The channels that are off by factors; the values of a torque are off by 1 / c."""
        factors = [(f"y at {at}", c) for at, c in self.outputs.items()]
        factors += [(f"u at {at}", -c) for at, c in self.inputs.items()]
        return ", ".join(f"{name} times {math.exp(c):.3g}" for name, c in factors if abs(c) > math.log(MIN_SCALE))


def scaled(fit: ElasticFit, starts: Sequence[FloatArray]) -> Iterator[tuple[str, float, FloatArray]]:
    """From each start the channels that are off, in words, with V and x (n_x,) of the optimum with their scales."""
    everything = np.ones(len(fit.parameters.x), dtype=bool)
    for x in starts:
        there, V = x, math.inf
        for _ in range(ROUNDS):
            scales = _scales(evaluated_at(fit, there))
            if not scales.words:
                break
            V, there = settled(Reading("", "scale", scales.change), fit, there, everything)
        if scales.words:
            yield scales.words, V, there


def _scales(evaluated: Sequence[Evaluated]) -> Scales:
    """That make the measured elements as large as the model's."""
    outputs = list(dict.fromkeys(name for one in evaluated for name in one.part.kernel.model.outputs))
    inputs = list(dict.fromkeys(name for one in evaluated for name in one.part.kernel.model.inputs))
    rows, wanted = [], []
    for one in evaluated:
        model, used, G = one.part.kernel.model, one.part.gain > 0, np.abs(one.G)
        for (i, output), (j, given) in ((o, u) for o in enumerate(model.outputs) for u in enumerate(model.inputs)):
            lines = used[:, i, j] & (G[:, i, j] > 0) & (one.part.measured[:, i, j] != 0)
            if lines.any():
                row = np.zeros(len(outputs) + len(inputs))
                row[outputs.index(output)] = row[len(outputs) + inputs.index(given)] = 1.0
                rows.append(row)
                wanted.append(float(np.median(np.log(G[lines, i, j] / np.abs(one.part.measured[lines, i, j])))))
    c = _fewest(np.linalg.lstsq(np.array(rows), np.array(wanted))[0], len(outputs)).tolist()
    return Scales(dict(zip(outputs, c, strict=False)), dict(zip(inputs, c[len(outputs) :], strict=True)))


def _fewest(c: FloatArray, n_y: int) -> FloatArray:
    """ln c with the fewest channels off, outputs rather than inputs: only the sums of the two are known."""
    common = np.where(np.arange(len(c)) < n_y, -1.0, 1.0)
    shifted = [c - shift * common for shift in (*c[n_y:], *-c[:n_y])]
    return max(shifted, key=lambda one: int(np.sum(np.abs(one) < math.log(MIN_SCALE))))
