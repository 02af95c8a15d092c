"""Rows of a fit result: identified numbers, presliding friction, rigid parts and modification indices."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.display import digits, interval_of, number
from elastid.linear.presliding import RelaxingSpring

NO_NUMBERS, NO_TABLE, NO_PAIRS = (partial(np.zeros, shape) for shape in (0, (0, 0), (0, 2)))


@frozen_value
class RigidPart:
    """A base, about one axis, that the model takes as rigid.

    stiffness: typical of such a part.  changes (n,): of the variables of interest for this stiffness.
    detection_limit: the stiffness from which on no variable leaves its 95 % interval.
    """

    name: str
    stiffness: float = labelled("usual stiffness", "N*m/rad")
    changes: FloatArray = labelled("change of each parameter of interest, of x")
    detection_limit: float = labelled("stiffness from which on no interval is left", "N*m/rad")

    def most_moved(self, names: Sequence[str]) -> dict[str, float]:
        """Return the two stiffnesses among `names` (n,) that it moves most, and their relative changes."""
        changes = zip(names, np.expm1(self.changes).tolist(), strict=True)
        stiff = [pair for pair in changes if pair[0].startswith("k") and pair[1]]
        return dict(sorted(stiff, key=lambda pair: -abs(pair[1]))[:2])


@frozen_value
class Presliding:
    """Presliding friction of a motor, estimated with the parameters of the fit: a spring that relaxes.

    stiffness: negative of bristles with much damping, and of friction that was compensated too much.  amplitude: motion
    between two reversals over the presliding distance, about; NaN where no motion is known.
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

    name, group: m_arm and `mass`; gain_u_* of a factor that all of them share; payload_arm of mass, centre and inertia.
    members, values, units: the numbers and their fixed values, SI.  log: whether the step of each is of ln p.
    steps (n_m,): their changes, limited to plausible values.  std: of the first by the measured noise.
    drop: of V.  explained_fraction: of the excess of V.  effects (n_x,): implied change of each free parameter, in x.
    alike: names of others that the data cannot distinguish from it.  place: 0 where it is freed alone; 1, 2, ... in the
    sequence in which each is freed after those before it, with the further share that it explains.
    odds: 2 ln of the odds against the likeliest cause.  occam: the part of the odds by freedom and prior of its size.
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
    def changed(self) -> tuple[float, ...]:
        """Their values after the step, SI."""
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
        # A larger change of ln k is of a fit that ended far from any robot.
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
        ends = " to ".join(interval_of(self.interval, n_digits))
        return f"{self.name} = {number(self.value, n_digits)} {self.unit}, 95 % {ends}"
