r"""Acceleration per torque of the motors as inertias, from lines above the excited ones.

Friction and the loop move a motor at all lines, and above the resonances as an inertia on a spring whose other end
rests. Of its samples all images are known but for two numbers,

.. math:: y = a \Big[\frac{\tau}{s^2}\Big]_{folded} + b \Big[\frac{\tau}{s^4}\Big]_{folded}, \qquad
          \tau = H u - \sum_i f_i \phi_i, \quad a = 1 / J, \quad b = -k / J^2

which a regression over these lines gives to some tenths of a percent. At the highest of the excited lines G is off
from a by as much as the nearest resonances add.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.execution import Execution
from elastid.excitation.grids import line_frequencies
from elastid.frf.friction.motion import folded, integrated, laplace, own_spectrum, whole_samples
from elastid.frf.friction.result import FrictionTakenOut
from elastid.frf.friction.reversals import friction_spectrum, held_spectrum, sharp_motion, shows_images
from elastid.frf.friction.spectra import ConfigurationSpectra
from elastid.record import MOTION_ORDER, Record
from elastid.record import Motion as Quantity

# The highest of the excited lines, where a motor moves as an inertia.
_HIGHEST = 1 / 8
# The lines above: from so many times the highest excited one on, or from this part of the rate.
_ABOVE, _MAX_LOWEST = 1.5, 1 / 4
# So many records give it to less than a percent.
_MAX_RECORDS = 6
# A regression of a larger standard deviation, over its result, is not better than the excited lines.
_MAX_ERROR = 0.03


def accelerance_of_lines(
    data: Sequence[ConfigurationSpectra], frictions: Sequence[ComplexArray], quantity: Quantity
) -> FloatArray:
    """Acceleration per torque (n_m,) of each motor at the highest excited lines; never negative.

    frictions: torques (F, n_m, K) that are taken out of each configuration.
    """
    found = []
    for each, friction in zip(data, frictions, strict=True):
        on = np.flatnonzero(each.excited)[-max(1, int(_HIGHEST * each.excited.sum())) :]
        G = each.Y[on] @ np.linalg.pinv(each.U[on] - friction[on])
        s = 2j * np.pi * each.freq_hz[on, None]
        found.append(np.diagonal(G, axis1=1, axis2=2) * s ** (2 - MOTION_ORDER[quantity]))
    return np.asarray(np.maximum(np.median(np.concatenate(found).real, axis=0), 0.0))


def with_inertial_accelerance(
    friction: FrictionTakenOut, records: Sequence[Record], highest_hz: float, execution: Execution | None = None
) -> FrictionTakenOut:
    """The friction with the accelerance by the first of some records in place of that at lines up to `highest_hz`.

    Only of motors whose torque is held, with friction, where the regression is good.  execution: of the records.
    """
    accelerance = friction.accelerance.copy()
    motors = [
        m
        for m, place in enumerate(friction.places)
        if place in friction.taken_places() and accelerance[m] != 0 and shows_images(records[0], place)
    ]
    work = partial(_equations, [friction.places[m] for m in motors], friction, highest_hz)
    of_records = (execution or Execution()).ordered(work, records[:_MAX_RECORDS]) if motors else []
    for m, *parts in zip(motors, *of_records, strict=True):
        X, y = (np.concatenate(each, axis=-1) for each in zip(*parts, strict=True))
        A = (X.conj() @ X.T).real
        found = np.linalg.solve(A, (X.conj() @ y).real)
        variance = np.mean(np.abs(y - found @ X) ** 2) / 2 * np.linalg.inv(A)[0, 0]
        if np.sqrt(variance) < _MAX_ERROR * found[0]:
            accelerance[m] = found[0]
    return replace(friction, accelerance=accelerance)


def _equations(
    places: Sequence[str], friction: FrictionTakenOut, highest_hz: float, record: Record
) -> list[tuple[ComplexArray, ComplexArray]]:
    """The columns of a and of b (2, F), and y (F,), of each place at the lines of the period above `highest_hz`."""
    n, rate_hz = whole_samples(record), record.rate_hz
    lowest = min(_ABOVE * highest_hz, _MAX_LOWEST * rate_hz)
    lines = np.arange(0, n // 2, n // record.period_samples)
    lines = lines[line_frequencies(lines, rate_hz, n) > lowest]
    found = []
    for place in places:
        torque = held_spectrum(record.u[:n, record.inputs.index(place)])
        torque -= friction_spectrum(record, place, sharp_motion(record, place, friction), friction)
        s = laplace(len(torque), n, rate_hz)
        inertia = integrated(torque, s, 2)
        spring = integrated(inertia, s / (2 * np.pi * lowest), 2)
        Y, _, _ = own_spectrum(record, place)
        found.append((np.array([folded(inertia, n)[lines], folded(spring, n)[lines]]), Y[lines]))
    return found
