"""ModificationIndex: numbers that a fit held, freed for a step, and how far they would explain what it left."""

from __future__ import annotations

import math
from collections.abc import Sequence

from elastid.base.arrays import FloatArray, frozen_value, labelled


@frozen_value
class ModificationIndex:
    """Numbers that the fit held, freed together for one Gauss-Newton step with its parameters.

    name, group: m_arm and `mass`; gain_u_* of a factor that all of them share; payload_arm of mass, centre and inertia.
    members, values, units: the numbers, at which value they were held, SI.  log: whether the step of each is of ln p.
    steps (n_m,): their changes, cut where they would leave what is plausible.  std: of the first by the measured noise.
    drop: of V.  share: of what V has beyond the noise.  effects (n_x,): implied change of each free parameter, in x.
    alike: names of others that the data cannot distinguish from it.  place: 0 where it is freed alone; 1, 2, ... in the
    sequence in which each is freed after those before it, with the further share that it explains.
    odds: 2 ln of those against the likeliest cause, of which occam is what its freedom and the prior of its size take.
    """

    name: str
    group: str
    members: tuple[str, ...]
    values: FloatArray = labelled("values at which the numbers were held", "SI")
    units: tuple[str, ...]
    log: tuple[bool, ...]
    steps: FloatArray = labelled("their changes, of ln p where log")
    std: float
    drop: float = labelled("decrease of V")
    share: float = labelled("share of the excess of V over the noise")
    effects: FloatArray = labelled("implied change of each free parameter, of x")
    alike: tuple[str, ...] = ()
    place: int = 0
    odds: float = labelled("2 ln of the odds against the likeliest cause", default=0.0)
    occam: float = labelled("part of the odds by freedom and size", default=0.0)

    @property
    def changed(self) -> tuple[float, ...]:
        """Their values after the step, SI."""
        return tuple(
            value * math.exp(step) if log else value + step
            for value, step, log in zip(self.values.tolist(), self.steps.tolist(), self.log, strict=True)
        )

    def most_moved(self, free_names: Sequence[str]) -> tuple[str, float]:
        """The stiffness among the free parameters that moves most, and its relative change; "" where there is none."""
        stiff = [i for i, name in enumerate(free_names) if name.startswith("k") and math.isfinite(self.effects[i])]
        if not stiff:
            return "", 0.0
        most = max(stiff, key=lambda i: abs(float(self.effects[i])))
        # A larger change of ln k is of a fit that ended far from any robot.
        return free_names[most], math.expm1(min(float(self.effects[most]), 50.0))
