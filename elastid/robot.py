"""Robot: a tree of rigid bodies with revolute joints, springs, gears and motors. Numbers only, no equations.

From the parent body a body is reached by its placement and then its joints, in the order listed: rotations about
axes of the frame reached so far. A joint is

- driven through an elastic gear:  motor and spring   (coordinates q_a and q_m)
- driven rigidly:                  motor, no spring   (one coordinate)
- elastic, not driven:             spring, no motor   (q_na of the extended flexible joint; rests at angle 0)
- free:                            neither

Stiffness and damping are on the link side; a motor's inertia and friction are on the motor side, as data sheets
give them, and its ratio (motor turns per joint turn, negative where it turns the other way) leads to the link.

Every number that can be identified has a name: k_1 and d_1 (spring of joint 1), f_1 (viscous friction in joint 1),
Jm_1 and fm_1 (inertia and viscous friction of the motor of joint 1), m_arm, c_arm_x, I_arm_xx or, where a body has
the same inertia about every axis, I_arm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field, replace
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import StudyError
from elastid.section import section
from elastid.units import (
    Angle,
    AngularAcceleration,
    AngularVelocity,
    Damping,
    Inertia,
    InUnit,
    Length,
    Mass,
    Stiffness,
    Torque,
)

Axis: TypeAlias = Literal["x", "y", "z"] | tuple[float, float, float]
Vector3: TypeAlias = tuple[Length, Length, Length]
Angles3: TypeAlias = tuple[Angle, Angle, Angle]
Acceleration3: TypeAlias = tuple[
    Annotated[float, InUnit("m/s^2")], Annotated[float, InUnit("m/s^2")], Annotated[float, InUnit("m/s^2")]
]
InertiaTensor: TypeAlias = (
    Inertia | tuple[Inertia, Inertia, Inertia] | tuple[Inertia, Inertia, Inertia, Inertia, Inertia, Inertia]
)

BASE = "base"
_TENSOR_LETTERS = ("xx", "yy", "zz", "xy", "xz", "yz")
_UNIT_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def unit_axis(axis: Axis) -> FloatArray:
    """A direction (3,) of length one; ValueError for the zero vector."""
    vector = np.array(_UNIT_AXES[axis] if isinstance(axis, str) else axis, dtype=float)
    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise ValueError("an axis is the zero vector; give a direction such as [0, 0, 1] or z")
    return vector / length


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


@section
class Motor:
    """A motor and its gear: inertia and friction on the motor side, ratio = motor turns per joint turn.

    Link side: ratio^2 inertia, ratio^2 viscous, |ratio| coulomb.
    """

    inertia: Inertia
    ratio: float = 1.0
    viscous: Damping = 0.0
    coulomb: Torque = 0.0

    def __post_init__(self) -> None:
        """Refuse what no motor can have."""
        if self.ratio == 0 or not math.isfinite(self.ratio):
            raise ValueError(f"the gear ratio is {self.ratio:g}; it must be a finite number other than 0")
        if not self.inertia > 0:
            raise ValueError(f"the motor's inertia is {self.inertia:g} kg*m^2; it must be positive")
        for name, friction in (("viscous", self.viscous), ("coulomb", self.coulomb)):
            if friction < 0:
                raise ValueError(f"{name} friction is {friction:g}; it must not be negative")


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
    """A rotation about `axis`, with a spring, a motor, both or neither; viscous friction acts across the joint."""

    name: str
    axis: Axis = "z"
    spring: Spring | None = None
    motor: Motor | None = None
    viscous: Damping = 0.0
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        """Check axis and friction."""
        unit_axis(self.axis)
        if self.viscous < 0:
            raise ValueError(f"joint {self.name}: viscous friction is {self.viscous:g}; it must not be negative")

    @property
    def is_flexible(self) -> bool:
        """Driven through an elastic gear: it has a motor coordinate of its own."""
        return self.motor is not None and self.spring is not None


@section
class Placement:
    """Where a body's first joint sits in its parent: translation xyz (m), then roll, pitch, yaw (rad, fixed axes)."""

    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Angles3 = (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> FloatArray:
        """R (3, 3) = Rz(yaw) Ry(pitch) Rx(roll): the body's axes as columns in the parent's."""
        (sr, sp, sy), (cr, cp, cy) = np.sin(self.rpy), np.cos(self.rpy)
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )


