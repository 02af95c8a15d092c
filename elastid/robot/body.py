"""Rigid bodies, frames fixed to bodies, and the payload."""

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
TOOL = "tool"  # default frame of a payload
TENSOR_LETTERS = ("xx", "yy", "zz", "xy", "xz", "yz")
# Index of the entries of a symmetric tensor in TENSOR_LETTERS.
TENSOR = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


def six_numbers(tensor: FloatArray) -> tuple[float, float, float, float, float, float]:
    """Return xx, yy, zz, xy, xz, yz of a symmetric tensor (3, 3)."""
    xx, yy, zz, xy, xz, yz = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist()
    return xx, yy, zz, xy, xz, yz


def with_possible_moments(tensor: FloatArray) -> FloatArray:
    """Increase the smaller principal inertias of a tensor (3, 3) so that they satisfy the triangle inequality.

    Unchanged if one is negative, or if the increase exceeds a tenth of the largest, the typical tolerance.
    """
    principal, axes = np.linalg.eigh(tensor)
    deficit = principal[2] - principal[0] - principal[1]
    if principal[0] < 0 or not 0 < deficit <= 0.2 * principal[2]:
        return tensor
    return np.asarray(axes @ np.diag(principal + deficit / 2 * np.array([1, 1, 0])) @ axes.T)


@section
class Body:
    """Rigid body: mass, centre of mass in its frame, inertia about the centre of mass, and joints from its parent.

    The parameters are keys of `robot.bodies[]`.

    Raises
    ------
    ValueError
        For an inertia that no rigid body has.

    Examples
    --------
    >>> Body("arm", joints=(Joint("1"),), mass=10.0, inertia=(0.1, 0.2, 0.2)).inertia_matrix.diagonal().tolist()
    [0.1, 0.2, 0.2]
    """

    # fmt: off
    name: Annotated[PartName, Key("Name of the body, used in the names of its parameters (m_arm).", "choose a short "
        "name without blanks.")]
    parent: Annotated[str, Key("Name of the parent body.", "the previous body of the chain; two bodies with one parent "
        "form a branch.")] = BASE
    placement: Annotated[Placement, Key("Placement of the first joint in the frame of the parent.", "measure it from "
        "the parent's joint with all angles at zero.")] = field(default_factory=Placement)
    joints: Annotated[tuple[Joint, ...], Key("Joints from the parent to the body, in this order.", "the driven joint "
        "first, then elastic joints: bearing tilt, then bending.")] = ()
    mass: Annotated[Mass, Key("Mass of the body, including motors that it carries.", "from CAD; it sets the scale of "
        "all stiffnesses and is fixed unless fit.parameters names m_NAME with a prior.", least=0)] = 0.0
    center_of_mass: Annotated[Vector3, Key("Centre of mass in the frame of the body.", "check it with holding torques "
        "of two postures.")] = (0.0, 0.0, 0.0)
    inertia: Annotated[InertiaTensor, Key("Inertia about the centre of mass: one number (isotropic), three (xx, yy, "
        "zz) or six (xx, yy, zz, xy, xz, yz, as entries of the tensor).", "six numbers from CAD; change the sign of "
        "off-diagonal values that CAD states as products of inertia.")] = 0.0
    mounting: Annotated[Placement, Key("Placement of the body's own frame behind its last joint.", "if the next frame "
        "does not start at the last joint, such as the flange of a bent link.")] = field(default_factory=Placement)
    # fmt: on

    # Messages begin with the key at fault, at whose line a study shows them.
    def __post_init__(self) -> None:
        principal = np.linalg.eigvalsh(self.inertia_matrix)
        slack = 1e-9 * abs(principal).max() + 1e-15  # rounding errors, also of a rotated zero tensor
        if principal[0] < -slack or principal[2] > principal[0] + principal[1] + slack:
            moments = ", ".join(f"{p:.4g}" for p in principal)
            raise ValueError(
                f"inertia of body {self.name}: the principal inertias {moments} kg*m^2 are impossible. Each must be "
                "positive and at most the sum of the other two. If you know one axis only, give one number"
            )

    @property
    def inertia_entries(self) -> dict[str, float]:
        """Entries of the inertia by parameter suffix: '' for an isotropic inertia, else _xx, _yy, ..."""
        if isinstance(self.inertia, tuple):
            return {f"_{letters}": value for letters, value in zip(TENSOR_LETTERS, self.inertia, strict=False)}
        return {"": self.inertia}

    @property
    def inertia_matrix(self) -> FloatArray:
        """Inertia tensor (3, 3) about the centre of mass, in the body's axes."""
        if not isinstance(self.inertia, tuple):
            return float(self.inertia) * np.eye(3)
        return np.asarray(np.array((*self.inertia, 0.0, 0.0, 0.0), dtype=float)[TENSOR])

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
        """p_: location of the first joint in the parent's frame."""
        return coordinates(f"p_{self.name}", ("placement", "xyz"))


@section
class Frame:
    """A frame fixed to a body."""

    # fmt: off
    name: Annotated[PartName, Key("Name of the frame for outputs and the payload.", "`tool` for the tool, otherwise "
        "the sensor's name; outputs are then `frame NAME z`.")]
    body: Annotated[str, Key("Name of the body to which the frame is fixed.", "the body that carries the sensor; on "
        "the wrong side of an elastic joint its deflection is missing.")]
    placement: Annotated[Placement, Key("Placement in the frame of the body.", "measure up to the origin of the "
        "sensor: an error of 10 cm changes the acceleration of a rotating arm.")] = field(default_factory=Placement)


@section
class Payload:
    """A body called `payload`, fixed to a frame or body."""

    # fmt: off
    mass: Annotated[Mass, Key("Mass of the payload.", "weigh it; measurements with and without it separate masses from "
        "stiffnesses.")]
    center_of_mass: Annotated[Vector3, Key("Centre of mass in the frame to which the payload is fixed.", "1 cm is "
        "significant for wrist axes and negligible for the first three axes.")] = (0.0, 0.0, 0.0)
    inertia: Annotated[InertiaTensor, Key("Inertia about the centre of mass, as for a body.", "for tools longer than "
        "about 20 cm; a smaller tool is a point mass.")] = 0.0
    at: Annotated[str, Key("Name of the frame or body to which the payload is fixed.", "the frame of the flange; "
        "without a frame `tool`, the last body.")] = TOOL
    # fmt: on

    def __post_init__(self) -> None:
        self.body("", Placement())

    def body(self, parent: str, placement: Placement) -> Body:
        """Return the payload as a body of a parent."""
        return Body(PAYLOAD, parent, placement, (), self.mass, self.center_of_mass, self.inertia)

    @property
    def numbers(self) -> Numbers:
        """m_payload, c_payload_x ..., I_payload."""
        return self.body("", Placement()).numbers
