"""The laws of friction before it slides: bristles that bend, numbers on the side of their place."""

from __future__ import annotations

from typing import Annotated, Literal

from elastid.base.section import Key, section
from elastid.base.units import Damping, InUnit, JointVelocity, Stiffness


@section
class LuGre:
    """Bristles under a Stribeck curve."""

    # fmt: off
    stiffness: Annotated[Stiffness, Key("Stiffness sigma_0 of the bristles.", "coulomb over the angle in which "
        "friction builds up after a reversal, 1e-5 to 1e-3 rad at a motor; larger asks for more substeps.")]
    damping: Annotated[Damping, Key("Damping sigma_1 of the bristles.", "about the root of stiffness times inertia, so "
        "that sticking does not ring; too large a one is not passive.")] = 0.0
    damping_velocity: Annotated[JointVelocity | None, Key("Velocity v_d with which the bristles' damping falls, "
        "sigma_1 exp(-(v / v_d)^2); default: constant.", "where damping at speed would add to viscous friction; at "
        "most 9.3 coulomb / damping keeps it passive.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse bristles that push."""
        require_positive("lugre: stiffness (sigma_0)", self.stiffness)
        require_not_negative("lugre: damping (sigma_1)", self.damping)
        if self.damping_velocity is not None:
            require_positive("lugre: damping_velocity (v_d)", self.damping_velocity)


@section
class MaxwellSlip:
    """Generalised Maxwell slip: elements side by side, each a spring that slips at its share of the Stribeck curve."""

    # fmt: off
    stiffness: Annotated[tuple[Stiffness, ...], Key("Stiffness sigma_0 of every element.", "one number for each "
        "element; those that are stiff for their share slip first.")]
    shares: Annotated[tuple[float, ...], Key("Share nu of every element in the torque, 1 in sum.", "as many as "
        "stiffnesses; equal ones are a good start by hand.")]
    attraction: Annotated[Annotated[float, InUnit("N*m/s", "N/s")], Key("Attraction C: rate at which the torque of a "
        "slipping element approaches its level.", "larger reaches the level sooner after break-away and is stiffer to "
        "integrate.")]
    damping: Annotated[tuple[Damping, ...], Key("Damping sigma_1 of every element (default: none).", "some for each "
        "element against ringing at standstill; none for quasi-static loops.")] = ()
    switching: Annotated[Literal["smooth", "events"], Key("Switching between sticking and slipping: `smooth`, without "
        "a memory of its own, or by `events`.", "`events` to compare with the textbook model; `smooth` where solvers "
        "need derivatives.")] = "smooth"
    # fmt: on

    def __post_init__(self) -> None:
        """As many numbers as elements, shares that sum to one."""
        if not self.stiffness or len(self.stiffness) != len(self.shares):
            raise ValueError(
                f"maxwell_slip: {len(self.stiffness)} numbers of stiffness and {len(self.shares)} shares; give one of "
                "each for every element"
            )
        if self.damping and len(self.damping) != len(self.stiffness):
            raise ValueError(f"maxwell_slip: {len(self.damping)} dampings for {len(self.stiffness)} elements")
        for name, values in (("stiffness (sigma_0)", self.stiffness), ("shares (nu)", self.shares)):
            for value in values:
                require_positive(f"maxwell_slip: {name}", value)
        for value in self.damping:
            require_not_negative("maxwell_slip: damping (sigma_1)", value)
        require_positive("maxwell_slip: attraction (C)", self.attraction)
        if abs(sum(self.shares) - 1) > 1e-6:
            raise ValueError(f"maxwell_slip: the shares sum to {sum(self.shares):.6g}; they must sum to 1")


def require_positive(name: str, value: float) -> None:
    """ValueError for a number that is not above zero."""
    if not value > 0:
        raise ValueError(f"{name} is {value:g}; it must be positive")


def require_not_negative(name: str, value: float) -> None:
    """ValueError for a negative number."""
    if value < 0:
        raise ValueError(f"{name} is {value:g}; it must not be negative")
