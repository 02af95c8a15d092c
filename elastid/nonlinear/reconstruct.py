r"""The motion of a motor by its angle and its torque, also between the samples, and the net torque as held samples.

Above the excited lines a motor moves as an inertia, by the torque that is known in each cell of a sample,

.. math:: q_a = \frac{a}{s^2} \Big(H u - \sum_i f_i \phi_i\Big), \qquad a = -\omega^2 G \text{ at high frequencies}

with phi_i along the motion of the round before. At a reversal friction jumps by 2 F_c, and at each sample the held
torque jumps: the velocity has a kink there, which interpolation of the samples rounds, so that reversals come out late
by some 2 % of a sample. So q_a is the motion above half the rate; its samples are images in the record's y, which are
taken out first. Noise of the angle is a velocity that grows with frequency and hides where a motor turns back; what of
a line of the angle is noise, 1 - w of its power (`motion.filtered`), is taken from the torque there,

.. math:: q = w\, (y - [q_a]_{folded}) + (1 - w)\, q_a

(3e-6 rad at 500 Hz with Coulomb friction of 0.3 of the rms torque: k known three times as well.)

The torque of a record is held between its samples, friction is not; so friction is divided by the hold as samples:

.. math:: u_{net} = u - u_\phi, \qquad u_\phi = IDFT\{ H^{-1}\, DFT\{ \textstyle\sum_i f_i \phi_i \} \}
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray, frozen
from elastid.excitation.grids import line_frequencies
from elastid.nonlinear.motion import (
    CELLS,
    Motion,
    filtered,
    laplace,
    motion_of,
    noise_power,
    own_spectrum,
    whole_samples,
)
from elastid.nonlinear.result import FrictionTakenOut
from elastid.nonlinear.shapes import friction_means, spectrum
from elastid.record import Record

_ROUNDS = 2  # of motion and friction by each other


def motion_under(record: Record, place: str, friction: FrictionTakenOut) -> Motion:
    """The motion of a motor under the friction that was found; as `motion_of` where its samples show no images."""
    motion, a = motion_of(record, place), float(friction.accelerance[friction.places.index(place)])
    if a == 0 or not _shows_images(record, place):
        return motion
    n, channel, taken = whole_samples(record), record.inputs.index(place), friction.taken_shapes(place)
    Y, start, gain = own_spectrum(record, place)
    s, noise_of_line, held = laplace(n * CELLS // 2 + 1, n, record.rate_hz), noise_power(Y), record.u[:n, channel]
    half = slice(0, len(Y))
    is_above = s.imag[half] > 2 * np.pi * friction.highest_hz.max()
    by_inertia = np.divide(a, s[half] ** 2, out=np.zeros(len(Y), complex), where=is_above)
    torque, steps = hold_of(record)[:, channel] * rfft(held), rfft(np.repeat(held, CELLS))
    for _ in range(_ROUNDS):
        means = rfft(friction_means(record, motion, taken).ravel())
        above = a * _above(steps - means, n, record.rate_hz)
        sampled = Y - _folded(above, n)
        kept, noise = filtered(record, sampled, 0, noise_of_line)
        share = np.divide((kept * sampled.conj()).real, np.abs(sampled) ** 2, out=np.ones(len(Y)), where=sampled != 0)
        velocity = above
        velocity[half] = kept + (1 - share) * by_inertia * (torque - spectrum(means, n))
        velocity *= s
        velocity[0] = gain * record.rate_hz
        x = irfft(velocity, n * CELLS) * CELLS
        motion = Motion(np.append(x, x[0]), start, record.rate_hz, noise)
    return motion


def _above(X: ComplexArray, n: int, rate_hz: float) -> ComplexArray:
    """The second integral of a torque that is steady in cells of n samples, by its DFT X, above half their rate."""
    above = np.zeros_like(X)
    above[n // 2 + 1 :] = X[n // 2 + 1 :] * _second_integral(n, 2 * (len(X) - 1) // n, rate_hz)[n // 2 + 1 :]
    return above


@lru_cache(maxsize=8)
def _second_integral(n: int, cells: int, rate_hz: float) -> ComplexArray:
    """From the DFT of a torque that is steady in cells of n samples to that of its second integral, as of samples."""
    cell, s = np.arange(n * cells // 2 + 1) / (n * cells), laplace(n * cells // 2 + 1, n, rate_hz)
    of_cells = np.exp(-1j * np.pi * cell) * np.sinc(cell) / cells
    return frozen(np.divide(of_cells, s**2, out=np.zeros_like(s), where=s != 0), np.complex128)


def _folded(X: ComplexArray, n: int) -> ComplexArray:
    """The DFT (n // 2 + 1,) that n samples show of a signal with the DFT X up to several times their rate."""
    lines, rates = n // 2 + 1, (len(X) - 1) // n
    mirrored = [X[m * n - lines + 1 : m * n + 1][::-1].conj() for m in range(1, rates + 1)]
    return np.asarray(sum([X[m * n : m * n + lines] for m in range(rates)] + mirrored))


def over_whole_periods(record: Record) -> Record:
    """The record without the samples after its last whole period."""
    n = whole_samples(record)
    return replace(record, u=record.u[:n], y=record.y[:n], r=None if record.r is None else record.r[:n])


def friction_samples(record: Record, place: str, friction: FrictionTakenOut) -> FloatArray:
    """A motor's friction (n,) as a torque that is held as u is, along the motion under it."""
    n, motion = whole_samples(record), motion_under(record, place, friction)
    low = spectrum(rfft(friction_means(record, motion, friction.taken_shapes(place)).ravel()), n)
    H = hold_of(record)[:, record.inputs.index(place)]
    # Near a zero of the hold the torque's samples do not determine the torque.
    return np.asarray(irfft(np.divide(low, H, out=np.zeros_like(low), where=np.abs(H) > 0.1), n))


def _shows_images(record: Record, place: str) -> bool:
    """True if the samples of a motor's motion contain the images of its own held torque."""
    images = record.images
    if images is None:
        return False
    return images.rates_hz[record.inputs.index(place)] > 0 and images.sampled[record.outputs.index(place)]


def hold_of(record: Record) -> ComplexArray:
    """H (n // 2 + 1, n_u) of the torques at the lines of all whole periods."""
    n = whole_samples(record)
    return record.hold_response(line_frequencies(np.arange(n // 2 + 1), record.rate_hz, n))
