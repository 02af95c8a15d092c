"""LimitUse: largest motor torques, motions and reference motions of a plan relative to the robot's limits."""

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import Note
from elastid.base.units import translation_unit

# `turning back`: largest decrease of a motor's speed below a carrier's constant velocity, which is its limit, in the
# measured periods.  The last three apply to injected references, which robots check as well.
QUANTITIES = (
    *("torque", "position", "velocity", "acceleration", "turning back"),
    *("reference position", "reference velocity", "reference acceleration"),
)
UNITS = ("N*m", "rad", "rad/s", "rad/s^2", "rad/s", "rad", "rad/s", "rad/s^2")


@frozen_value
class LimitUse:
    """Largest values and limits (Q, 8, n_u) of QUANTITIES, infinite if not given.

    peak: by simulation, of runs far from all limits by the linear response.  Positions are relative to the
    configuration, with the distance to the nearer limit.  factor (Q, n_u): on the amplitudes of the study.
    notes: on configurations that are scaled down.  sliding: inputs that translate, in N and m.
    """

    configurations: tuple[str, ...]
    inputs: tuple[str, ...]
    peak: FloatArray = labelled("largest value, link side", "", "configurations quantity inputs")
    limit: FloatArray = labelled("limit, infinite where there is none", "", "configurations quantity inputs")
    factor: FloatArray = labelled("factor on the amplitudes that the study gives", "", "configurations inputs")
    margin: float
    notes: tuple[Note, ...] = ()
    sliding: tuple[str, ...] = ()

    @property
    def used(self) -> FloatArray:
        """Used fraction (Q, 8, n_u) of each limit."""
        return self.peak / self.limit

    @property
    def closest(self) -> str:
        """Sentence on the limit with the largest used fraction."""
        if not np.isfinite(self.limit).any():
            return "no limits are given"
        q, kind, i = np.unravel_index(np.argmax(self.used), self.used.shape)
        return (
            f"closest limit: {QUANTITIES[kind]} of {self.inputs[i]} in configuration {self.configurations[q]}, "
            f"{self.peak[q, kind, i]:.4g} of {self.limit[q, kind, i]:.4g} "
            f"{unit_of(int(kind), self.inputs[i] in self.sliding)} ({100 * self.used[q, kind, i]:.0f} %)"
        )

    @property
    def by_quantity(self) -> str:
        """List of the limited quantities, each with the largest used fraction."""
        fraction, is_limited = self.used.max(axis=(0, 2)), np.any(np.isfinite(self.limit), axis=(0, 2))
        return ", ".join(f"{QUANTITIES[i]} {fraction[i]:.0%}" for i in np.flatnonzero(is_limited))


def unit_of(kind: int, slides: bool) -> str:
    """Return the SI unit of one of QUANTITIES (index) for a joint that turns or slides."""
    return translation_unit(UNITS[kind]) if slides else UNITS[kind]
