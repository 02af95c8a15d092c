"""The motor of a joint, its gear, and the body it rides on."""

from __future__ import annotations

import math
from typing import Annotated

from elastid.base.section import Key, section
from elastid.base.units import Damping, Inertia, Torque
from elastid.robot.friction import Friction
from elastid.robot.named_numbers import Numbers, below
from elastid.robot.placement import Axis, unit_axis
from elastid.robot.spring import Spring


@section
class Motor:
    """A motor and its gear, motor side; link side ratio^2 inertia, ratio^2 viscous, |ratio| coulomb."""

    # fmt: off
    inertia: Annotated[Inertia, Key("Inertia of the rotor about its axis.", "rotor, brake and input stage together; "
        "the data sheet's rotor alone may be half of it.")]
    ratio: Annotated[float, Key("Gear ratio: motor turns per joint turn, negative where they turn in opposite ways.",
        "from the controller's parameters, sign included; an error here is one of its square in inertia.")] = 1.0
    viscous: Annotated[Damping, Key("Viscous friction of the motor.", "the slope of torque over speed of a warm axis, "
        "over ratio^2 on the motor's side; fm_NAME of a fit finds it, from a start that is not 0.")] = 0.0
    coulomb: Annotated[Torque, Key("Coulomb friction of the motor, dry friction of one level.", "half the torque "
        "between slow motion up and down; used by simulation, a linear fit does not see it.")] = 0.0
    spring: Annotated[Spring | None, Key("Spring of the motor's shaft, before all gears, on the motor side; in series "
        "with the joint's own.", "for belts and couplings between motor and gear that swing by themselves, mostly "
        "above 50 Hz.")] = None
    on: Annotated[str, Key("Body that carries the motor. The rotor then takes part in the carrier's rotation, T = "
        "inertia (axis . omega + ratio q_m')^2 / 2, and the carrier's mass and inertia hold the rest of it: all of its "
        "mass, and its inertia but for that about its own axis. Without a carrier the rotor turns about its own axis "
        "only, and the carrier holds all of it.", "for motors in the arm, wrist motors above all; with ratios of 100 "
        "and more the effect on modes is a few percent.")] = ""
    axis: Annotated[Axis | None, Key("Axis of the rotor in the axes of the carrier: the direction about which the "
        "rotor turns where the motor does; given with `on`, and not without.", "for motors across their joint, behind "
        "bevel gears or belts; the sign counts with that of ratio.")] = None
    friction: Annotated[Friction | None, Key("Dry friction of the motor by any law, in place of coulomb.",
        "for studies of friction, whose export writes it; `coulomb` is enough for an elastic one.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse numbers that no motor can have."""
        if self.ratio == 0 or not math.isfinite(self.ratio):
            raise ValueError(f"the gear ratio is {self.ratio:g}; it must be a finite number other than 0")
        if not self.inertia > 0:
            raise ValueError(f"the motor's inertia is {self.inertia:g} kg*m^2; it must be positive")
        if self.spring is not None and not self.spring.is_linear:
            raise ValueError(
                "the spring of a motor's shaft must be linear; give backlash and stiffening to the spring of the joint"
            )
        for name, friction in (("viscous", self.viscous), ("coulomb", self.coulomb)):
            if friction < 0:
                raise ValueError(f"{name} friction is {friction:g}; it must not be negative")
        if bool(self.on) != (self.axis is not None):
            raise ValueError(
                "the motor rides on a body: give both `on`, the body, and `axis`, the rotor's direction in the axes of "
                f"that body (got on: {self.on or 'nothing'}, axis: {'nothing' if self.axis is None else self.axis})"
            )
        if self.axis is not None:
            unit_axis(self.axis)
        if self.friction is not None:
            if self.coulomb > 0:
                raise ValueError(
                    "coulomb and friction are both given; friction has a coulomb of its own, leave one out"
                )
            self.friction.check_passive(self.viscous)

    @property
    def dry_friction(self) -> Friction | None:
        """The law of dry friction, Coulomb's where `coulomb` alone is given; None without any."""
        return Friction(self.coulomb) if self.friction is None and self.coulomb > 0 else self.friction

    def numbers(self, joint: str) -> Numbers:
        """Jm_ and fm_ of a joint, km_ and dm_ of the motor's shaft, on the motor side."""
        own: Numbers = {f"Jm_{joint}": ("kg*m^2", ("inertia",)), f"fm_{joint}": ("N*m*s/rad", ("viscous",))}
        if self.spring is None:
            return own
        shaft = {f"{name[0]}m{name[1:]}": place for name, place in self.spring.numbers(joint).items()}
        return own | below("spring", shaft)
