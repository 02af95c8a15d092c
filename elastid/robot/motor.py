"""The motor of a joint and its gear."""

from __future__ import annotations

import math

from elastid.robot.friction import Friction
from elastid.robot.numbers import Numbers
from elastid.section import section
from elastid.units import Damping, Inertia, Torque


@section
class Motor:
    """A motor and its gear: inertia and friction on the motor side, ratio = motor turns per joint turn.

    Link side: ratio^2 inertia, ratio^2 viscous, |ratio| coulomb.  coulomb: dry friction that is Coulomb's alone;
    `friction` in its place says more.
    """

    inertia: Inertia
    ratio: float = 1.0
    viscous: Damping = 0.0
    coulomb: Torque = 0.0
    friction: Friction | None = None

    def __post_init__(self) -> None:
        """Refuse what no motor can have."""
        if self.ratio == 0 or not math.isfinite(self.ratio):
            raise ValueError(f"the gear ratio is {self.ratio:g}; it must be a finite number other than 0")
        if not self.inertia > 0:
            raise ValueError(f"the motor's inertia is {self.inertia:g} kg*m^2; it must be positive")
        for name, friction in (("viscous", self.viscous), ("coulomb", self.coulomb)):
            if friction < 0:
                raise ValueError(f"{name} friction is {friction:g}; it must not be negative")
        if self.friction is not None:
            if self.coulomb > 0:
                raise ValueError(
                    "coulomb and friction are both given; friction has a coulomb of its own, leave one out"
                )
            self.friction.check_passive(self.viscous)

    def numbers(self, joint: str) -> Numbers:
        """Jm_ and fm_ of a joint, on the motor side."""
        return {f"Jm_{joint}": ("kg*m^2", ("inertia",)), f"fm_{joint}": ("N*m*s/rad", ("viscous",))}