@section
class Body:
    """A rigid body: mass, centre of mass in its frame, inertia about the centre of mass.

    inertia: one number (the same about every axis), three (xx, yy, zz) or six (xx, yy, zz, xy, xz, yz; the off-diagonal
    ones are entries of the tensor, not products of inertia with the other sign).
    """

    name: str
    parent: str = BASE
    placement: Placement = field(default_factory=Placement)
    joints: tuple[Joint, ...] = ()
    mass: Mass = 0.0
    center_of_mass: Vector3 = (0.0, 0.0, 0.0)
    inertia: InertiaTensor = 0.0

    def __post_init__(self) -> None:
        """Refuse an inertia that no body can have: principal moments obey I1 <= I2 + I3."""
        if self.mass < 0:
            raise ValueError(f"body {self.name}: the mass is {self.mass:g} kg; it must not be negative")
        principal = np.linalg.eigvalsh(self.inertia_matrix)
        slack = 1e-9 * max(abs(principal).max(), 1e-300)
        if principal[0] < -slack or principal[2] > principal[0] + principal[1] + slack:
            moments = ", ".join(f"{p:.4g}" for p in principal)
            raise ValueError(
                f"body {self.name}: no body has the principal inertias {moments} kg*m^2; each must be positive and at "
                "most the sum of the other two (where it is known about one axis only, give that one number)"
            )

    @property
    def inertia_entries(self) -> dict[str, float]:
        """The inertia's numbers by parameter suffix: '' for the isotropic one, else _xx, _yy ..."""
        if isinstance(self.inertia, tuple):
            return {f"_{letters}": value for letters, value in zip(_TENSOR_LETTERS, self.inertia, strict=False)}
        return {"": self.inertia}

    @property
    def inertia_matrix(self) -> FloatArray:
        """Inertia tensor (3, 3) about the centre of mass, in the body's axes."""
        if not isinstance(self.inertia, tuple):
            return float(self.inertia) * np.eye(3)
        xx, yy, zz, xy, xz, yz = (*self.inertia, 0.0, 0.0, 0.0)[:6]
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)


