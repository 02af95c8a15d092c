r"""Basis functions phi of a motor's friction, and their torque along its motion between the samples.

.. math:: sign: \phi = \tanh(v / D), \qquad stop,\ bristle: \phi = s / D

.. math:: stribeck: \phi = \operatorname{sgn}(v)\, e^{-(v / D)^2}, \qquad damping: \phi = T \dot s / D

The torque on the motor is -f phi, and phi is 1 in steady sliding. A sign of threshold 0 is Coulomb friction; a small
threshold D smooths it, as oil or velocity noise do. The coefficient of a Stribeck curve is F_s - F_c, which acts in
slow motion only. Damping acts on the rate of a stop or a bristle, like LuGre's sigma_1 = f T / D; T is a sample.

The motion follows from a motor's angle and torque. Above the excited lines a motor moves as an inertia,

.. math:: q_a = \frac{a}{s^2} \Big(H u - \sum_i f_i \phi_i\Big), \qquad a = -\omega^2 G \text{ at high frequencies}

with phi_i along the previous estimate of the motion. Velocity noise from the angle grows with frequency and hides
reversals. A fraction 1 - w of the power of a line is noise (`motion.signal_fraction`); there the motion follows the
torque, q = w y + (1 - w) q_a. (With 3e-6 rad of noise at 500 Hz and Coulomb friction of 0.3 of the rms torque, the std
of k falls to a third.) Reversals between the samples are late by about 2 % of a sample; the errors of the responses
include this delay.

A zero-order hold acts on the logged torque but not on friction, so samples of friction are divided by the hold's FRF.
If the torque is logged a time tau after the motion, its friction has the same delay:

.. math:: u_{net} = u - u_\phi, \qquad u_\phi = IDFT\{ H^{-1} e^{-s \tau}\, DFT\{ \textstyle\sum_i f_i \phi_i \} \}
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Literal, TypeAlias

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen, labelled
from elastid.friction.stop_operator import Path, bristle, stop
from elastid.nonlinear.motion import CELLS, Motion, laplace, motion_of, whole_samples
from elastid.record import Record, zero_order_hold

Kind: TypeAlias = Literal["sign", "stribeck", "stop", "bristle", "stop damping", "bristle damping"]


@dataclass(frozen=True)
class BasisFunction:
    """Basis function of the friction at a motor (place), link side.

    threshold D: rad/s (m/s) of a sign or Stribeck curve, else rad (m).  delay_s: of the logged torque behind the
    motion, equal for all basis functions.
    """

    place: str
    kind: Kind
    threshold: float = labelled("distance over which a bristle bends, link side", "rad", default=0.0)
    delay_s: float = labelled("by which the torque is logged later than the motion", "s", default=0.0)

    @property
    def when_fast(self) -> float:
        """Value in fast steady sliding: 1 if the coefficient contributes to F_c, else 0."""
        return float(self.kind != "stribeck" and not self.is_damping)

    @property
    def is_damping(self) -> bool:
        """True for the rate of a stop or a bristle."""
        return self.kind in ("stop damping", "bristle damping")

    @property
    def is_memoryless(self) -> bool:
        """True for a function of the velocity alone."""
        return self.kind in ("sign", "stribeck")

    @property
    def element(self) -> tuple[str, float]:
        """Kind and threshold of the stop or bristle whose state it depends on."""
        return self.kind.removesuffix(" damping"), self.threshold

    def reversal(self, distance: FloatArray) -> FloatArray:
        """Return phi (n,), from -1 to 1, at `distance` (n,) after a reversal out of fast steady sliding."""
        if not self.when_fast:
            return np.zeros(len(distance))
        if self.kind == "sign":
            return np.where(distance > 0, 1.0, -1.0)
        x = distance / self.threshold
        return np.minimum(x - 1, 1.0) if self.kind == "stop" else 1 - 2 * np.exp(-x)

    def sliding(self, velocity: FloatArray) -> FloatArray:
        """Return phi (n,) in steady sliding at `velocity` (n,)."""
        if self.kind == "stribeck":
            return np.sign(velocity) * np.exp(-((velocity / self.threshold) ** 2))
        if self.is_damping:
            return np.zeros(len(velocity))
        return np.tanh(velocity / self.threshold) if self.kind == "sign" and self.threshold > 0 else np.sign(velocity)

    def integral(self, speed: FloatArray) -> FloatArray:
        """Return the integral (n,) over velocity of a sign or Stribeck curve in steady sliding, up to speeds (n,)."""
        if self.kind == "stribeck":
            from scipy.special import erf

            return np.asarray(self.threshold * np.sqrt(np.pi) / 2 * erf(speed / self.threshold))
        return speed + (self.threshold * np.log1p(np.exp(speed * (-2 / self.threshold))) if self.threshold > 0 else 0.0)


WeightedBasis: TypeAlias = Sequence[tuple[BasisFunction, float]]
States: TypeAlias = Callable[[str, float], FloatArray]


def amplitudes(
    record: Record, motion: Motion, shapes: Sequence[BasisFunction], repetitions: IntArray, lines: IntArray
) -> ComplexArray:
    """Return amplitudes (n_f, F) of a motor's basis functions at lines (F,), averaged over `repetitions` (n,)."""
    N, states = record.period_samples, elements(record, motion)
    weights = np.zeros(whole_samples(record) // record.repeat_samples)
    weights[repetitions] = np.where(record.half_wave & (repetitions % 2 == 1), -1.0, 1.0) / len(repetitions)
    means = np.empty((len(shapes), record.repeat_samples * CELLS))
    for i in sorted(range(len(shapes)), key=lambda i: shapes[i].element):
        means[i] = weights @ friction_means(record, motion, [(shapes[i], 1.0)], states).reshape(len(weights), -1)
    dft = rfft(np.concatenate([means, -means], axis=1) if record.half_wave else means)[:, lines]
    delay = np.exp(-2j * np.pi * record.rate_hz / N * np.outer([shape.delay_s for shape in shapes], lines))
    return dft * _between_cells(N, int(lines[-1]) + 1)[lines] * (2 / N) * delay


@lru_cache(maxsize=16)
def _between_cells(n: int, lines: int) -> ComplexArray:
    r"""Return factors (lines,) from the DFT of means in cells of n samples to the transform of their torque.

    .. math:: \frac{1}{N_c}\, \frac{e^{-j \omega T_c / 2}}{\mathrm{sinc}(\omega T_c / 2)}
    """
    cell = np.arange(lines) / (n * CELLS)
    return frozen(np.exp(-1j * np.pi * cell) / (CELLS * np.sinc(cell)), np.complex128)


def friction_means(record: Record, motion: Motion, basis: WeightedBasis, states: States | None = None) -> FloatArray:
    """Return the mean friction torque (n cells,) of a motor in each cell of whole periods of n samples.

    states: `elements` of the motion; computed by default.
    """
    memoryless = [(shape, f) for shape, f in basis if shape.is_memoryless]
    means = np.zeros(len(motion.velocity) - 1)
    if memoryless:
        cells, F_c = means.reshape(-1, CELLS), sum(f for shape, f in memoryless if shape.kind == "sign")
        cells[:] = np.copysign(F_c, motion.by_sample[0])[:, None]
        # Above five thresholds the memoryless functions are 1 or 0 within 1e-4.
        slow = np.flatnonzero(motion.slowest <= 5 * max(shape.threshold for shape, _ in memoryless))
        cells[slow] = sliding_means(motion.by_sample.take(slow, axis=1).T, memoryless)
    states = states or elements(record, motion)
    for shape, f in basis:
        if not shape.is_memoryless:
            s, scale = states(*shape.element), f / shape.threshold / 2
            means += 2 * CELLS * scale * np.diff(s) if shape.is_damping else scale * (s[:-1] + s[1:])
    return means


def spectrum(means: ComplexArray, n: int) -> ComplexArray:
    """Return the transform (n // 2 + 1,) of a torque at the lines of n samples from the DFT of its cell means."""
    return means[: n // 2 + 1] * _between_cells(n, n // 2 + 1)


def sliding_means(velocity: FloatArray, basis: WeightedBasis) -> FloatArray:
    r"""Return means (m, cells) of memoryless friction g in cells of m samples; v (m, cells + 1) is linear in a cell.

    .. math:: \bar g = \Delta I / \Delta v, \qquad I(v) = \int_0^v g
    """
    velocity = np.ascontiguousarray(velocity.T)
    step, start = np.diff(velocity, axis=0), velocity[:-1]
    constant = np.abs(step) <= 2e-6 * np.abs(start)
    step[constant] = 1.0
    means = np.zeros(step.shape)
    for shape, f in basis:
        means += f * np.diff(shape.integral(np.abs(velocity)), axis=0) / step
    means[constant] = sum(f * shape.sliding(start[constant]) for shape, f in basis)
    return means.T


def elements(record: Record, motion: Motion) -> States:
    """Return a function that computes the states s(kind, D) of stops and bristles along a motion, the last one cached.

    The motion starts with one more period, because the state at the start is unknown.
    """

    @cache
    def path() -> Path:
        period = motion.angle[: record.period_samples * CELLS]
        return Path.of(np.concatenate([period - period[-1] + motion.angle[0], motion.angle])).without(len(period))

    return lru_cache(maxsize=1)(lambda kind, D: (stop if kind == "stop" else bristle)(path(), D))


def motion_with_friction(record: Record, place: str, basis: WeightedBasis, a: float) -> Motion:
    """Return the motion of a motor with the friction of `basis`; a: acceleration per torque, 0 if unknown."""
    if a == 0:
        return motion_of(record, place)
    n, channel = whole_samples(record), record.inputs.index(place)
    s = laplace(n // 2 + 1, n, record.rate_hz)
    by_inertia = np.divide(a, s**2, out=np.zeros_like(s), where=s != 0)
    torque = _hold(record, channel, basis) * rfft(record.u[:n, channel])
    return motion_of(
        record, place, lambda motion: by_inertia * (torque - spectrum(rfft(friction_means(record, motion, basis)), n))
    )


def zoh_samples(record: Record, location: str, motion: Motion, basis: WeightedBasis) -> FloatArray:
    """Return a motor's friction (n,) along a motion as samples of a torque with the same zero-order hold as u."""
    n, H = whole_samples(record), _hold(record, record.inputs.index(location), basis)
    low = spectrum(rfft(friction_means(record, motion, basis)), n)
    # Near a zero of the hold's FRF the samples do not determine the torque.
    return irfft(np.divide(low, H, out=np.zeros_like(low), where=np.abs(H) > 0.1), n)


def _hold(record: Record, channel: int, basis: WeightedBasis) -> ComplexArray:
    """Return the FRF H e^(s delay) (n // 2 + 1,) of an input's hold, at the lines of all whole periods."""
    delay_s = basis[0][0].delay_s if basis else 0.0
    return _delayed_hold(whole_samples(record), record.rate_hz, record.hold_lengths[channel], delay_s)


@lru_cache(maxsize=16)
def _delayed_hold(n: int, rate_hz: float, hold_samples: float, delay_s: float) -> ComplexArray:
    s = laplace(n // 2 + 1, n, rate_hz)
    return frozen(zero_order_hold(s.imag * (hold_samples / (2 * np.pi * rate_hz))) * np.exp(delay_s * s), np.complex128)
