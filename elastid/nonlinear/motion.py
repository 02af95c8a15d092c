"""Motion of a motor between its samples: velocity and angle on a fine grid, from the DFT of its whole record."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import NEIGHBOURS, ComplexArray, FloatArray, frozen, mean_of_neighbours
from elastid.record import MOTION_ORDER, Record

# Cells of the fine grid in a sample, because friction reverses between samples.
CELLS = 4
# Largest noise over the rms of a velocity whose sign is reliable.
VELOCITY_NOISE = 0.04
# Least noise with which the lines of the period are filtered, too: friction moves the motor slightly at all of them.
_NOISY = VELOCITY_NOISE / 4
_MAX_COHERENCE = 1 - 1 / NEIGHBOURS  # largest coherence of a line by noise alone


@dataclass(frozen=True)
class Motion:
    """Velocity (n cells + 1,) of a motor on the fine grid of a record of n samples, rad/s (m/s), link side.

    start: first angle, rad (m).  velocity_noise: standard deviation of the noise in the velocity.
    """

    velocity: FloatArray
    start: float
    rate_hz: float
    velocity_noise: float

    @cached_property
    def angle(self) -> FloatArray:
        """Angle (n cells + 1,) on the fine grid, rad (m), integrated by Hermite's rule."""
        step, v = 1 / (self.rate_hz * CELLS), self.velocity
        steps = step / 2 * (v[:-1] + v[1:]) - step / 12 * np.diff(np.gradient(v))
        return np.concatenate([[self.start], self.start + np.cumsum(steps)])

    @property
    def swings(self) -> FloatArray:
        """Distances (n_reversals - 1,) from one reversal to the next, rad (m)."""
        return np.abs(np.diff(self.angle[np.flatnonzero(self.velocity[1:] * self.velocity[:-1] < 0)]))

    @property
    def speed(self) -> float:
        """Rms velocity."""
        return math.sqrt(np.mean(self.velocity**2))

    @cached_property
    def by_sample(self) -> FloatArray:
        """Velocity (cells + 1, n) in each sample, including its end."""
        return np.array([self.velocity[i : i - CELLS or None : CELLS] for i in range(CELLS + 1)])

    @cached_property
    def slowest(self) -> FloatArray:
        """Least speed (n,) in each sample; 0 in a sample with a reversal."""
        return np.asarray(np.maximum(np.maximum(self.by_sample.min(axis=0), -self.by_sample.max(axis=0)), 0.0))


def motion_of(record: Record, location: str, by_torque: Callable[[Motion], ComplexArray] | None = None) -> Motion:
    """Estimate the motion of a motor over all whole periods of a record; the motion need not be periodic.

    by_torque(motion): DFT (n // 2 + 1,) of the angle of an inertia under the known torque and the friction along
    `motion`.  It replaces the noise above the last significant line, in two iterations.
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
    """Return the signal fraction (n // 2 + 1,) of the DFT Y of a motion, and the std of the velocity noise.

    Lines between those of the period contain noise, or a stronger transient.  Wiener's filter keeps the fraction of
    their power that is not noise.  order: Y is the derivative of the angle of this order.
    """
    n = whole_samples(record)
    repeats, velocity_power = n // record.period_samples, _velocity_power(len(Y), n, record.rate_hz, order)
    power, noise = Y.real**2 + Y.imag**2, noise_power(Y)
    between = np.arange(len(Y)) % repeats != 0
    fraction = np.ones(len(Y))
    fraction[between] = _wiener_gain(power[between], noise)
    if noise * (fraction @ velocity_power) > _NOISY**2 * ((fraction**2 * power) @ velocity_power):
        fraction[::repeats] = _wiener_gain(power[::repeats], noise)
    # Wiener's filter multiplies the noise power of a line by the fraction.
    return fraction, math.sqrt(2 * noise * (fraction @ velocity_power)) / n


def noise_power(Y: ComplexArray) -> float:
    """Return the noise power of a line in the DFT Y of a motion, from the highest lines, where a robot barely moves."""
    return float(np.median(np.abs(Y[int((1 - 1 / 8) * len(Y)) :]) ** 2) / np.log(2))


def _wiener_gain(power: FloatArray, noise: float) -> FloatArray:
    """Return Wiener's gain 1 - noise / power (F,) with the mean power of neighbouring lines; 0 below one half."""
    smooth = mean_of_neighbours(power)
    # The smooth power of noise alone exceeds twice its mean at four lines in a thousand.
    return np.where(smooth > 2 * noise, 1 - noise / np.maximum(smooth, 1e-300), 0.0)


@lru_cache(maxsize=16)
def _velocity_power(lines: int, n: int, rate_hz: float, order: int) -> FloatArray:
    """Return the power of the velocity over the power of the motion (lines,), a derivative of this order."""
    return frozen(np.abs(integrate(np.ones(lines, np.complex128), laplace(lines, n, rate_hz), order - 1)) ** 2)


def whole_samples(record: Record) -> int:
    """Return the number of samples in whole periods of a record."""
    return record.n_samples // record.period_samples * record.period_samples


def motor_spectrum(record: Record, location: str) -> tuple[ComplexArray, float, float]:
    """Return the DFT (n // 2 + 1,) of a motor's logged motion over whole periods, its first angle and its net gain.

    First angle and the ramp of the gain are subtracted from an angle; both are 0 for other quantities.
    """
    y = record.y[: whole_samples(record), record.outputs.index(location)]
    if record.quantities[record.outputs.index(location)] != "position":
        return rfft(y), 0.0, 0.0
    gain = _gain(y, record.period_samples)
    return rfft(y - y[0] - gain * np.arange(len(y)) / len(y)), float(y[0]), gain


def _gain(y: FloatArray, N: int) -> float:
    """Return the sample after the last minus the first sample: the motion of a record that is not periodic.

    It follows from the previous period of N samples.  The gain of a single period is extrapolated, and 0 unless it
    exceeds the curvature.
    """
    if len(y) > N:
        return float(y[-N] + y[-1] - y[-N - 1] - y[0])
    gain = float(2 * y[-1] - y[-2] - y[0])
    return gain if abs(gain) > 2 * np.max(np.abs(np.diff(y, 2))) else 0.0


@lru_cache(maxsize=16)
def laplace(lines: int, n: int, rate_hz: float) -> ComplexArray:
    """Return s = j omega (lines,) at the lines 0, 1 ... of n samples."""
    return frozen(2j * np.pi * rate_hz / n * np.arange(lines), np.complex128)


def integrate(Y: ComplexArray, s: ComplexArray, order: int) -> ComplexArray:
    """Return Y / s^order (F,); its mean is 0 for a positive order."""
    if order <= 0:
        return Y if order == 0 else Y * s**-order
    return np.concatenate([np.zeros(1, np.complex128), Y[1:] / s[1:] ** order])