@section
class Robot:
    """Bodies in any order of listing that names parents first, gravity in the base frame.

    Raises ValueError for names given twice, unknown parents, a robot without a motor.
    """

    name: str
    bodies: tuple[Body, ...]
    gravity: Acceleration3 = (0.0, 0.0, -9.81)
    source: str = ""

    def __post_init__(self) -> None:
        """Check the tree."""
        known = [BASE]
        for body in self.bodies:
            if body.parent not in known:
                raise ValueError(
                    f"body {body.name}: its parent {body.parent} is not listed before it; there are {', '.join(known)}"
                )
            if body.name in known:
                raise ValueError(f"body {body.name} is given twice")
            known.append(body.name)
        names = [joint.name for joint in self.joints]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"joint {name} is given twice")
        if not self.driven:
            raise ValueError(f"robot {self.name}: no joint has a motor; there is nothing to excite")

    @property
    def joints(self) -> tuple[Joint, ...]:
        """All joints, in the order of the tree: the link coordinates q_l."""
        return tuple(joint for body in self.bodies for joint in body.joints)

    @property
    def driven(self) -> tuple[Joint, ...]:
        """The joints with a motor, in order: inputs, and the angles of a configuration."""
        return tuple(joint for joint in self.joints if joint.motor is not None)

    @property
    def flexible(self) -> tuple[Joint, ...]:
        """The joints with motor and spring, in order: the motor coordinates q_m."""
        return tuple(joint for joint in self.joints if joint.is_flexible)

    @property
    def motor_locations(self) -> tuple[str, ...]:
        """`motor <joint>` of each motor: the inputs, and the outputs unless a study says otherwise."""
        return tuple(f"motor {joint.name}" for joint in self.driven)

    def ratio(self, joint: str) -> float:
        """Gear ratio of the motor of a joint; KeyError where it has none."""
        for candidate in self.driven:
            if candidate.name == joint and candidate.motor is not None:
                return candidate.motor.ratio
        raise KeyError(f"joint {joint} has no motor; driven joints: {', '.join(j.name for j in self.driven)}")

    def check_location(self, location: str) -> None:
        """Refuse a place that the robot does not have; StudyError lists those it has."""
        places = [f"motor {j.name}" for j in self.driven] + [f"joint {j.name}" for j in self.joints]
        bodies = [f"body {body.name} {axis}" for body in self.bodies for axis in "xyz"]
        if location not in places + bodies:
            raise StudyError(
                f"'{location}' is not a place on robot {self.name}; there are {', '.join(places + bodies)}"
            )

    def parameters(self) -> dict[str, tuple[float, str]]:
        """Every number with a name: its value and SI unit, in the order joint by joint, then body by body."""
        table: dict[str, tuple[float, str]] = {}
        for joint in self.joints:
            if joint.spring is not None:
                table[f"k_{joint.name}"] = (joint.spring.stiffness, "N*m/rad")
                table[f"d_{joint.name}"] = (joint.spring.damping, "N*m*s/rad")
            table[f"f_{joint.name}"] = (joint.viscous, "N*m*s/rad")
            if joint.motor is not None:
                table[f"Jm_{joint.name}"] = (joint.motor.inertia, "kg*m^2")
                table[f"fm_{joint.name}"] = (joint.motor.viscous, "N*m*s/rad")
        for body in self.bodies:
            table[f"m_{body.name}"] = (body.mass, "kg")
            table |= {f"c_{body.name}_{a}": (c, "m") for a, c in zip("xyz", body.center_of_mass, strict=True)}
            table |= {f"I_{body.name}{suffix}": (v, "kg*m^2") for suffix, v in body.inertia_entries.items()}
        return table

    def with_parameters(self, values: Mapping[str, float]) -> Robot:
        """The same robot with other numbers; StudyError for a name it does not have, ValueError for a bad number."""
        table = self.parameters()
        for name in values:
            if name not in table:
                raise StudyError(f"robot {self.name} has no parameter {name}; there are {', '.join(table)}")
        numbers = {name: value for name, (value, _) in table.items()} | dict(values)
        return replace(self, bodies=tuple(_renumbered(body, numbers) for body in self.bodies))


def _renumbered(body: Body, numbers: Mapping[str, float]) -> Body:
    inertia: Any = tuple(numbers[f"I_{body.name}{suffix}"] for suffix in body.inertia_entries)
    center_of_mass: Any = tuple(numbers[f"c_{body.name}_{a}"] for a in "xyz")
    return replace(
        body,
        joints=tuple(_renumbered_joint(joint, numbers) for joint in body.joints),
        mass=numbers[f"m_{body.name}"],
        center_of_mass=center_of_mass,
        inertia=inertia if isinstance(body.inertia, tuple) else inertia[0],
    )


def _renumbered_joint(joint: Joint, numbers: Mapping[str, float]) -> Joint:
    spring, motor, name = joint.spring, joint.motor, joint.name
    if spring is not None:
        spring = Spring(numbers[f"k_{name}"], numbers[f"d_{name}"])
    if motor is not None:
        motor = replace(motor, inertia=numbers[f"Jm_{name}"], viscous=numbers[f"fm_{name}"])
    return replace(joint, spring=spring, motor=motor, viscous=numbers[f"f_{name}"])
