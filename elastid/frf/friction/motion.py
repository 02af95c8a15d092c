"""The motion of a motor between its samples, from the DFT of its whole record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.record import MOTION_ORDER, Record

# Cells of the fine grid in a sample.
CELLS = 8
# A line counts as motion where its power is so many times that of the noise: lines between those of the period, where a
# transient is; and all others where the velocity has more noise than this part of its RMS. With less noise lines of the
# period are better kept, since friction moves the motor a little at all of them.
_MIN_SNR, _NOISY = 8.0, 0.01
# The noise is that of the highest part of all lines, where a robot hardly moves.
_NOISE_BAND = 1 / 8


@dataclass(frozen=True)
class Motion:
    """Angle and velocity (n CELLS + 1,) of a motor on the fine grid of a record of n samples; rad, rad/s (m, m/s).

    velocity_noise: standard deviation of the noise in the velocity.
    """

    angle: FloatArray
    velocity: FloatArray
    velocity_noise: float

    @property
    def swings(self) -> FloatArray:
        """Distances from one reversal to the next."""
        turning = np.flatnonzero(self.velocity[1:] * self.velocity[:-1] < 0)
        return np.abs(np.diff(self.angle[turning]))

    @property
    def speed(self) -> float:
        """RMS of the velocity."""
        return float(np.sqrt(np.mean(self.velocity**2)))


def motion_of(record: Record, place: str) -> Motion:
    """The motion of a motor over all whole periods of a record, which it need not repeat.

    Lines that do not repeat with the period hold noise, or a transient that is stronger; without the noise, periods are
    averaged as far as they agree.
    """
    column = record.outputs.index(place)
    n = record.n_samples // record.period_samples * record.period_samples
    y = record.y[:n, column]
    order = MOTION_ORDER[record.quantities[column]]
    gain = _gain(y, record.period_samples) if order == 0 else 0.0
    Y = rfft(y - y[0] - gain * np.arange(n) / n)
    power = np.abs(Y) ** 2
    band = power[int((1 - _NOISE_BAND) * len(power)) :]
    noise = float(np.median(band)) / np.log(2)
    s = np.asarray(2j * np.pi * record.rate_hz / n * np.arange(len(Y)), dtype=np.complex128)
    of_period = np.arange(len(Y)) % (n // record.period_samples) == 0
    Y[~of_period & (power < _MIN_SNR * noise)] = 0
    if _velocity_noise(Y, s, noise, n, order) > _NOISY * _rms(integrated(Y, s, order - 1), n):
        Y[of_period & (power < _MIN_SNR * noise)] = 0
    angle, velocity = (fine(integrated(Y, s, k), n) for k in (order, order - 1))
    angle = angle + (y[0] if order == 0 else 0.0) + gain * np.arange(n * CELLS + 1) / (n * CELLS)
    velocity = velocity + gain * record.rate_hz / n
    return Motion(angle, velocity, _velocity_noise(Y, s, noise, n, order))


def _gain(y: FloatArray, N: int) -> float:
    """How far the sample after the last is from the first: no part of what is periodic in the record.

    From the period before; of a single period by extrapolation, where that leaves it further than its curvature does.
    """
    if len(y) > N:
        return float(y[-N] + y[-1] - y[-N - 1] - y[0])
    gain = float(2 * y[-1] - y[-2] - y[0])
    return gain if abs(gain) > 2 * np.max(np.abs(np.diff(y, 2))) else 0.0


def _velocity_noise(Y: ComplexArray, s: ComplexArray, noise: float, n: int, order: int) -> float:
    """Standard deviation of the velocity's noise, of power `noise` at each line that is kept."""
    return float(np.sqrt(noise)) * _rms(integrated((Y != 0).astype(np.complex128), s, order - 1), n)


def _rms(X: ComplexArray, n: int) -> float:
    """RMS of a signal of n samples from its spectrum."""
    return float(np.sqrt(2 * np.sum(np.abs(X) ** 2)) / n)


def fine(X: ComplexArray, n: int) -> FloatArray:
    """The signal of a spectrum of n samples at the points of the fine grid, its first point once more at the end."""
    x = irfft(X, n * CELLS) * CELLS
    return np.append(x, x[0])


def integrated(Y: ComplexArray, s: ComplexArray, order: int) -> ComplexArray:
    """Y / s^order; a mean has no integral."""
    if order <= 0:
        return np.asarray(Y * s**-order)
    return np.concatenate([np.zeros(1, dtype=np.complex128), Y[1:] / s[1:] ** order])
