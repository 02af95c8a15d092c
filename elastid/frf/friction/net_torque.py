r"""Records whose torque is the net one: the friction that was found is taken out of u, and its images out of y.

The torque of a record is held between its samples, friction is not; so friction is divided by the hold as samples:

.. math:: u_{net} = u - u_\phi, \qquad u_\phi = IDFT\{ H^{-1}\, DFT\{ \textstyle\sum_i f_i \phi_i \} \}

Sampled angles contain images of a held torque, and friction's are others than those of u_phi, which a model of held
torques adds. Above half the rate a motor moves as an inertia, so that its samples become those of the net torque by

.. math:: y_{net} = y + \Big[\frac{a}{s^2} \big(\textstyle\sum_i f_i \phi_i - H u_\phi\big)_{high}\Big]_{folded}
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.fft import irfft

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.excitation.grids import line_frequencies
from elastid.frf.friction.motion import folded, whole_samples
from elastid.frf.friction.result import FrictionTakenOut
from elastid.frf.friction.reversals import (
    friction_spectrum,
    held_spectrum,
    sharp_motion,
    shows_images,
    twice_integrated,
)
from elastid.frf.friction.shafts import on_links, on_shafts
from elastid.record import Record

# Near a zero of the hold the torque's samples say nothing of the torque.
_MIN_HOLD = 0.1


def net_records(
    records: Iterable[Record], friction: FrictionTakenOut | None, E: FloatArray | None = None
) -> Iterator[Record]:
    """The records with the net torque as u, one at a time; as they are where nothing was taken out.

    E: couplings of the motors' gears, on whose shafts friction was found; None where there are none.
    """
    for record in records:
        if friction is None or not friction.shapes:
            yield record
        else:
            yield on_links(net_record(on_shafts(record, E), friction), E)


def net_record(record: Record, friction: FrictionTakenOut) -> Record:
    """The same record over its whole periods with the net torque as u; itself where nothing was taken out."""
    if not friction.shapes:
        return record
    record = over_whole_periods(record)
    u, y = record.u.copy(), record.y.copy()
    for place in friction.taken_places():
        torque = friction_spectrum(record, place, sharp_motion(record, place, friction), friction)
        u[:, record.inputs.index(place)] -= _as_held(torque, record, place)
        y[:, record.outputs.index(place)] += other_images(record, place, torque, friction)
    return replace(record, u=u, y=y)


def over_whole_periods(record: Record) -> Record:
    """The record without the samples after its last whole period."""
    n = whole_samples(record)
    return replace(record, u=record.u[:n], y=record.y[:n], r=None if record.r is None else record.r[:n])


def other_images(record: Record, place: str, torque: ComplexArray, friction: FrictionTakenOut) -> FloatArray:
    """What makes the images in a motor's samples (n,) those of its net torque, 0 where it has none.

    torque (n cells // 2 + 1,): DFT, as of n samples, of its friction along the sharp motion.
    """
    n = whole_samples(record)
    accelerance = friction.accelerance[friction.places.index(place)]
    if accelerance == 0 or not shows_images(record, place):
        return np.zeros(n)
    held = held_spectrum(_as_held(torque, record, place))
    return np.asarray(irfft(folded(accelerance * twice_integrated(torque - held, record), n), n))


def _as_held(torque: ComplexArray, record: Record, place: str) -> FloatArray:
    """Samples (n,) of a torque that is held as u is, of the spectrum that `torque` has below half the rate."""
    n = whole_samples(record)
    lines = np.arange(n // 2 + 1)
    H = record.hold_response(line_frequencies(lines, record.rate_hz, n))[:, record.inputs.index(place)]
    low = torque[: len(lines)]
    return np.asarray(irfft(np.divide(low, H, out=np.zeros_like(low), where=np.abs(H) > _MIN_HOLD), n))
