r"""Shapes of friction: functions phi of a motor's measured angle and velocity, each 1 in steady sliding, and rates.

.. math:: sign: \phi = \tanh(v / D), \qquad stop,\ bristle: \phi = s / D, \qquad rate: \phi = \dot s

.. math:: stribeck: \phi = \operatorname{sgn}(v)\, e^{-(v / D)^2}

Friction brakes: the torque on the motor is -f phi. A sign of threshold 0 is Coulomb's; one of a small threshold turns
gradually, as oil or noise in the velocity make it. A rate is the damping of a bristle: 0 in steady sliding. The level
of a stribeck shape is F_s - F_c, the torque by which slow motion has more friction than fast motion: also 0 there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np
from numpy.fft import rfft

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen, labelled
from elastid.friction.operators import Path, bristle, stop
from elastid.nonlinear.motion import Motion, laplace, whole_samples
from elastid.record import Record

Kind: TypeAlias = Literal["sign", "stribeck", "stop", "bristle", "stop rate", "bristle rate"]
RATE_OF: dict[Kind, Kind] = {"stop": "stop rate", "bristle": "bristle rate"}


@dataclass(frozen=True)
class Shape:
    """A shape at a motor, by its place; threshold D: rad/s of sign and stribeck, else rad (m/s, m) on the link side."""

    place: str
    kind: Kind
    threshold: float = labelled("distance over which a bristle bends, link side", "rad", default=0.0)

    @property
    def is_rate(self) -> bool:
        """True if its level is a damping, in Nms/rad, and not a torque."""
        return self.kind in RATE_OF.values()

    @property
    def when_fast(self) -> float:
        """The shape in fast steady sliding: 1 if its level is a part of F_c, else 0."""
        return float(self.kind != "stribeck" and not self.is_rate)

    def reversal(self, distance: FloatArray) -> FloatArray:
        """The shape (n,) at `distance` (n,) after a reversal out of fast steady sliding: from -1 to 1."""
        if not self.when_fast:
            return np.zeros(len(distance))
        if self.kind == "sign":
            return np.where(distance > 0, 1.0, -1.0)
        x = distance / self.threshold
        return np.asarray(np.minimum(x - 1, 1.0) if self.kind == "stop" else 1 - 2 * np.exp(-x))

    def sliding(self, velocity: FloatArray) -> FloatArray:
        """The shape (n,) in steady sliding at `velocity` (n,)."""
        if self.is_rate:
            return np.zeros(len(velocity))
        if self.kind == "stribeck":
            return np.asarray(np.sign(velocity) * np.exp(-((velocity / self.threshold) ** 2)))
        gradual = self.kind == "sign" and self.threshold > 0
        return np.asarray(np.tanh(velocity / self.threshold) if gradual else np.sign(velocity))


def amplitudes(
    record: Record, motion: Motion, shapes: Sequence[Shape], periods: IntArray, lines: IntArray
) -> ComplexArray:
    """Amplitudes (n_f, F) of the shapes of a motor at lines (F,), in the mean over some repetitions of a record."""
    L, n = record.repeat_samples * motion.cells, record.period_samples * motion.cells
    dft = np.zeros((len(shapes), len(lines)), complex)
    for shape, of_shape, means in zip(shapes, dft, _cell_means(record, motion, shapes), strict=True):
        repetitions = means.reshape(-1, L)[periods]
        mean = ((-1.0) ** periods @ repetitions if record.half_wave else repetitions.sum(axis=0)) / len(periods)
        if record.half_wave:
            mean = np.concatenate([mean, -mean])
        of_shape[:] = rfft(mean)[lines]
        if shape.is_rate:
            of_shape *= 2j * np.pi * record.rate_hz / record.period_samples * shape.threshold * lines
    return np.asarray(dft * _of_cells(n, motion.cells)[lines] * (2 / record.period_samples))


def spectrum(record: Record, motion: Motion, taken: Sequence[tuple[Shape, float]]) -> ComplexArray:
    """DFT (n cells // 2 + 1,), as of the n samples of whole periods, of a motor's friction: shapes, their levels."""
    n = whole_samples(record)
    # One transform of a sum: it costs more than a shape.
    dft = rfft(_sum_of_cell_means(record, motion, [(shape, level) for shape, level in taken if not shape.is_rate]))
    if rates := [(shape, level) for shape, level in taken if shape.is_rate]:
        dft += rfft(_sum_of_cell_means(record, motion, rates)) * laplace(len(dft), n, record.rate_hz)
    dft *= _of_cells(n * motion.cells, motion.cells)
    return dft


def _sum_of_cell_means(record: Record, motion: Motion, taken: Sequence[tuple[Shape, float]]) -> FloatArray:
    """The mean (n cells,) in each cell of friction of some shapes; of rates, of the bristles times their thresholds."""
    signs = [(shape.threshold, level) for shape, level in taken if shape.kind == "sign"]
    total = sum_of_mean_signs(motion.velocity, signs) if signs else np.zeros(len(motion.velocity) - 1)
    bent = [
        (shape, level * (shape.threshold if shape.is_rate else 1.0)) for shape, level in taken if shape.kind != "sign"
    ]
    for (_, level), means in zip(bent, _cell_means(record, motion, [shape for shape, _ in bent]), strict=True):
        total += level * means
    return total


def _cell_means(record: Record, motion: Motion, shapes: Sequence[Shape]) -> Iterator[FloatArray]:
    """The mean (n cells,) in each cell of each shape, or of the bristle whose rate it is."""
    path = None
    if any(shape.kind not in ("sign", "stribeck") for shape in shapes):
        # The state of a bristle at the start is not known: the first period is run over twice.
        before = motion.angle[: record.period_samples * motion.cells]
        path = Path.of(np.concatenate([before - before[-1] + motion.angle[0], motion.angle])).without(len(before))
    for shape in shapes:
        if shape.kind == "stribeck":
            yield mean_stribeck(motion.velocity, shape.threshold)
        elif path is None or shape.kind == "sign":
            yield mean_sign(motion.velocity, shape.threshold)
        else:
            s = (stop if shape.kind.startswith("stop") else bristle)(path, shape.threshold)
            yield (s[:-1] + s[1:]) / (2 * shape.threshold)


@lru_cache(maxsize=4)
def _of_cells(n: int, cells: int) -> ComplexArray:
    """From the DFT (n // 2 + 1,) of the means over n cells to that of samples: a mean is the middle value, filtered by
    sinc."""
    x = np.arange(n // 2 + 1) / n
    return frozen(np.exp(-1j * np.pi * x) / (np.sinc(x) * cells), np.complex128)


def mean_sign(v: FloatArray, v_s: float) -> FloatArray:
    """Mean (n - 1,) of tanh(v / v_s) over each cell between points v (n,), v linear in it; of sgn(v) where v_s = 0."""
    return sum_of_mean_signs(v, [(v_s, 1.0)])


def mean_stribeck(v: FloatArray, v_s: float) -> FloatArray:
    """Mean (n - 1,) of sgn(v) exp(-(v / v_s)^2) over each cell between points v (n,), v linear in it.

    By the integral v_s sqrt(pi) / 2 erf(|v| / v_s).
    """
    from scipy.special import erf

    near, means = _means_near_reversals(
        v,
        6.5 * v_s,  # beyond, the exponential is below 1e-18
        lambda speed: v_s * np.sqrt(np.pi) / 2 * erf(speed / v_s),
        lambda middle: np.sign(middle) * np.exp(-((middle / v_s) ** 2)),
    )
    mean = np.zeros(len(v) - 1)
    mean[near] = means
    return mean


def sum_of_mean_signs(v: FloatArray, signs: Sequence[tuple[float, float]]) -> FloatArray:
    """Sum (n - 1,) of levels times `mean_sign`, of pairs of a speed v_s and a level; they share the search for cells.

    By the integral v_s ln cosh(v / v_s), or |v|; so a reversal within a cell counts where it is.
    """

    def integral(speed: FloatArray) -> FloatArray:
        total = sum(level for _, level in signs) * speed
        for v_s, level in signs:
            if v_s > 0:
                total += level * v_s * np.log1p(np.exp(speed * (-2 / v_s)))
        return np.asarray(total)

    def limit(middle: FloatArray) -> FloatArray:
        parts = (level * (np.tanh(middle / v_s) if v_s > 0 else np.sign(middle)) for v_s, level in signs)
        return np.asarray(sum(parts))

    # Beyond 12 v_s, tanh is 1 to 1e-10.
    near, means = _means_near_reversals(v, 12.0 * max(v_s for v_s, _ in signs), integral, limit)
    total = np.copysign(sum(level for _, level in signs), v[:-1])
    total[near] = means
    return np.asarray(total)


def _means_near_reversals(
    v: FloatArray,
    reach: float,
    integral: Callable[[FloatArray], FloatArray],
    limit: Callable[[FloatArray], FloatArray],
) -> tuple[BoolArray, FloatArray]:
    """Cells (n - 1,) between points v (n,) where v turns or is below `reach`, and the means of a function over these.

    integral: of the function of |v|; limit: the function itself, for cells over which v is constant.
    """
    slow, negative = np.abs(v) <= reach, np.signbit(v)
    near = slow[:-1] | slow[1:] | (negative[:-1] != negative[1:])
    # The points of these cells, once each: neighbours among them are a cell, or lie at both sides of a gap.
    begins = np.append(near, False)
    is_point = begins.copy()
    is_point[1:] |= near
    points, is_cell = v[is_point], begins[is_point][:-1]
    step, speed = np.diff(points), np.abs(points)
    constant = np.abs(step) <= 1e-6 * (speed[1:] + speed[:-1])
    step[constant] = 1.0
    means = np.diff(integral(speed)) / step
    means[constant] = limit((points[1:] + points[:-1])[constant] / 2)
    return near, means[is_cell]
