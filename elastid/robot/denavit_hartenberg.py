r"""Robot from a Denavit-Hartenberg table, in either convention, as bodies and joints.

.. math:: T_i = R_z(\theta_i)\, T_z(d_i)\, T_x(a_i)\, R_x(\alpha_i) \quad (standard), \qquad
          T_i = R_x(\alpha_i)\, T_x(a_i)\, R_z(\theta_i)\, T_z(d_i) \quad (modified)

theta_i = offset_i + q_i for a rotation; d_i + q_i instead of d_i for a translation. Frame i belongs to link i.
(standard or distal: Denavit and Hartenberg 1955, Paul 1981; modified or proximal: Craig 1986, Khalil and Kleinfinger.)
"""

from dataclasses import field
from typing import Annotated, Literal

import numpy as np

from elastid.base.names import Name, OptionalName
from elastid.base.section import Key, section
from elastid.base.units import Angle, Length, Mass
from elastid.robot.body import BASE, TOOL, Body, Frame, InertiaTensor, six_numbers
from elastid.robot.gears import GearCouplings
from elastid.robot.joint import Joint
from elastid.robot.placement import Placement, Vector3
from elastid.robot.robot import Frames, Gravity, OptionalPayload, Robot, RobotTolerances, Source


@section
class Link:
    """One row of the table: the link as a body in its frame i, and the joint that moves it."""

    # fmt: off
    joint: Annotated[Joint, Key("Joint that moves the link, about or along z according to its `motion`.",
        "give it spring, motor and limits; elastic joints without a motor belong to `elastic`.")]
    d: Annotated[Length, Key("Length along z.", "copy it from the table; for a sliding joint it is added to the "
        "position.")] = 0.0
    a: Annotated[Length, Key("Length along x.", "with `modified`, a_(i-1) of row i in Craig's tables; with `standard`, "
        "a of the link itself.")] = 0.0
    alpha: Annotated[Angle, Key("Angle about x.", "the rotation comes before the joint with `modified`, behind it with "
        "`standard`; write the unit deg after degrees.")] = 0.0
    offset: Annotated[Angle, Key("Angle added to the joint angle.", "for tables whose zero differs from the "
        "controller's, such as -90 deg for an upright second axis.")] = 0.0
    mass: Annotated[Mass, Key("Mass of the link.", "from CAD or the manual; an error of ten percent causes ten percent "
        "in stiffness, since inertia sets the scale.")] = 0.0
    center_of_mass: Annotated[Vector3, Key("Centre of mass in the frame of the link.", "convert it from the "
        "manufacturer's frame.")] = (0.0, 0.0, 0.0)
    inertia: Annotated[InertiaTensor, Key("Inertia, as for a body, about the point of inertia_about.",
        "three numbers if the axes are nearly principal; 0 for a point mass.")] = 0.0
    elastic: Annotated[tuple[Joint, ...], Key("Further elastic joints behind the driven joint, in axes that share its "
        "z axis.", "bearing and link bending behind the gear, mostly two joints across the driven axis.")] = ()
    name: Annotated[OptionalName, Key("Name of the body (default: name of the joint).", "if messages should read "
        "`upper arm` instead of the joint's number.")] = ""
    # fmt: on

    def __post_init__(self) -> None:
        if self.joint.axis != "z":
            raise ValueError(
                f"joint {self.joint.name}: its axis is z by convention, not {self.joint.axis}; leave it out"
            )
        for key, angle in (("alpha", self.alpha), ("offset", self.offset)):
            if abs(angle) > 2 * np.pi:
                raise ValueError(
                    f"joint {self.joint.name}: {key} is {angle:g} rad, more than a turn; write '{angle:g} deg' if that "
                    "is meant"
                )

    @property
    def body_name(self) -> str:
        """The name of the link as a body."""
        return self.name or self.joint.name


@section
class DenavitHartenberg:
    """A serial robot as a table of links, from the base to the tool."""

    # fmt: off
    name: Annotated[Name, Key("Name of the robot.", "choose a new name for each set of numbers, since results quote "
        "it.")]
    convention: Annotated[Literal["standard", "modified"], Key("Convention of the Denavit-Hartenberg table, `standard` "
        "or `modified`.", "`modified` (Craig) if the rotation alpha comes first in a row, `standard` if it comes "
        "last.")]
    links: Annotated[tuple[Link, ...], Key("Rows of the table, from the base to the tool.", "one row per driven joint; "
        "write elastic joints inside the rows.", filled=True)]
    base: Annotated[Placement, Key("Placement of frame 0 in the base.", "for robots on a pedestal, a wall or a "
        "ceiling; gravity stays in the base frame.")] = field(default_factory=Placement)
    tool: Annotated[Placement, Key("Placement of the tool in the frame of the last link; it defines the robot's frame "
        "`tool`.", "the flange, or the tip that carries sensors.")] = field(default_factory=Placement)
    inertia_about: Annotated[Literal["center_of_mass", "origin"], Key("Reference point of the links' inertia tensors: "
        "the centre of mass or the origin of the link's frame.", "`origin` for tables of dynamic parameters, which "
        "already include m c^2.")] = "center_of_mass"
    gravity: Gravity = (0.0, 0.0, -9.81)
    source: Source = ""
    frames: Frames = ()
    payload: OptionalPayload = None
    gears: GearCouplings = ()
    tolerances: RobotTolerances = None
    # fmt: on

    def __post_init__(self) -> None:
        self.robot()

    def robot(self) -> Robot:
        """Return the robot as bodies and joints."""
        bodies, parent, last = [], BASE, self.base
        for link in self.links:
            bodies.append(self._body(link, parent, last))
            parent, last = link.body_name, Placement()
        frames = (Frame(TOOL, parent, self.tool), *self.frames)
        fields = self.name, tuple(bodies), self.gravity, self.source, frames, self.payload
        return Robot(*fields, gears=self.gears, tolerances=self.tolerances)

    def _body(self, link: Link, parent: str, before: Placement) -> Body:
        """Return the link as a body.  before: placement of frame i - 1 in its body, identity except for the base."""
        turn = Placement(rpy=(0.0, 0.0, link.offset))
        across = Placement((link.a, 0.0, 0.0), (link.alpha, 0.0, 0.0))
        along = Placement((0.0, 0.0, link.d))
        standard = self.convention == "standard"
        placement = before if standard else before.then(across)
        mounting = turn.then(along, across) if standard else turn.then(along)
        contents = (link.joint, *link.elastic), link.mass, link.center_of_mass, self._inertia(link)
        return Body(link.body_name, parent, placement, *contents, mounting)

    def _inertia(self, link: Link) -> InertiaTensor:
        if self.inertia_about == "center_of_mass":
            return link.inertia
        c = np.array(link.center_of_mass)
        about_origin = Body(link.body_name, inertia=link.inertia).inertia_matrix
        return six_numbers(about_origin - link.mass * (c @ c * np.eye(3) - np.outer(c, c)))
