r"""Records whose torque is the net one: the friction that was found is taken out of u.

The torque of a record is held between its samples, friction is not; so friction is divided by the hold as samples:

.. math:: u_{net} = u - IDFT\{ H^{-1}\, DFT\{ \textstyle\sum_i f_i \phi_i \} \}
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from scipy.fft import irfft, rfft

from elastid.base.arrays import FloatArray
from elastid.excitation.grids import line_frequencies
from elastid.frf.friction.result import FrictionTakenOut
from elastid.frf.friction.reversals import sharp_motion
from elastid.frf.friction.shafts import on_links, on_shafts
from elastid.frf.friction.shapes import samples
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
    torque = friction_torque(record, friction)
    n = len(torque)
    freq_hz = line_frequencies(np.arange(n // 2 + 1), record.rate_hz, n)
    H = record.hold_response(freq_hz)
    spectrum = rfft(torque, axis=0)
    held = np.divide(spectrum, H, out=np.zeros_like(spectrum), where=np.abs(H) > _MIN_HOLD)
    u = record.u[:n] - irfft(held, n, axis=0)
    r = None if record.r is None else record.r[:n]
    return replace(record, u=u, y=record.y[:n], r=r)


def friction_torque(record: Record, friction: FrictionTakenOut) -> FloatArray:
    """Sum (n, n_u) of f_i phi_i at the samples of all whole periods of a record, Nm on the link side."""
    n = record.n_samples // record.period_samples * record.period_samples
    torque = np.zeros((n, len(record.inputs)))
    for place in friction.taken_places():
        shapes, levels = zip(*friction.taken_shapes(place), strict=True)
        phi = samples(record, {place: sharp_motion(record, place, friction)}, shapes)
        torque[:, record.inputs.index(place)] = phi @ np.array(levels)
    return torque
