"""Rigid bodies, the frames fixed to them, and the payload that one of them carries."""

from dataclasses import field
from typing import Annotated, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.names import PartName
from elastid.base.section import Key, section
from elastid.base.units import Inertia, Mass
from elastid.robot.joint import Joint
from elastid.robot.placement import Numbers, Placement, Vector3, coordinates

InertiaTensor: TypeAlias = (
    Inertia | tuple[Inertia, Inertia, Inertia] | tuple[Inertia, Inertia, Inertia, Inertia, Inertia, Inertia]
)

BASE = "base"
PAYLOAD = "payload"
# The frame that a payload is fixed to unless said otherwise.
TOOL = "tool"
TENSOR_LETTERS = ("xx", "yy", "zz", "xy", "xz", "yz")


def six_numbers(tensor: FloatArray) -> tuple[float, float, float, float, float, float]:
    """xx, yy, zz, xy, xz, yz of a symmetric tensor (3, 3)."""
    xx, yy, zz, xy, xz, yz = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist()
    return xx, yy, zz, xy, xz, yz


@section
class Body:
    """A rigid body: mass, centre of mass in its frame, inertia about the centre of mass."""

    # fmt: off
    name: Annotated[PartName, Key("Name of the body, which ends the names of its parameters (m_arm).", "short and "
        "without blanks is easiest, since parameters end in it.")]
    parent: Annotated[str, Key("Name of the body that carries it.", "the body before it in the chain; two bodies with "
        "one parent branch.")] = BASE
    placement: Annotated[Placement, Key("Placement of its first joint in the parent's frame.", "the joint's place as "
        "measured from the parent's joint at zero angles.")] = field(default_factory=Placement)
    joints: Annotated[tuple[Joint, ...], Key("Joints from the parent to the body, in this order.", "the driven joint "
        "first, then elastic ones: bearing tilt, then bending.")] = ()
    mass: Annotated[Mass, Key("Mass of the body, with the rotors that ride on it.", "from CAD; the fit keeps it, "
        "unless m_NAME is named with a prior, as it sets the scale of all stiffnesses.", least=0)] = 0.0
    center_of_mass: Annotated[Vector3, Key("Centre of mass in the body's frame.", "gravity's torque at rest checks it: "
        "compare holding torques of two postures.")] = (0.0, 0.0, 0.0)
    inertia: Annotated[InertiaTensor, Key("Inertia about the centre of mass: one number (the same about every axis), "
        "three (xx, yy, zz) or six (xx, yy, zz, xy, xz, yz; the off-diagonal ones are entries of the tensor, not "
        "products of inertia with the other sign).", "six numbers where CAD gives them; mind the sign of the "
        "off-diagonal ones.")] = 0.0
    mounting: Annotated[Placement, Key("Placement of the body's own frame behind its last joint.", "where the next "
        "frame does not begin at the last joint, such as the flange of a bent "
        "link.")] = field(default_factory=Placement)
    # fmt: on

    # Messages begin with the key at fault, at whose line a study shows them.
    def __post_init__(self) -> None:
        principal = np.linalg.eigvalsh(self.inertia_matrix)
        slack = 1e-9 * max(abs(principal).max(), 1e-300)
        if principal[0] < -slack or principal[2] > principal[0] + principal[1] + slack:
            moments = ", ".join(f"{p:.4g}" for p in principal)
            raise ValueError(
                f"inertia of body {self.name}: no body has the principal inertias {moments} kg*m^2; each must be "
                "positive and at most the sum of the other two (where it is known about one axis only, give that one "
                "number)"
            )

    @property
    def inertia_entries(self) -> dict[str, float]:
        """The inertia's numbers by parameter suffix: '' for the isotropic one, else _xx, _yy ..."""
        if isinstance(self.inertia, tuple):
            return {f"_{letters}": value for letters, value in zip(TENSOR_LETTERS, self.inertia, strict=False)}
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
    """A frame fixed to a body."""

    # fmt: off
    name: Annotated[PartName, Key("Name of the frame, by which outputs and the payload refer to it.", "`tool` for the "
        "tip, else what the sensor is called; outputs are then `frame NAME z`.")]
    body: Annotated[str, Key("Name of the body that it is fixed to.", "the body behind whose joints the sensor sits; "
        "the wrong side of an elastic joint misses its bending.")]
    placement: Annotated[Placement, Key("Placement in the body's frame.", "measure to the sensor's own origin: 10 cm "
        "off on a swinging arm is the acceleration of another place.")] = field(default_factory=Placement)


@section
class Payload:
    """A body called `payload`, fixed to a frame or body."""

    # fmt: off
    mass: Annotated[Mass, Key("Mass of the payload.", "weigh it; unlike links it can be changed to separate masses "
        "from stiffnesses.")]
    center_of_mass: Annotated[Vector3, Key("Centre of mass in the axes of the frame or body that carries it.",
        "1 cm matters for wrists, hardly for the first three axes.")] = (0.0, 0.0, 0.0)
    inertia: Annotated[InertiaTensor, Key("Inertia about the centre of mass, as a body's.", "for tools longer than "
        "about 20 cm; small ones are points.")] = 0.0
    at: Annotated[str, Key("Name of the frame or body that it is fixed to.", "the flange's frame; without a frame "
        "`tool` name the last body.")] = TOOL
    # fmt: on

    def __post_init__(self) -> None:
        self.body("", Placement())

    def body(self, parent: str, placement: Placement) -> Body:
        """The payload as a body, where it is carried."""
        return Body(PAYLOAD, parent, placement, (), self.mass, self.center_of_mass, self.inertia)

    @property
    def numbers(self) -> Numbers:
        """m_payload, c_payload_x ..., I_payload."""
        return self.body("", Placement()).numbers
