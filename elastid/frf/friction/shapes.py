r"""Shapes of friction: functions phi(q, v) of a motor's measured angle and velocity, each 1 in steady sliding.

.. math:: sign: &\quad \phi = \mathrm{sgn}\, v \\
          stop: &\quad \phi = s / D, \qquad s(t + dt) = \mathrm{clip}(s(t) + dq, -D, D)

A stop operator is a bristle that bends over the distance D before it slides (an element of Maxwell's slip law); as
D -> 0 it is the sign. Friction brakes: the torque on the motor is -f phi.

Angle and velocity are known on a grid finer than the samples, by the DFT of the whole record; a shape is its mean over
each cell of that grid, with the velocity linear in it, so that a reversal within a cell counts where it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.record import MOTION_ORDER, Record

Kind: TypeAlias = Literal["sign", "stop"]

# Cells of the fine grid in a sample.
CELLS = 8


@dataclass(frozen=True)
class Shape:
    """A shape at a motor, by its place; threshold: D of a stop operator, rad (or m) on the link side, else 0."""

    place: str
    kind: Kind
    threshold: float = 0.0


@dataclass(frozen=True)
class Motion:
    """Angle and velocity (n CELLS + 1,) of one motor on the fine grid of a record of n samples, and its last sample."""

    angle: FloatArray
    velocity: FloatArray


def motion_of(record: Record, place: str) -> Motion:
    """The motion of a motor over all whole periods of a record; exact where it is periodic and has no frequencies above
    half the rate."""
    column = record.outputs.index(place)
    n = record.n_samples // record.period_samples * record.period_samples
    y = record.y[:n, column]
    order = MOTION_ORDER[record.quantities[column]]
    # What does not return to its start within the record is a drift, and no part of a periodic motion.
    gain = _gain(y, record.period_samples) if order == 0 else 0.0
    Y = rfft(y - y[0] - gain * np.arange(n) / n)
    s = np.asarray(2j * np.pi * record.rate_hz / n * np.arange(len(Y)), dtype=np.complex128)
    angle = irfft(_integrated(Y, s, order), n * CELLS) * CELLS
    velocity = irfft(_integrated(Y, s, order - 1), n * CELLS) * CELLS
    angle = np.append(angle, angle[0])
    velocity = np.append(velocity, velocity[0])
    if gain:
        angle = angle + gain * np.arange(n * CELLS + 1) / (n * CELLS)
        velocity = velocity + gain * record.rate_hz / n
    return Motion(angle, velocity)


def cell_means(motion: Motion, shape: Shape, warm_up: int) -> FloatArray:
    """The mean (n CELLS,) of a shape in each cell.  warm_up: cells that a stop operator runs over twice, since its
    state at the start is not known."""
    if shape.kind == "sign":
        return _mean_sign(motion.velocity)
    before = motion.angle[:warm_up]
    s = stop(np.concatenate([before - before[-1] + motion.angle[0], motion.angle]), shape.threshold)[warm_up:]
    return np.asarray((s[:-1] + s[1:]) / (2 * shape.threshold))


def stop(q: FloatArray, D: float) -> FloatArray:
    """Stop operator s (n,) of q (n,) from s = 0, exact where q is monotonous between its points.

    Between two turning points it is s_0 + q - q_0, clipped; so only these need to be followed one after the other.
    """
    direction = np.sign(np.diff(q))
    turning = np.concatenate([[0], np.flatnonzero(direction[1:] * direction[:-1] <= 0) + 1, [len(q) - 1]])
    steps = np.diff(q[turning]).tolist()
    states = [0.0]
    for step in steps:
        states.append(min(max(states[-1] + step, -D), D))
    last = np.repeat(np.arange(len(steps)), np.diff(turning))
    last = np.append(last, len(steps) - 1)
    return np.asarray(np.clip(np.array(states)[last] + q - q[turning[last]], -D, D))


def shape_spectrum(record: Record, motion: Motion, shape: Shape) -> ComplexArray:
    """DFT (n // 2 + 1,) of the shape over the n samples of all whole periods of a record, as band-limited samples."""
    means = cell_means(motion, shape, record.period_samples * CELLS)
    n = len(means) // CELLS
    # The mean over a cell is the value in its middle, filtered by sinc.
    x = np.arange(n // 2 + 1) / (n * CELLS)
    return np.asarray(rfft(means)[: len(x)] * np.exp(-1j * np.pi * x) / (np.sinc(x) * CELLS))


def shape_samples(record: Record, motions: dict[str, Motion], shapes: Sequence[Shape]) -> FloatArray:
    """The shapes (n, n_f) at the samples of all whole periods of a record, without frequencies above half the rate."""
    n = record.n_samples // record.period_samples * record.period_samples
    columns = [irfft(shape_spectrum(record, motions[shape.place], shape), n) for shape in shapes]
    return np.stack(columns, axis=1)


def _gain(y: FloatArray, period: int) -> float:
    """What y gains over the whole record, from sample to sample a period later."""
    return float(np.mean(y[-period:] - y[:period]) * len(y) / max(1, len(y) - period)) if len(y) > period else 0.0


def _integrated(Y: ComplexArray, s: ComplexArray, order: int) -> ComplexArray:
    """Y / s^order; a mean has no integral."""
    if order <= 0:
        return np.asarray(Y * s**-order)
    return np.concatenate([[0.0], Y[1:] / s[1:] ** order])


def _mean_sign(v: FloatArray) -> FloatArray:
    """Mean of sgn(v) over each cell, v linear in it: (|b| - |a|) / (b - a)."""
    a, b = v[:-1], v[1:]
    same = a * b >= 0
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (np.abs(b) - np.abs(a)) / (b - a)
    return np.where(same, np.sign(a + b), mean)


def reversal_curve(shape: Shape, distance: FloatArray) -> FloatArray:
    """The shape (n,) at `distance` (n,) after a reversal out of steady sliding: from -1 to 1."""
    if shape.kind == "sign":
        return np.where(distance > 0, 1.0, -1.0)
    return np.minimum(distance / shape.threshold - 1, 1.0)
