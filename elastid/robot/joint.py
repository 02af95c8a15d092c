"""A joint between two bodies, and what it may do."""

from __future__ import annotations

import math
from dataclasses import field

from elastid.robot.friction import Friction
from elastid.robot.geometry import Axis, unit_axis
from elastid.robot.motor import Motor
from elastid.robot.numbers import Numbers, below
from elastid.robot.spring import Spring
from elastid.section import section
from elastid.units import Angle, AngularAcceleration, AngularVelocity, Damping, Torque


@section
class Limits:
    """What a driven joint may do, link side: angle in rad, its derivatives in rad/s and rad/s^2, motor torque in Nm."""

    angle: tuple[Angle, Angle] = (-math.inf, math.inf)
    velocity: AngularVelocity = math.inf
    torque: Torque = math.inf
    acceleration: AngularAcceleration = math.inf

    def __post_init__(self) -> None:
        """Refuse an empty range."""
        if not self.angle[0] < self.angle[1] or not min(self.velocity, self.torque, self.acceleration) > 0:
            raise ValueError(
                "limits must leave something: angle [lower, upper], positive velocity, torque and acceleration"
            )


@section
class Joint:
    """A rotation about `axis`, with a spring, a motor, both or neither; friction acts across the joint.

    start: its angle where loops are put together, which decides between the two ways in which most loops close.
    """

    name: str
    axis: Axis = "z"
    spring: Spring | None = None
    motor: Motor | None = None
    viscous: Damping = 0.0
    friction: Friction | None = None
    limits: Limits = field(default_factory=Limits)
    start: Angle = 0.0

    def __post_init__(self) -> None:
        """Check axis and friction."""
        unit_axis(self.axis)
        if self.viscous < 0:
            raise ValueError(f"joint {self.name}: viscous friction is {self.viscous:g}; it must not be negative")
        if self.friction is not None:
            self.friction.check_passive(self.viscous)

    @property
    def is_passive(self) -> bool:
        """Neither driven nor elastic: it hangs, or a loop moves it."""
        return self.motor is None and self.spring is None

    @property
    def is_flexible(self) -> bool:
        """Driven through an elastic gear: it has a motor coordinate of its own."""
        return self.motor is not None and self.spring is not None

    @property
    def numbers(self) -> Numbers:
        """Of the spring, of friction across the joint (f_), of the motor."""
        spring = below("spring", self.spring.numbers(self.name)) if self.spring is not None else {}
        motor = below("motor", self.motor.numbers(self.name)) if self.motor is not None else {}
        return spring | {f"f_{self.name}": ("N*m*s/rad", ("viscous",))} | motor
