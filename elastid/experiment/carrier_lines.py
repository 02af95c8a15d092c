"""What a carrier must not do, as far as its section and the excited lines tell; study and rig ask alike."""

from __future__ import annotations

import numpy as np

from elastid.arrays import IntArray
from elastid.experiment.simulated.spec import CarrierSpec


def refusal(carrier: CarrierSpec, lines: IntArray, spacing_hz: float, n_u: int) -> str:
    """A sentence where a periodic carrier is not below all analysed lines, or moves other than n_u motors.

    An empty text where nothing is wrong.  lines: excited and left free for detection.  spacing_hz: 1 / period.
    """
    lowest = int(lines.min())
    if carrier.kind != "offset" and carrier.cycles >= lowest:
        return (
            f"{carrier.cycles} cycles a period are {carrier.cycles * spacing_hz:g} Hz, not below the lowest excited "
            f"frequency of {lowest * spacing_hz:g} Hz; "
            + (f"take at most {lowest - 1} cycles, or raise" if lowest > 1 else "raise")
            + " excitation.band_hz"
        )
    for what, values in (("velocities", carrier.velocity), ("amplitudes", carrier.amplitude)):
        given = np.size(0.0 if values is None else values)
        if given not in (1, n_u):
            return f"{given} {what} for {n_u} motors; give one for all or one for each"
    return ""
