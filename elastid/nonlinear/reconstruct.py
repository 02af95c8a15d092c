r"""The motion of a motor with its part at high frequencies, which turns it back earlier than its samples say.

At a reversal friction jumps by 2 F_c, and at each sample the held torque jumps. The velocity has a kink there, which
interpolation of the samples rounds: reversals come out late, by some 2 % of a sample. Above half the rate a motor moves
as an inertia, by the torque that is known,

.. math:: q_{high} = \frac{a}{s^2} (H u - \sum_i f_i \phi_i)_{high}, \qquad a = -\omega^2 G \text{ at high frequencies}

So it does above the excited lines, with the poles or the spring next to them (`accelerance`). Noise of the angle is a
velocity that grows with frequency, and hides there where a motor turns back, while the torque is known as well as
anywhere; so the motion above the excited lines is by the torque, too, and what the angle says beyond it is added as far
as it is more than noise. (3e-6 rad at 500 Hz with Coulomb friction of 0.3 of the rms torque: k known four times as
well.)

Its samples are images in the record's y; they are taken out, and the part itself is added between the samples. So

.. math:: v = a \int \tau\, dt + w, \qquad \tau = H u - \sum_i f_i \phi_i

where the integral has all kinks, which are exact at the ends of cells of a sample, and w is smooth: 4 points of a
sample give it. Only samples in which the motor may turn back are followed in cells; elsewhere friction is steady.

phi_i depend on the motion; so v is a fixed point, which repetition alone reaches slowly, and not at all where friction
is 0.3 of the torque. An error of a leaves as large a part of what is mended.

The fixed point is found by Anderson's method: the next x is that combination of the last ones whose residuals F(x) - x
nearly cancel,

.. math:: x_{k+1} = F(x_k) - \sum_i \gamma_i\, [F(x_{i+1}) - F(x_i)], \qquad
          \gamma = \arg\min \Big| r_k - \sum_i \gamma_i (r_{i+1} - r_i) \Big|, \quad r = F(x) - x

(Anderson, J. ACM 12, 1965; Walker and Ni, SIAM J. Numer. Anal. 49, 2011.)

A net torque is u without the friction that was found. The torque of a record is held between its samples, friction is
not; so friction is divided by the hold as samples:

.. math:: u_{net} = u - u_\phi, \qquad u_\phi = IDFT\{ H^{-1}\, DFT\{ \textstyle\sum_i f_i \phi_i \} \}

Sampled angles contain images of a held torque, and friction's are others than those of u_phi, which a model of held
torques adds. Above half the rate a motor moves as an inertia, so that its samples become those of the net torque by

.. math:: y_{net} = y + \Big[\frac{a}{s^2} \big(\textstyle\sum_i f_i \phi_i - H u_\phi\big)_{high}\Big]_{folded}
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.fft import irfft
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial.legendre import legvander

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.excitation.grids import line_frequencies
from elastid.nonlinear.moments import Moments
from elastid.nonlinear.motion import (
    Motion,
    filtered,
    laplace,
    motion_of,
    noise_power,
    own_spectrum,
    slowest,
    whole_samples,
)
from elastid.nonlinear.result import FrictionTakenOut
from elastid.nonlinear.shapes import Shape, friction_means, friction_moments, reach, sliding_means, steady
from elastid.record import Record

# Cells in a sample: friction's spectrum is then off by 2e-5 on six axes; with 8 by 1e-4 to 2e-4.
SHARP_CELLS = 16
# Points of a sample at which the velocity's smooth part is known, and points before and after that of its start which a
# polynomial joins.
_POINTS, _BEFORE, _AFTER = 4, 4, 8
# A velocity at the start of a sample and one that grows over it, at the ends of cells.
_LINE = np.stack([np.ones(SHARP_CELLS + 1), np.linspace(0, 1, SHARP_CELLS + 1)])
# By which values in the cells become their sums up to the end of each; NumPy is slow along short rows.
_SUMS = np.triu(np.ones((SHARP_CELLS, SHARP_CELLS)))
# Part of the first error of the velocity at which one step more is the last, which leaves 1e-3 of it; steps at most.
_TOLERANCE, _STEPS = 0.03, 12


def sharp_motion(record: Record, place: str, friction: FrictionTakenOut) -> Motion:
    """The motion of a motor under the friction that was found; as `motion_of` where its samples show no images."""
    if not shows_images(record, place) or friction.accelerance[friction.places.index(place)] == 0:
        return motion_of(record, place)
    motor = _HeldMotor.of(record, place, friction)
    motion = motor.motion()
    if motor.is_complete(motion):
        return motion
    return replace(motor, slow=np.arange(len(motor.u))).motion()


@dataclass(frozen=True, eq=False)
class _HeldMotor:
    """A motor in a record of n samples, moved by a held torque u (n,), and its friction; times are in samples.

    Y, start, gain: of its angle (`own_spectrum`).  a, further (3 n // 2 + 1,): angle per torque a / s^2 (1 + further)
    from the line `first` on.  held, held_images (n // 2 + 1,): the held torque, and images of its second integral.
    by_samples (4 n,): the velocity that the samples alone show.  slow (m,): samples in which the motor may turn back.
    """

    record: Record
    taken: Sequence[tuple[Shape, float]]
    u: FloatArray
    Y: ComplexArray
    start: float
    gain: float
    a: float
    further: ComplexArray
    first: int
    held: Moments
    held_images: ComplexArray
    by_samples: FloatArray
    slow: IntArray

    @classmethod
    def of(cls, record: Record, place: str, friction: FrictionTakenOut) -> _HeldMotor:
        """A motor whose acceleration per torque is known."""
        m, n, rate_hz = friction.places.index(place), whole_samples(record), record.rate_hz
        taken, from_hz = friction.taken_shapes(place), friction.first_hz(record.configuration.name, place)
        Y, start, gain = own_spectrum(record, place)
        v = _points(filtered(record, Y, 0)[0] * laplace(len(Y), n, rate_hz), n) + gain * rate_hz / n
        a, u = float(friction.accelerance[m]) / rate_hz**2, record.u[:n, record.inputs.index(place)]
        slow = np.arange(n)
        if all(shape.is_memoryless for shape, _ in taken):
            # An eighth of the change by friction and by a step of the torque over one sample.
            margin = a * rate_hz * (sum(level for _, level in taken) + np.abs(np.diff(u)).max()) / 8
            of_samples = sliding_window_view(np.append(v, v[0]), _POINTS + 1)[::_POINTS]
            slow = np.flatnonzero(slowest(of_samples) <= reach(taken) + margin)
        first = math.ceil(from_hz * n / rate_hz) if from_hz > 0 else n // 2 + 1
        further = friction.beyond_inertia(record.configuration.name, place, laplace(3 * n // 2 + 1, n, rate_hz))
        held = Moments.held(u)
        return cls(record, taken, u, Y, start, gain, a, further, first, held, held.second_images(), v, slow)

    def motion(self) -> Motion:
        """Its motion under its friction, which is that along the motion."""
        velocity = fixed_point(self._repeated, self._at_first, _TOLERANCE, _STEPS)
        means, moments = self._friction(velocity)
        smooth, noise = self._smooth(moments)
        every = self._velocity(smooth, moments, np.arange(len(self.u)))
        every[self.slow, 1:] += self._by_friction(means)
        points = np.append(every[:, :-1], every[-1, -1])
        return Motion(points, self.start, self.record.rate_hz, noise, SHARP_CELLS)

    def is_complete(self, motion: Motion) -> bool:
        """True if a motion is slow in no sample but those that it was followed in."""
        fast = np.ones(len(self.u), bool)
        fast[self.slow] = False
        return not fast.any() or float(motion.slowest[fast].min()) > reach(self.taken)

    @cached_property
    def _steady(self) -> FloatArray:
        """Friction (n,) in the samples in which the motor is fast."""
        return steady(self.by_samples[::_POINTS], self.taken)

    @cached_property
    def _noise_power(self) -> float:
        """Power of the noise of a line of Y."""
        return noise_power(self.Y)

    @cached_property
    def _at_first(self) -> FloatArray:
        """Velocity (m, cells + 1) in the slow samples as the samples alone show it."""
        return _between(self.by_samples, self.slow)

    @cached_property
    def _friction_at_first(self) -> tuple[FloatArray, Moments]:
        """Friction along it."""
        return self._friction(self._at_first)

    @cached_property
    def _further_above(self) -> ComplexArray:
        """Angle (n + 1,) by `further` from line n / 2 to 3 n / 2: so small that friction as at first will do."""
        n, half = len(self.u), len(self.Y)
        lines = 3 * n // 2 + 1
        torque = self.held.spectrum(lines) - self._friction_at_first[1].spectrum(lines)
        return np.asarray(self.a * (self.further * torque)[half:] / laplace(lines, n, 1.0)[half:] ** 2)

    @cached_property
    def _further_images(self) -> ComplexArray:
        """Its images (n // 2 + 1,) in the samples."""
        n, half = len(self.u), len(self.Y)
        lines = np.concatenate([np.zeros(half), self._further_above])
        return np.asarray(lines[n - half + 1 : n + 1][::-1].conj() + lines[n : n + half])

    def _repeated(self, velocity: FloatArray) -> FloatArray:
        """Velocity (m, cells + 1) in the slow samples under the friction along one."""
        means, moments = self._friction_at_first if velocity is self._at_first else self._friction(velocity)
        v = self._velocity(self._smooth(moments)[0], moments, self.slow)
        v[:, 1:] += self._by_friction(means)
        return v

    def _friction(self, velocity: FloatArray) -> tuple[FloatArray, Moments]:
        """Means (m, cells) of friction in cells of the slow samples along a velocity there, and moments of all."""
        if all(shape.is_memoryless for shape, _ in self.taken):
            means = sliding_means(velocity, self.taken)
        else:
            points = np.append(velocity[:, :-1], velocity[-1, -1])
            motion = Motion(points, self.start, self.record.rate_hz, 0.0, SHARP_CELLS)
            means = friction_means(self.record, motion, self.taken)
        return means, Moments.of_steady(self._steady, self.slow, means)

    def _smooth(self, friction: Moments) -> tuple[FloatArray, float]:
        """The velocity (4 n,) without that of an inertia by the torque, and the deviation of its noise."""
        n, first, a = len(self.u), self.first, self.a
        s = laplace(len(self.Y), n, 1.0)[1:]
        inertia = a / s**2 * (self.held.of_cells - friction.spectrum(len(self.Y)))[1:]
        further = self.further[first : len(self.Y)] * inertia[first - 1 :]
        # Samples of the part above: all of the inertia's without the part below, and what is further, with its images.
        above = a * (self.held_images - friction.second_images()) + self._further_images
        above[first:] += inertia[first - 1 :] + further
        rest, noise = filtered(self.record, self.Y - above, 0, self._noise_power)
        rest[1:first] -= inertia[: first - 1]
        rest[first:] += further
        rest = np.concatenate([rest, self._further_above])
        rest *= laplace(len(rest), n, self.record.rate_hz)
        rest[0] = self.gain * self.record.rate_hz
        return _points(rest, n), noise

    def _velocity(self, smooth: FloatArray, friction: Moments, samples: IntArray) -> FloatArray:
        """Velocity (m, cells + 1) in some samples, in which friction is steady, from its smooth part."""
        mu, size = friction.mu, self.a * self.record.rate_hz
        torque = self.u - mu[0]
        mean = float(np.mean(torque))
        at_start = np.append(0.0, np.cumsum(torque[:-1] - mean))
        at_start -= np.mean(at_start + (torque - mean + mu[1]) / 2)  # an integral without a mean
        slope = self.u - self._steady - mean
        lines = np.stack([size * at_start[samples], size * slope[samples]], axis=1)
        return _between(smooth, samples) + lines @ _LINE

    def _by_friction(self, means: FloatArray) -> FloatArray:
        """Velocity (m, cells) at the ends of the cells of slow samples, by friction that is not steady."""
        size = self.a * self.record.rate_hz / SHARP_CELLS
        return np.asarray((self._steady[self.slow, None] - means) @ (size * _SUMS))


def _points(X: ComplexArray, n: int) -> FloatArray:
    """The signal (4 n,) of a DFT, as of n samples."""
    return irfft(X, _POINTS * n) * _POINTS


@cache
def _polynomials() -> FloatArray:
    """From the points about a sample to its cells (13, cells + 1), by a polynomial through all."""
    nodes = np.arange(-_BEFORE, _AFTER + 1) - (_AFTER - _BEFORE) / 2
    cells = np.linspace(0, _POINTS, SHARP_CELLS + 1) - (_AFTER - _BEFORE) / 2
    size, degree = float(nodes[-1]), len(nodes) - 1
    return np.asarray(np.linalg.solve(legvander(nodes / size, degree).T, legvander(cells / size, degree).T))


def _between(points: FloatArray, samples: IntArray) -> FloatArray:
    """The signal (m, cells + 1) in some samples from its points (4 n,)."""
    around = np.concatenate([points[-_BEFORE:], points, points[: _AFTER + 1 - _POINTS]])
    return np.asarray(sliding_window_view(around, _BEFORE + _AFTER + 1)[::_POINTS][samples] @ _polynomials())


def shows_images(record: Record, place: str) -> bool:
    """True if the samples of a motor's motion contain the images of its own held torque."""
    images = record.images
    if images is None:
        return False
    return images.rates_hz[record.inputs.index(place)] > 0 and images.sampled[record.outputs.index(place)]


def fixed_point(F: Callable[[FloatArray], FloatArray], x: FloatArray, tolerance: float, limit: int) -> FloatArray:
    """x one step beyond that whose |F(x) - x| is below `tolerance` of the first one, or after `limit` steps."""
    mapped = F(x)
    residual = mapped - x
    first = float(np.linalg.norm(residual))
    of_mapped, of_residual = list[FloatArray](), list[FloatArray]()
    for _ in range(limit - 1):
        if np.linalg.norm(residual) <= tolerance * first:
            break
        before, last = mapped, residual
        x = _combined(mapped, residual, of_mapped, of_residual)
        mapped = F(x)
        residual = mapped - x
        # The last five differences are combined.
        of_mapped, of_residual = [*of_mapped[-4:], mapped - before], [*of_residual[-4:], residual - last]
    return _combined(mapped, residual, of_mapped, of_residual)


def _combined(
    mapped: FloatArray, residual: FloatArray, of_mapped: list[FloatArray], of_residual: list[FloatArray]
) -> FloatArray:
    """The next x from the last F(x) and its residual, and the steps of both before, oldest first."""
    if not of_residual:
        return mapped
    A = np.array([[np.vdot(a, b) for b in of_residual] for a in of_residual])
    pull = np.array([np.vdot(a, residual) for a in of_residual])
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    gamma = np.linalg.lstsq(A / np.outer(size, size), pull / size, rcond=1e-12)[0] / size
    for g, step in zip(gamma, of_mapped, strict=True):
        mapped = mapped - g * step
    return mapped


def over_whole_periods(record: Record) -> Record:
    """The record without the samples after its last whole period."""
    n = whole_samples(record)
    return replace(record, u=record.u[:n], y=record.y[:n], r=None if record.r is None else record.r[:n])


def net_samples(
    record: Record, place: str, motion: Motion, friction: FrictionTakenOut, hold: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """A motor's friction as a torque that is held as u is, and what makes its samples' images those of the net torque.

    Each (n,), along the sharp motion; the second is 0 where a motor shows no images.  hold (n // 2 + 1, n_u): that of
    the record (`hold_of`).
    """
    n, torque = whole_samples(record), friction_moments(record, motion, friction.taken_shapes(place))
    low, H = torque.spectrum(n // 2 + 1), hold[:, record.inputs.index(place)]
    # Near a zero of the hold the torque's samples do not determine the torque.
    held = irfft(np.divide(low, H, out=np.zeros_like(low), where=np.abs(H) > 0.1), n)
    accelerance = friction.accelerance[friction.places.index(place)]
    if accelerance == 0 or not shows_images(record, place):
        return held, np.zeros(n)
    above = torque.second_images() - Moments.held(held).second_images()
    return held, irfft(accelerance / record.rate_hz**2 * above, n)


def hold_of(record: Record) -> ComplexArray:
    """H (n // 2 + 1, n_u) of the torques at the lines of all whole periods."""
    n = whole_samples(record)
    return record.hold_response(line_frequencies(np.arange(n // 2 + 1), record.rate_hz, n))
