r"""Shapes of friction: functions phi of a motor's measured angle and velocity, each 1 in steady sliding, and rates.

.. math:: sign: \phi = \tanh(v / D), \qquad stop,\ bristle: \phi = s / D, \qquad rate: \phi = \dot s

Friction brakes: the torque on the motor is -f phi. A sign of threshold 0 is Coulomb's; one of a small threshold turns
gradually, as oil or noise in the velocity make it. A rate is the damping of a bristle: 0 in steady sliding.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.frf.friction.motion import CELLS, Motion
from elastid.frf.friction.operators import bristle, mean_sign, stop
from elastid.record import Record

Kind: TypeAlias = Literal["sign", "stop", "bristle", "stop rate", "bristle rate"]
RATE_OF: dict[Kind, Kind] = {"stop": "stop rate", "bristle": "bristle rate"}


@dataclass(frozen=True)
class Shape:
    """A shape at a motor, by its place; threshold D: rad/s of a sign, else rad (m/s, m) on the link side."""

    place: str
    kind: Kind
    threshold: float = 0.0

    @property
    def is_rate(self) -> bool:
        """Whether its level is a damping, in Nms/rad, and not a torque."""
        return self.kind in RATE_OF.values()

    def reversal(self, distance: FloatArray) -> FloatArray:
        """The shape (n,) at `distance` (n,) after a reversal out of steady sliding, moved slowly: from -1 to 1."""
        if self.is_rate:
            return np.zeros(len(distance))
        if self.kind == "sign":
            return np.where(distance > 0, 1.0, -1.0)
        x = distance / self.threshold
        return np.asarray(np.minimum(x - 1, 1.0) if self.kind == "stop" else 1 - 2 * np.exp(-x))

    def sliding(self, velocity: FloatArray) -> FloatArray:
        """The shape (n,) in steady sliding at `velocity` (n,)."""
        if self.is_rate:
            return np.zeros(len(velocity))
        gradual = self.kind == "sign" and self.threshold > 0
        return np.asarray(np.tanh(velocity / self.threshold) if gradual else np.sign(velocity))


def amplitudes(record: Record, motion: Motion, shape: Shape, periods: IntArray, lines: IntArray) -> ComplexArray:
    """Amplitudes (F,) of a shape at lines (F,), in the mean over some repetitions of a record."""
    L = record.repeat_samples * CELLS
    means = _cell_means(record, motion, shape).reshape(-1, L)[periods]
    if record.half_wave:
        means = means * (-1.0) ** periods[:, None]
    mean = means.mean(axis=0)
    if record.half_wave:
        mean = np.concatenate([mean, -mean])
    found = rfft(mean)[lines] * _of_cells(lines, len(mean)) * (2 / record.period_samples)
    return np.asarray(found * _derivative(record, shape, lines, record.period_samples))


def samples(record: Record, motions: Mapping[str, Motion], shapes: Sequence[Shape]) -> FloatArray:
    """The shapes (n, n_f) at the samples of all whole periods of a record, without frequencies above half the rate."""
    n = record.n_samples // record.period_samples * record.period_samples
    lines = np.arange(n // 2 + 1)
    columns = []
    for shape in shapes:
        columns.append(irfft(spectrum(record, motions[shape.place], shape, n, lines), n))
    return np.stack(columns, axis=1)


def spectrum(record: Record, motion: Motion, shape: Shape, n: int, lines: IntArray) -> ComplexArray:
    """DFT (F,), as of n samples, of a shape over the whole periods of a record; lines may be above n / 2."""
    found = rfft(_cell_means(record, motion, shape))[lines]
    return np.asarray(found * _of_cells(lines, n * CELLS) * _derivative(record, shape, lines, n))


def _cell_means(record: Record, motion: Motion, shape: Shape) -> FloatArray:
    """The mean (n CELLS,) in each cell of a shape, or of the bristle whose rate it is."""
    if shape.kind == "sign":
        return mean_sign(motion.velocity, shape.threshold)
    # Its state at the start is not known: the first period is run over twice.
    before = motion.angle[: record.period_samples * CELLS]
    q = np.concatenate([before - before[-1] + motion.angle[0], motion.angle])
    operator = stop if shape.kind.startswith("stop") else bristle
    s = operator(q, shape.threshold)[len(before) :]
    return np.asarray((s[:-1] + s[1:]) / (2 * shape.threshold))


def _of_cells(lines: IntArray, n: int) -> ComplexArray:
    """From the DFT of the means over n cells to that of samples: a mean is the middle value, filtered by sinc."""
    x = lines / n
    return np.asarray(np.exp(-1j * np.pi * x) / (np.sinc(x) * CELLS))


def _derivative(record: Record, shape: Shape, lines: IntArray, n: int) -> ComplexArray | float:
    if not shape.is_rate:
        return 1.0
    return np.asarray(2j * np.pi * record.rate_hz / n * shape.threshold * lines)
