"""LimitUse: how much of each limit of the robot a plan uses in its rehearsal."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.label import labelled
from elastid.base.note import Note
from elastid.base.units import of_translation

# `turning back`: how far a motor's speed falls below that of a carrier of constant velocity, which is the limit, in the
# measured periods.
QUANTITIES = ("torque", "position", "velocity", "acceleration", "turning back")
UNITS = ("N*m", "rad", "rad/s", "rad/s^2", "rad/s")


@frozen_value
class LimitUse:
    """Largest values in the rehearsal, and the limits: peak, limit (Q, 5, n_u) for QUANTITIES, infinite where none.

    position: about the configuration, to either side, its limit the room to the nearer end.  factor (Q, n_u): by which
    the amplitudes of the study were multiplied.  notes: one for every configuration that was scaled down.  nearest:
    the run that came closest to a limit.  sliding: inputs that translate, in N and m.
    """

    configurations: tuple[str, ...]
    inputs: tuple[str, ...]
    peak: FloatArray = labelled("largest value in the rehearsal, link side", "", "configurations quantity inputs")
    limit: FloatArray = labelled("limit, infinite where there is none", "", "configurations quantity inputs")
    factor: FloatArray = labelled("factor on the amplitudes that the study gives", "", "configurations inputs")
    margin: float
    notes: tuple[Note, ...] = ()
    nearest: str = ""
    sliding: tuple[str, ...] = ()

    @property
    def used(self) -> FloatArray:
        """Part of each limit that is used (Q, 5, n_u)."""
        return np.asarray(self.peak / self.limit)

    @property
    def closest(self) -> str:
        """A sentence about the limit of which most is used."""
        if not np.isfinite(self.limit).any():
            return "no limits are given"
        q, kind, i = np.unravel_index(np.argmax(self.used), self.used.shape)
        return (
            f"peaks use at most {self.used[q, kind, i]:.0%} of a limit ({QUANTITIES[kind]} of {self.inputs[i]} in "
            f"{self.configurations[q]}: {self.peak[q, kind, i]:.4g} of {self.limit[q, kind, i]:.4g} "
            f"{unit_of(int(kind), self.inputs[i] in self.sliding)})"
        )


def unit_of(kind: int, slides: bool) -> str:
    """SI unit of one of QUANTITIES, of a motor whose joint turns or slides."""
    return of_translation(UNITS[kind]) if slides else UNITS[kind]
