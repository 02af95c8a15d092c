r"""The motion of a motor with its part above half the rate, which turns it back earlier than its samples say.

At a reversal friction jumps by 2 F_c, and at each sample the held torque jumps. The velocity has a kink there, which
interpolation of the samples rounds: reversals come out late, by some 2 % of a sample. Above half the rate a motor moves
as an inertia, by the torque that is known,

.. math:: q_{high} = \frac{a}{s^2} (H u - \sum_i f_i \phi_i)_{high}, \qquad a = -\omega^2 G \text{ at high frequencies}

Its samples are images in the record's y; they are taken out, and the part itself is added between the samples. phi_i
depend on the motion; so q_high is a fixed point, which repetition alone reaches slowly, and not at all where friction
is 0.3 of the torque. An error of a leaves as large a part of what is mended.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.fft import fft

from elastid.base.arrays import ComplexArray, FloatArray, frozen
from elastid.frf.friction.fixed_point import fixed_point
from elastid.frf.friction.motion import CELLS, Motion, laplace, motion_of, whole_samples
from elastid.frf.friction.result import FrictionTakenOut
from elastid.frf.friction.shapes import spectrum
from elastid.record import Record

# Cells in a sample: with 8 of them k and d are off by up to 2.5 standard deviations of a good measurement.
SHARP_CELLS = 32
# Of what the part above half the rate was off at first, on the CELLS of samples.
_TOLERANCE = 0.1
# Most motions need 5.
_MOST_REPETITIONS = 12
# Steps on the finer cells from there: one leaves friction several times as far from where repetition ends.
_SHARP_STEPS = 2


def sharp_motion(record: Record, place: str, friction: FrictionTakenOut) -> Motion:
    """The motion of a motor under the friction that was found; as `motion_of` where its samples show no images."""
    accelerance = friction.accelerance[friction.places.index(place)]
    motion = motion_of(record, place)
    if not shows_images(record, place) or accelerance == 0:
        return motion
    n = whole_samples(record)
    held = held_spectrum(record.u[:n, record.inputs.index(place)])

    def part_above(motion: Motion, cells: int) -> ComplexArray:
        own = friction_spectrum(record, place, motion, friction)
        torque = held[: n * cells // 2 + 1].copy()
        torque[: len(own)] -= own[: len(torque)]
        return np.asarray(accelerance * twice_integrated(torque, record))

    high = fixed_point(
        lambda high: part_above(motion_of(record, place, high), CELLS),
        part_above(motion, CELLS),
        _TOLERANCE,
        _MOST_REPETITIONS,
    )
    coarse = np.zeros(n * SHARP_CELLS // 2 + 1, complex)
    coarse[: len(high)] = high
    high = fixed_point(lambda high: part_above(motion_of(record, place, high), SHARP_CELLS), coarse, 0.0, _SHARP_STEPS)
    return motion_of(record, place, high)


def shows_images(record: Record, place: str) -> bool:
    """Whether the samples of a motor's motion contain the images of its own held torque."""
    images = record.images
    if images is None:
        return False
    return images.rates_hz[record.inputs.index(place)] > 0 and images.sampled[record.outputs.index(place)]


def friction_spectrum(record: Record, place: str, motion: Motion, friction: FrictionTakenOut) -> ComplexArray:
    """DFT (n cells // 2 + 1,), as of n samples, of the friction of a motor along its motion."""
    return spectrum(record, motion, friction.taken_shapes(place))


def held_spectrum(samples: FloatArray) -> ComplexArray:
    """DFT (n SHARP_CELLS // 2 + 1,), as of n samples, of a torque held for one sample each; samples (n,) repeat.

    H = (1 - e^{-j theta}) / (j theta) at theta = 2 pi k / n, of which the numerator repeats with the DFT.
    """
    n = len(samples)
    U = fft(samples)
    held = np.resize(U * (1 - np.exp(-2j * np.pi * np.arange(n) / n)), n * SHARP_CELLS // 2 + 1)
    held[1:] *= -1j * n / (2 * np.pi) / np.arange(1, len(held))
    held[0] = U[0]
    return held


def twice_integrated(torque: ComplexArray, record: Record) -> ComplexArray:
    """Its second integral above half the rate, DFT (n cells // 2 + 1,) like the torque; 0 at all lower lines."""
    return torque * _twice_above(len(torque), whole_samples(record), record.rate_hz)


@lru_cache(maxsize=4)
def _twice_above(lines: int, n: int, rate_hz: float) -> FloatArray:
    """1 / s^2 (lines,) of lines of n samples, above half the rate, 0 at all lower ones."""
    found = np.zeros(lines)
    found[n // 2 + 1 :] = 1 / (laplace(lines, n, rate_hz)[n // 2 + 1 :] ** 2).real
    return frozen(found)
