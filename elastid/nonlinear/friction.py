r"""Friction at motors that was found, and its shapes: functions phi of angle and velocity, each 1 in steady sliding.

.. math:: sign: \phi = \tanh(v / D), \qquad stop,\ bristle: \phi = s / D

.. math:: stribeck: \phi = \operatorname{sgn}(v)\, e^{-(v / D)^2}, \qquad damping: \phi = T \dot s / D

Friction brakes: the torque on the motor is -f phi. A sign of threshold 0 is Coulomb's; one of a small threshold turns
gradually, as oil or noise in the velocity make it. The level of a stribeck shape is F_s - F_c, the torque by which slow
motion has more friction than fast motion: 0 there. So has damping, which acts on the rate of a stop or a bristle, as
LuGre's sigma_1 = level T / D does; T is a sample.

The motion follows from a motor's angle and torque. Above the excited lines a motor moves as an inertia,

.. math:: q_a = \frac{a}{s^2} \Big(H u - \sum_i f_i \phi_i\Big), \qquad a = -\omega^2 G \text{ at high frequencies}

with phi_i along the motion of the round before. Noise of the angle is a velocity that grows with frequency and hides
where a motor turns back; what of a line of the angle is noise, 1 - w of its power (`motion.signal_share`), is taken
from the torque there, q = w y + (1 - w) q_a. (3e-6 rad at 500 Hz with Coulomb friction of 0.3 of the rms torque: k
known three times as well.) Reversals between the samples are late by some 2 % of a sample, which the responses' errors
have.

The torque of a record is held between its samples, friction is not; so friction is divided by the hold as samples. A
torque that is logged later than the motion by tau has its friction by tau later, too:

.. math:: u_{net} = u - u_\phi, \qquad u_\phi = IDFT\{ H^{-1} e^{-s \tau}\, DFT\{ \textstyle\sum_i f_i \phi_i \} \}
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen, frozen_value, labelled
from elastid.base.errors import Note
from elastid.base.statistics import QUANTILE_95
from elastid.excitation.grids import line_frequencies
from elastid.friction.stop_operator import Path, bristle, stop
from elastid.nonlinear.motion import CELLS, Motion, laplace, motion_of, whole_samples
from elastid.record import Record

Kind: TypeAlias = Literal["sign", "stribeck", "stop", "bristle", "stop damping", "bristle damping"]


@dataclass(frozen=True)
class Shape:
    """A shape at a motor, by its place; threshold D: rad/s of sign and stribeck, else rad (m/s, m) on the link side.

    delay_s: by which its torque is logged later than its motion, the same of all shapes.
    """

    place: str
    kind: Kind
    threshold: float = labelled("distance over which a bristle bends, link side", "rad", default=0.0)
    delay_s: float = labelled("by which the torque is logged later than the motion", "s", default=0.0)

    @property
    def when_fast(self) -> float:
        """The shape in fast steady sliding: 1 if its level is a part of F_c, else 0."""
        return float(self.kind != "stribeck" and not self.is_damping)

    @property
    def is_damping(self) -> bool:
        """True if it is the rate of a stop or a bristle."""
        return self.kind in ("stop damping", "bristle damping")

    @property
    def is_memoryless(self) -> bool:
        """True if it depends on the velocity alone."""
        return self.kind in ("sign", "stribeck")

    def reversal(self, distance: FloatArray) -> FloatArray:
        """The shape (n,) at `distance` (n,) after a reversal out of fast steady sliding: from -1 to 1."""
        if not self.when_fast:
            return np.zeros(len(distance))
        if self.kind == "sign":
            return np.where(distance > 0, 1.0, -1.0)
        x = distance / self.threshold
        return np.minimum(x - 1, 1.0) if self.kind == "stop" else 1 - 2 * np.exp(-x)

    def sliding(self, velocity: FloatArray) -> FloatArray:
        """The shape (n,) in steady sliding at `velocity` (n,)."""
        if self.kind == "stribeck":
            return np.sign(velocity) * np.exp(-((velocity / self.threshold) ** 2))
        if self.is_damping:
            return np.zeros(len(velocity))
        gradual = self.kind == "sign" and self.threshold > 0
        return np.tanh(velocity / self.threshold) if gradual else np.sign(velocity)

    def integral(self, speed: FloatArray) -> FloatArray:
        """The integral (n,) over velocity of a sign or Stribeck curve in steady sliding, up to speeds (n,)."""
        if self.kind == "stribeck":
            from scipy.special import erf

            return np.asarray(self.threshold * np.sqrt(np.pi) / 2 * erf(speed / self.threshold))
        gradual = self.threshold * np.log1p(np.exp(speed * (-2 / self.threshold))) if self.threshold > 0 else 0.0
        return speed + gradual


Taken: TypeAlias = Sequence[tuple[Shape, float]]


def amplitudes(
    record: Record, motion: Motion, shapes: Sequence[Shape], repetitions: IntArray, lines: IntArray
) -> ComplexArray:
    """Amplitudes (n_f, F) of the shapes of a motor at lines (F,), of the mean of some of its repetitions, by number."""
    path = path_of(record, motion) if any(not shape.is_memoryless for shape in shapes) else None
    of_shapes = (friction_means(record, motion, [(shape, 1.0)], path) for shape in shapes)
    dft, N = rfft([_mean_period(record, means, repetitions) for means in of_shapes]), record.period_samples
    delay = np.exp(-2j * np.pi * record.rate_hz / N * np.outer([shape.delay_s for shape in shapes], lines))
    return dft[:, lines] * _between_cells(N, int(lines[-1]) + 1)[lines] * (2 / N) * delay


@lru_cache(maxsize=16)
def _between_cells(n: int, lines: int) -> ComplexArray:
    r"""Factors (lines,) from the DFT of means in cells of n samples to the transform of the torque that has them.

    .. math:: \frac{1}{N_c}\, \frac{e^{-j \omega T_c / 2}}{\mathrm{sinc}(\omega T_c / 2)}
    """
    cell = np.arange(lines) / (n * CELLS)
    return frozen(np.exp(-1j * np.pi * cell) / (CELLS * np.sinc(cell)), np.complex128)


def _mean_period(record: Record, x: FloatArray, repetitions: IntArray) -> FloatArray:
    """The mean period (m,) of some repetitions of a signal (n m,)."""
    weights = np.zeros(whole_samples(record) // record.repeat_samples)
    weights[repetitions] = np.where(record.half_wave & (repetitions % 2 == 1), -1.0, 1.0) / len(repetitions)
    mean = weights @ x.reshape(len(weights), -1)
    return np.concatenate([mean, -mean]) if record.half_wave else np.asarray(mean)


def friction_means(record: Record, motion: Motion, taken: Taken, path: Path | None = None) -> FloatArray:
    """A motor's friction (n cells,) in the cells of the samples of whole periods: shapes, their levels.

    path: `path_of` the motion, if known.
    """
    memoryless = [(shape, level) for shape, level in taken if shape.is_memoryless]
    steady = np.copysign(sum(level for shape, level in memoryless if shape.kind == "sign"), motion.by_sample[0])
    means = np.repeat(steady, CELLS)
    if memoryless:
        # Faster than some of their thresholds memoryless shapes are 1 or 0, to 1e-4.
        slow = motion.slowest <= 5 * max(shape.threshold for shape, _ in memoryless)
        means.reshape(-1, CELLS)[slow] = sliding_means(motion.by_sample[:, slow].T, memoryless)
    for shape, level in taken:
        if not shape.is_memoryless:
            path = path or path_of(record, motion)
            operator = stop if shape.kind.startswith("stop") else bristle
            s = operator(path, shape.threshold) * (level / shape.threshold / 2)
            means += 2 * CELLS * np.diff(s) if shape.is_damping else s[:-1] + s[1:]
    return means


def spectrum(means: ComplexArray, n: int) -> ComplexArray:
    """Transform (n // 2 + 1,) of a torque at lines of n samples, in samples, by the DFT of its means in their cells."""
    return means[: n // 2 + 1] * _between_cells(n, n // 2 + 1)


def sliding_means(velocity: FloatArray, taken: Taken) -> FloatArray:
    r"""Means (m, cells) of memoryless friction g in the cells of m samples, v (m, cells + 1) being linear in a cell.

    .. math:: \bar g = \Delta I / \Delta v, \qquad I(v) = \int_0^v g
    """
    velocity = np.ascontiguousarray(velocity.T)
    step, before = np.diff(velocity, axis=0), velocity[:-1]
    constant = np.abs(step) <= 2e-6 * np.abs(before)
    step[constant] = 1.0
    means = np.zeros(step.shape)
    for shape, level in taken:
        means += level * np.diff(shape.integral(np.abs(velocity)), axis=0) / step
    means[constant] = sum(level * shape.sliding(before[constant]) for shape, level in taken)
    return means.T


def path_of(record: Record, motion: Motion) -> Path:
    """The way of a bristle whose state at the start is not known: the first period is run over twice."""
    before = motion.angle[: record.period_samples * CELLS]
    return Path.of(np.concatenate([before - before[-1] + motion.angle[0], motion.angle])).without(len(before))


def motion_under(record: Record, place: str, taken: Taken, a: float) -> Motion:
    """The motion of a motor under friction that was found; a: its acceleration per torque, 0 where unknown."""
    if a == 0:
        return motion_of(record, place)
    n, channel = whole_samples(record), record.inputs.index(place)
    s = laplace(n // 2 + 1, n, record.rate_hz)
    by_inertia = np.divide(a, s**2, out=np.zeros_like(s), where=s != 0)
    torque = hold_of(record)[:, channel] * np.exp(s * _delay(taken)) * rfft(record.u[:n, channel])
    return motion_of(
        record, place, lambda motion: by_inertia * (torque - spectrum(rfft(friction_means(record, motion, taken)), n))
    )


def _delay(taken: Taken) -> float:
    return taken[0][0].delay_s if taken else 0.0


def held_samples(record: Record, place: str, motion: Motion, taken: Taken) -> FloatArray:
    """A motor's friction (n,) along a motion as a torque that is held as u is."""
    n = whole_samples(record)
    low = spectrum(rfft(friction_means(record, motion, taken)), n)
    low *= np.exp(-_delay(taken) * laplace(len(low), n, record.rate_hz))
    H = hold_of(record)[:, record.inputs.index(place)]
    # Near a zero of the hold the torque's samples do not determine the torque.
    return irfft(np.divide(low, H, out=np.zeros_like(low), where=np.abs(H) > 0.1), n)


def hold_of(record: Record) -> ComplexArray:
    """H (n // 2 + 1, n_u) of the torques at the lines of all whole periods."""
    n = whole_samples(record)
    return record.hold_response(line_frequencies(np.arange(n // 2 + 1), record.rate_hz, n))


@frozen_value
class FrictionTakenOut:
    """Coefficients f_i of the friction basis functions, torque = -sum f_i phi_i, compensated in the records.

    places (n_m,): the motors that were looked at, `motor 1`.  place_units (n_m,): N*m, or N where a motor slides.
    shapes (n_f,): each with its motor; motors without shapes are not compensated.  coulomb_torque (n_f,): Nm (N), link
    side.  covariance (n_f, n_f): of the levels by noise, by what no shape has and by their difference between
    configurations; standard deviations are those of a normal distribution.
    configurations (C,).  before, after (C, n_m): amplitude of the torque that no response explains (Nm) at a line, the
    median of the lines, with friction in it and without: nonlinear distortion and noise.  residual_power_ratio (n_m,):
    residual over initial power in realisations that the levels were not fitted to, 1 without compensation.
    accelerance (n_m,): acceleration per torque a of a motor as an inertia, 1 / (kg m^2) (1 / kg), 0 where unknown.
    swings (n_m,): median motion between two reversals, rad (m), link side.
    notes: what was taken out of which motor, or why nothing was.
    """

    places: tuple[str, ...]
    place_units: tuple[str, ...]
    shapes: tuple[Shape, ...]
    coulomb_torque: FloatArray = labelled("torque of each basis function, link side", "N*m", "shape")
    covariance: FloatArray = labelled("covariance of the levels", "", "shape shape")
    configurations: tuple[str, ...]
    before: FloatArray = labelled("torque that no response explains, median line", "N*m", "configurations places")
    after: FloatArray = labelled("the same with friction taken out", "N*m", "configurations places")
    residual_power_ratio: FloatArray = labelled("share of its power left in other realisations", "", "places")
    accelerance: FloatArray = labelled("acceleration per torque as an inertia", "", "places")
    notes: tuple[Note, ...] = field(default=())
    swings: tuple[float, ...] = labelled("median motion between two reversals, link side", "rad", "places", default=())

    @property
    def std(self) -> FloatArray:
        """Standard deviation (n_f,) of the levels."""
        return np.sqrt(np.diag(self.covariance))

    def taken_shapes(self, place: str) -> tuple[tuple[Shape, float], ...]:
        """Basis functions compensated in a motor's torque, each with its coefficient."""
        pairs = zip(self.shapes, self.coulomb_torque.tolist(), strict=True)
        return tuple((shape, level) for shape, level in pairs if shape.place == place and level > 0)

    def taken_places(self) -> tuple[str, ...]:
        """Motors with compensated friction."""
        return tuple(place for place in self.places if any(shape.place == place for shape in self.shapes))

    def sliding_level(self, place: str) -> tuple[float, float]:
        """F_c in Nm (N) of fast steady sliding at a motor, the sum of its levels, and its standard deviation.

        Elements that do not slide between two reversals have a torque in sliding that the data do not show: what is
        left of it to sliding is another standard deviation.
        """
        row = np.array([shape.when_fast * (shape.place == place) for shape in self.shapes])
        swing = np.array([self.swing(place)])
        left = np.array([(1 - float(shape.reversal(swing)[0])) / 2 for shape in self.shapes])
        std = math.sqrt(max(float(row @ self.covariance @ row), 0.0))
        return float(row @ self.coulomb_torque), math.hypot(std, float((row * left) @ self.coulomb_torque))

    def swing(self, place: str) -> float:
        """Median motion of a motor between two reversals, rad (m), link side; infinite where it is not known."""
        return dict(zip(self.places, self.swings, strict=False)).get(place, math.inf)

    def swing_ratio(self, place: str) -> float:
        """Motion of a motor between two reversals over its presliding distance, F_c over stiffness."""
        taken = [(shape, level) for shape, level in self.taken_shapes(place) if shape.kind in ("stop", "bristle")]
        stiffness = sum(level / shape.threshold for shape, level in taken)
        return self.swing(place) * stiffness / sum(level for _, level in taken) if taken else math.inf

    def reversal(self, place: str, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Torque (n,) after a reversal out of fast sliding, at `distance` (n,) from it, and its standard deviation.

        From -F_c at distance 0 to F_c where all bristles slide again; link side, rad and Nm (m and N).
        """
        return self._curve(place, [shape.reversal(distance) for shape in self.shapes])

    def sliding(self, place: str, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Torque (n,) in steady sliding at `velocity` (n,), and its standard deviation; link side, rad/s and Nm."""
        return self._curve(place, [shape.sliding(velocity) for shape in self.shapes])

    def motion(self, record: Record, place: str) -> Motion:
        """The motion of a motor under its friction."""
        return motion_under(record, place, self.taken_shapes(place), float(self.accelerance[self.places.index(place)]))

    def _curve(self, place: str, values: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        of_place = np.array([shape.place == place for shape in self.shapes])
        rows = np.stack(values, axis=1) * of_place
        variance = np.einsum("ni,ij,nj->n", rows, self.covariance, rows)
        return rows @ self.coulomb_torque, np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class FrictionRow:
    """Coulomb friction F_c of a motor in Nm (N), link side, with std and 95 % interval; None without compensation.

    residual_power_ratio: of the unexplained torque, in realisations that the levels were not fitted to.
    """

    place: str
    unit: str
    residual_power_ratio: float
    coulomb_torque: float | None = None
    std: float | None = None
    interval: tuple[float, float] | None = None


# Std of the Coulomb torque by elements that do not slide, over stiffness times swing of their spring (GMS).
UNSEEN = 6.0


def friction_rows(friction: FrictionTakenOut, springs: Mapping[str, float] = {}) -> tuple[FrictionRow, ...]:
    """One row for each motor that was looked at, in their order.

    springs: stiffness of the presliding friction that a fit has found at motors.
    """
    rows, taken = [], friction.taken_places()
    for place, unit, kept in zip(
        friction.places, friction.place_units, friction.residual_power_ratio.tolist(), strict=True
    ):
        level, std = friction.sliding_level(place)
        if springs.get(place, 0.0) > 0 and friction.swings:
            std = math.hypot(std, UNSEEN * springs[place] * friction.swing(place))
        interval = (max(level - QUANTILE_95 * std, 0.0), level + QUANTILE_95 * std)
        rows.append(FrictionRow(place, unit, kept, *((level, std, interval) if place in taken else ())))
    return tuple(rows)
