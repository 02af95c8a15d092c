"""Motion of a motor between its samples, from the DFT of its whole record."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import NEIGHBOURS, ComplexArray, FloatArray, frozen, mean_of_neighbours
from elastid.record import MOTION_ORDER, Record

# Cells of the fine grid in a sample, since reversals of friction fall between samples.
CELLS = 4
# Noise over the RMS of a velocity, above which its sign is noise.
VELOCITY_NOISE = 0.04
# Above which lines of the period are filtered as others are: below, friction moves the motor a little at all of them.
_NOISY = VELOCITY_NOISE / 4
_MAX_COHERENCE = 1 - 1 / NEIGHBOURS  # largest coherence of a line by noise alone


@dataclass(frozen=True)
class Motion:
    """Velocity (n cells + 1,) of a motor on the fine grid of a record of n samples, rad/s (m/s).

    start: of the angle.  velocity_noise: standard deviation of the noise in the velocity.
    """

    velocity: FloatArray
    start: float
    rate_hz: float
    velocity_noise: float

    @cached_property
    def angle(self) -> FloatArray:
        """Angle (n cells + 1,) on the fine grid, rad (m): its steps by Hermite's rule."""
        step, v = 1 / (self.rate_hz * CELLS), self.velocity
        steps = step / 2 * (v[:-1] + v[1:]) - step / 12 * np.diff(np.gradient(v))
        return np.concatenate([[self.start], self.start + np.cumsum(steps)])

    @property
    def swings(self) -> FloatArray:
        """Distances from one reversal to the next."""
        return np.abs(np.diff(self.angle[np.flatnonzero(self.velocity[1:] * self.velocity[:-1] < 0)]))

    @property
    def speed(self) -> float:
        """RMS of the velocity."""
        return math.sqrt(np.mean(self.velocity**2))

    @cached_property
    def by_sample(self) -> FloatArray:
        """Velocity (cells + 1, n) in each sample, its end included."""
        return np.array([self.velocity[i : i - CELLS or None : CELLS] for i in range(CELLS + 1)])

    @cached_property
    def slowest(self) -> FloatArray:
        """Least speed (n,) in each sample, 0 where it turns back."""
        return np.asarray(np.maximum(np.maximum(self.by_sample.min(axis=0), -self.by_sample.max(axis=0)), 0.0))


def motion_of(record: Record, location: str, by_torque: Callable[[Motion], ComplexArray] | None = None) -> Motion:
    """Return the motion of a motor over all whole periods of a record, which it need not repeat, by its samples.

    by_torque(motion): DFT (n // 2 + 1,) of its angle by what is known of its torque as an inertia, in place of what is
    noise above the last line that is known; along the motion of the round before, in two rounds.
    """
    n, order = whole_samples(record), MOTION_ORDER[record.quantities[record.outputs.index(location)]]
    Y, start, gain = motor_spectrum(record, location)
    fraction, noise = signal_fraction(record, Y, order)
    s = laplace(len(Y), n, record.rate_hz)
    velocity = integrate(fraction * Y, s, order - 1)
    if order != 1:
        velocity[0] = gain * record.rate_hz  # a mean velocity is the gain of the angle
    motion = Motion(_fine(velocity, n), start, record.rate_hz, noise)
    if by_torque is not None:
        above = np.arange(len(Y)) > np.flatnonzero(fraction > _MAX_COHERENCE).max(initial=0)
        for _ in range(2):
            motion = replace(motion, velocity=_fine(velocity + above * (1 - fraction) * s * by_torque(motion), n))
    return motion


def _fine(velocity: ComplexArray, n: int) -> FloatArray:
    """Return velocity (n cells + 1,) from its DFT; the last value repeats the first."""
    x = irfft(velocity, n * CELLS) * CELLS
    return np.append(x, x[0])


