"""The spring of a joint: gearbox, bearing or link."""

from __future__ import annotations

from elastid.robot.numbers import Numbers
from elastid.section import section
from elastid.units import Damping, Stiffness


@section
class Spring:
    """tau = -stiffness * deflection - damping * its rate, on the link side."""

    stiffness: Stiffness
    damping: Damping = 0.0

    def __post_init__(self) -> None:
        """A spring repels: refuse what would pull."""
        if not self.stiffness > 0:
            raise ValueError(f"stiffness is {self.stiffness:g} N*m/rad; it must be positive")
        if self.damping < 0:
            raise ValueError(f"damping is {self.damping:g} N*m*s/rad; it must not be negative")

    def numbers(self, joint: str) -> Numbers:
        """k_ and d_ of a joint."""
        return {f"k_{joint}": ("N*m/rad", ("stiffness",)), f"d_{joint}": ("N*m*s/rad", ("damping",))}
