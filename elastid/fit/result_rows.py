"""Rows of a fit result: identified numbers, presliding friction, rigid parts and modification indices."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.display import digits, format_interval, number
from elastid.linear.presliding import RelaxingSpring

NO_NUMBERS, NO_TABLE, NO_PAIRS = (partial(np.zeros, shape) for shape in (0, (0, 0), (0, 2)))


@frozen_value
class RigidPart:
    """Rotation of the base about one axis, which the model assumes to be rigid.

    stiffness: typical value.  changes (n,): of the parameters of interest, in x, for this stiffness.
    detection_limit: stiffness above which every parameter stays within its 95 % interval.
    """

    name: str
    stiffness: float = labelled("usual stiffness", "N*m/rad")
    changes: FloatArray = labelled("change of each parameter of interest, of x")
    detection_limit: float = labelled("stiffness from which on no interval is left", "N*m/rad")

    def most_moved(self, names: Sequence[str]) -> dict[str, float]:
        """Return the relative changes of the two stiffnesses among `names` (n,) that change most, by name."""
        changes = zip(names, np.expm1(self.changes).tolist(), strict=True)
        stiff = [pair for pair in changes if pair[0].startswith("k") and pair[1]]
        return dict(sorted(stiff, key=lambda pair: -abs(pair[1]))[:2])


@frozen_value
class Presliding:
    """Presliding friction of a motor, estimated as a relaxing spring together with the parameters.

    stiffness: negative for bristles with high damping, and for overcompensated friction.  amplitude: approximate motion
    between two reversals over the presliding distance; NaN for unknown motion.
    """

    place: str
    unit: str
    stiffness: float = labelled("stiffness, link side", "{unit}")
    stiffness_std: float = labelled("its standard deviation", "{unit}")
    rate: float = labelled("relaxation rate", "1/s")
    rate_std: float = labelled("its standard deviation", "1/s")
    amplitude: float = labelled("motion between two reversals over the presliding distance", default=math.nan)

    @property
    def spring(self) -> RelaxingSpring:
        """The spring in the equations."""
        return RelaxingSpring(self.place.removeprefix("motor "), 1 if self.stiffness > 0 else -1)


@frozen_value
class ModificationIndex:
    """Fixed numbers of a fit, freed together for one Gauss-Newton step with its parameters.

    name, group: m_arm and `mass`; gain_u_* for a common factor; payload_arm for mass, centre and inertia of a body.
    members, values, units: the numbers and their fixed values, SI.  log: True for a step of ln p.
    steps (n_m,): changes, limited to plausible values.  std: of the first step, by the measured noise.
    drop: of V.  explained_fraction: of the excess of V.  effects (n_x,): implied changes of the free parameters, in x.
    alike: names of indistinguishable causes.  place: 0 if freed alone; 1, 2, ... in the sequence of causes, where each
    is freed in addition to the previous ones and explains a further fraction. odds: 2 ln of the odds relative to the
    likeliest cause.  occam: contribution of Occam's factor and prior to the odds.
    """

    name: str
    group: str
    members: tuple[str, ...] = ()
    values: FloatArray = labelled("fixed values of the numbers", "SI", default_factory=NO_NUMBERS)
    units: tuple[str, ...] = ()
    log: tuple[bool, ...] = ()
    steps: FloatArray = labelled("their changes, of ln p where log", default_factory=NO_NUMBERS)
    std: float = math.nan
    drop: float = labelled("decrease of V", default=0.0)
    explained_fraction: float = labelled("share of the excess of V over the noise", default=0.0)
    effects: FloatArray = labelled("implied change of each free parameter, of x", default_factory=NO_NUMBERS)
    alike: tuple[str, ...] = ()
    place: int = 0
    odds: float = labelled("2 ln of the odds against the likeliest cause", default=0.0)
    occam: float = labelled("part of the odds by freedom and size", default=0.0)

    @property
    def step(self) -> float:
        """Change of the first number."""
        return float(self.steps[0])

    @property
    def changed(self) -> tuple[float, ...]:
        """Values of the numbers after the step, SI."""
        return tuple(
            value * math.exp(step) if log else value + step
            for value, step, log in zip(self.values.tolist(), self.steps.tolist(), self.log, strict=True)
        )

    def most_moved(self, free_names: Sequence[str]) -> tuple[str, float]:
        """Free stiffness with the largest relative change, and this change; "" without one."""
        stiff = [i for i, name in enumerate(free_names) if name.startswith("k") and math.isfinite(self.effects[i])]
        if not stiff:
            return "", 0.0
        i_max = max(stiff, key=lambda i: abs(float(self.effects[i])))
        # Limit the change of ln k of a fit that diverged.
        return free_names[i_max], math.expm1(min(float(self.effects[i_max]), 50.0))


@dataclass(frozen=True)
class Estimate:
    """One identified number in SI: value, standard deviation and the ends of its 95 % interval."""

    name: str
    value: float
    std: float
    low: float
    high: float
    unit: str

    @property
    def interval(self) -> tuple[float, float]:
        """Both ends of the 95 % interval."""
        return self.low, self.high

    def __str__(self) -> str:
        n_digits = digits(self.value, self.std)
        ends = " to ".join(format_interval(self.interval, n_digits))
        return f"{self.name} = {number(self.value, n_digits)} {self.unit}, 95 % {ends}"
