"""Rigid bodies, the frames fixed to them, and the payload that one of them carries."""

from __future__ import annotations

from dataclasses import field
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.section import section
from elastid.base.units import Inertia, Mass
from elastid.robot.joint import Joint
from elastid.robot.named_numbers import Numbers, coordinates
from elastid.robot.placement import Placement, Vector3

InertiaTensor: TypeAlias = (
    Inertia | tuple[Inertia, Inertia, Inertia] | tuple[Inertia, Inertia, Inertia, Inertia, Inertia, Inertia]
)

BASE = "base"
PAYLOAD = "payload"
# The frame that a payload is fixed to unless said otherwise; its Jacobian shows singular postures.
TOOL = "tool"
_TENSOR_LETTERS = ("xx", "yy", "zz", "xy", "xz", "yz")


@section
class Body:
    """A rigid body: mass, centre of mass in its frame, inertia about the centre of mass.

    name: ends the names of its parameters (m_arm).  parent: the body that carries it.  placement: of its first joint in
    the parent's frame.  joints: from the parent to the body, in this order.  mass: with rotors that ride on it.
    center_of_mass: in the body's frame.  inertia: one number (the same about every axis), three (xx, yy, zz) or six
    (xx, yy, zz, xy, xz, yz; the off-diagonal ones are entries of the tensor, not products of inertia with the other
    sign).
    mounting: of its own frame behind its last joint.
    """

    name: str
    parent: str = BASE
    placement: Placement = field(default_factory=Placement)
    joints: tuple[Joint, ...] = ()
    mass: Mass = 0.0
    center_of_mass: Vector3 = (0.0, 0.0, 0.0)
    inertia: InertiaTensor = 0.0
    mounting: Placement = field(default_factory=Placement)

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

    @property
    def numbers(self) -> Numbers:
        """m_, c_ and I_ of the body."""
        places: Numbers = {f"m_{self.name}": ("kg", ("mass",))}
        places |= coordinates(f"c_{self.name}", ("center_of_mass",))
        tensor = isinstance(self.inertia, tuple)
        for i, suffix in enumerate(self.inertia_entries):
            places[f"I_{self.name}{suffix}"] = ("kg*m^2", ("inertia", i) if tensor else ("inertia",))
        return places

    @property
    def geometry(self) -> Numbers:
        """p_: where its first joint is in the parent's frame."""
        return coordinates(f"p_{self.name}", ("placement", "xyz"))


@section
class Frame:
    """A frame fixed to a body.

    name: by which outputs and the payload refer to it.  body: that it is fixed to.  placement: in the body's frame.
    """

    name: str
    body: str
    placement: Placement = field(default_factory=Placement)


@section
class Payload:
    """A body called `payload`, fixed to a frame or body.

    mass: of the payload.  center_of_mass: in the axes of its seat.  inertia: about the centre of mass, as a body's.
    at: the frame or body that it is fixed to.
    """

    mass: Mass
    center_of_mass: Vector3 = (0.0, 0.0, 0.0)
    inertia: InertiaTensor = 0.0
    at: str = TOOL

    def __post_init__(self) -> None:
        """Checked as a body."""
        self.body("", Placement())

    def body(self, parent: str, placement: Placement) -> Body:
        """The payload as a body, where it is carried."""
        return Body(PAYLOAD, parent, placement, (), self.mass, self.center_of_mass, self.inertia)

    @property
    def numbers(self) -> Numbers:
        """m_payload, c_payload_x ..., I_payload."""
        return self.body("", Placement()).numbers
