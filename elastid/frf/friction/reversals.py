r"""The motion of a motor with its part above half the rate, which turns it back earlier than its samples say.

At a reversal friction jumps by 2 F_c, and at each sample the held torque jumps. The velocity has a kink there, which
interpolation of the samples rounds: reversals come out late, by some 2 % of a sample. Above half the rate a motor moves
as an inertia, by the torque that is known,

.. math:: y_{high} = \frac{a}{s^2} (H u - \sum_i f_i \phi_i)_{high}, \qquad a = -\omega^2 G \text{ at the highest lines}

Its samples are images in the record's y; they are taken out, and the part itself is added between the samples. phi_i
depend on the motion; so this is repeated. The size of a hardly matters: 10 % of it are 10 % of what is mended.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.fft import fft

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.excitation.grids import line_frequencies
from elastid.frf.friction.motion import CELLS, Motion, fine, integrated, motion_of
from elastid.frf.friction.result import FrictionTakenOut
from elastid.frf.friction.shapes import spectrum
from elastid.frf.friction.spectra import ConfigurationSpectra
from elastid.record import MOTION_ORDER, Record
from elastid.record import Motion as Quantity

# Repetitions: the change falls by more than ten each time.
_ITERATIONS = 2
# The highest of the excited lines, where a motor moves as an inertia.
_HIGHEST = 1 / 8


def sharp_motion(record: Record, place: str, friction: FrictionTakenOut) -> Motion:
    """The motion of a motor under the friction that was found; as `motion_of` where its torque is not held."""
    motion = motion_of(record, place)
    accelerance = friction.accelerance[friction.places.index(place)]
    if not (record.hold_samples or record.hold == "zero-order") or accelerance == 0:
        return motion
    n = record.n_samples // record.period_samples * record.period_samples
    lines = np.arange(n * CELLS // 2 + 1)
    s = np.asarray(2j * np.pi * record.rate_hz / n * lines, dtype=np.complex128)
    column = record.outputs.index(place)
    order = MOTION_ORDER[record.quantities[column]]
    held = _held_torque(record, record.inputs.index(place), n)
    for _ in range(_ITERATIONS):
        torque = held - sum(f * spectrum(record, motion, shape, n, lines) for shape, f in friction.taken_shapes(place))
        high = np.where(lines > n // 2, accelerance * torque, 0)
        y = record.y.copy()
        y[:n, column] -= fine(integrated(high, s, 2 - order), n)[:-1:CELLS]
        low = motion_of(replace(record, y=y), place)
        angle, velocity = (fine(integrated(high, s, k), n) for k in (2, 1))
        motion = Motion(low.angle + angle, low.velocity + velocity, low.velocity_noise)
    return motion


def high_accelerance(
    data: Sequence[ConfigurationSpectra], frictions: Sequence[ComplexArray], quantity: Quantity
) -> FloatArray:
    """Acceleration per torque (n_m,) of each motor at the highest lines, where it moves as an inertia; never negative.

    frictions: torques (F, n_m, K) that are taken out of each configuration.
    """
    found = []
    for each, friction in zip(data, frictions, strict=True):
        on = np.flatnonzero(each.excited)[-max(1, int(_HIGHEST * each.excited.sum())) :]
        G = each.Y[on] @ np.linalg.pinv(each.U[on] - friction[on])
        s = 2j * np.pi * each.freq_hz[on, None]
        found.append(np.diagonal(G, axis1=1, axis2=2) * s ** (2 - MOTION_ORDER[quantity]))
    return np.asarray(np.maximum(np.median(np.concatenate(found).real, axis=0), 0.0))


def _held_torque(record: Record, column: int, n: int) -> ComplexArray:
    """DFT of the torque between its samples, at the lines of the fine grid, as of samples: u, which repeats, held."""
    lines = np.arange(n * CELLS // 2 + 1)
    H = record.hold_response(line_frequencies(lines, record.rate_hz, n))[:, column]
    return np.asarray(fft(record.u[:n, column])[lines % n] * H)