def signal_fraction(record: Record, Y: ComplexArray, order: int) -> tuple[FloatArray, float]:
    """Return the signal fraction of the DFT Y (n // 2 + 1,) of a motion, and the std of the velocity noise.

    Lines that do not repeat with the period hold noise, or a transient that is stronger: Wiener's filter keeps of each
    line the share of its power that is not noise.  order: of the derivative of the angle that Y is.
    """
    n = whole_samples(record)
    repeats, velocity_power = n // record.period_samples, _velocity_power(len(Y), n, record.rate_hz, order)
    power, noise = Y.real**2 + Y.imag**2, noise_power(Y)
    between = np.arange(len(Y)) % repeats != 0
    fraction = np.ones(len(Y))
    fraction[between] = _wiener_gain(power[between], noise)
    if noise * (fraction @ velocity_power) > _NOISY**2 * ((fraction**2 * power) @ velocity_power):
        fraction[::repeats] = _wiener_gain(power[::repeats], noise)
    # That of a line after Wiener's filter is noise times gain.
    return fraction, math.sqrt(2 * noise * (fraction @ velocity_power)) / n


def noise_power(Y: ComplexArray) -> float:
    """Return the noise power of a line in the DFT of a motion, from the highest lines, where the robot barely moves."""
    return float(np.median(np.abs(Y[int((1 - 1 / 8) * len(Y)) :]) ** 2) / np.log(2))


def _wiener_gain(power: FloatArray, noise: float) -> FloatArray:
    """Return Wiener's gain (F,) of lines of a power (F,), mean of neighbours: 1 - noise / power, 0 below one half."""
    near = mean_of_neighbours(power)
    # Noise alone has a mean of twice its power at four lines in a thousand.
    return np.where(near > 2 * noise, 1 - noise / np.maximum(near, 1e-300), 0.0)


@lru_cache(maxsize=16)
def _velocity_power(lines: int, n: int, rate_hz: float, order: int) -> FloatArray:
    """Return power of a velocity over the power of each line of a motion (lines,), a derivative of that order."""
    return frozen(np.abs(integrate(np.ones(lines, np.complex128), laplace(lines, n, rate_hz), order - 1)) ** 2)


def whole_samples(record: Record) -> int:
    """Return the samples of the whole periods of a record."""
    return record.n_samples // record.period_samples * record.period_samples


def motor_spectrum(record: Record, location: str) -> tuple[ComplexArray, float, float]:
    """Return the DFT (n // 2 + 1,) of a motor's logged motion over whole periods, the start of its angle, and its gain.

    An angle is taken from its start on, without the ramp of its gain; both are 0 of other quantities.
    """
    y = record.y[: whole_samples(record), record.outputs.index(location)]
    if record.quantities[record.outputs.index(location)] != "position":
        return rfft(y), 0.0, 0.0
    gain = _gain(y, record.period_samples)
    return rfft(y - y[0] - gain * np.arange(len(y)) / len(y)), float(y[0]), gain


def _gain(y: FloatArray, N: int) -> float:
    """Return offset between the sample after the last and the first, which the periodic part of the record lacks.

    From the period before; of a single period by extrapolation, where that leaves it further than its curvature does.
    """
    if len(y) > N:
        return float(y[-N] + y[-1] - y[-N - 1] - y[0])
    gain = float(2 * y[-1] - y[-2] - y[0])
    return gain if abs(gain) > 2 * np.max(np.abs(np.diff(y, 2))) else 0.0


@lru_cache(maxsize=16)
def laplace(lines: int, n: int, rate_hz: float) -> ComplexArray:
    """Return s = j omega (lines,) of the lines of n samples, from 0 on."""
    return frozen(2j * np.pi * rate_hz / n * np.arange(lines), np.complex128)


def integrate(Y: ComplexArray, s: ComplexArray, order: int) -> ComplexArray:
    """Return Y / s^order; a mean has no integral."""
    if order <= 0:
        return Y if order == 0 else Y * s**-order
    return np.concatenate([np.zeros(1, dtype=np.complex128), Y[1:] / s[1:] ** order])
