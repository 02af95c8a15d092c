r"""A robot given by Denavit and Hartenberg's parameters, in either convention, as bodies and joints.

.. math:: T_i = R_z(\theta_i)\, T_z(d_i)\, T_x(a_i)\, R_x(\alpha_i) \quad (standard), \qquad
          T_i = R_x(\alpha_i)\, T_x(a_i)\, R_z(\theta_i)\, T_z(d_i) \quad (modified)

theta_i = offset_i + q_i where the joint turns, d_i + q_i instead of d_i where it slides. Frame i is that of link i.
(standard or distal: Denavit and Hartenberg 1955, Paul 1981; modified or proximal: Craig 1986, Khalil and Kleinfinger.)
"""

from dataclasses import field
from typing import Annotated, Literal

import numpy as np

from elastid.base.names import Name, OptionalName
from elastid.base.section import Key, section
from elastid.base.units import Angle, Length, Mass
from elastid.robot.body import BASE, TOOL, Body, Frame, InertiaTensor, Payload, six_numbers
from elastid.robot.joint import Joint
from elastid.robot.placement import Acceleration3, Placement, Vector3
from elastid.robot.robot import Robot
from elastid.robot.tolerances import FileTolerances


@section
class Link:
    """One row of the table, the joint that moves the link, and the link as a body in its frame i."""

    # fmt: off
    joint: Annotated[Joint, Key("Joint that moves the link, about or along z; its `motion` says which.", "names the "
        "spring, motor and limits; elastic joints that nothing drives belong into `elastic`.")]
    d: Annotated[Length, Key("Length along z.", "straight from the table; of a sliding joint it is added to the "
        "position.")] = 0.0
    a: Annotated[Length, Key("Length along x.", "with `modified` the a_(i-1) of row i in Craig's tables; with "
        "`standard` the one of the link itself.")] = 0.0
    alpha: Annotated[Angle, Key("Angle about x.", "with `modified` it turns before the joint, with `standard` behind "
        "it; give deg with its unit.")] = 0.0
    offset: Annotated[Angle, Key("Angle that is added to the joint's.", "for tables whose zero is not the "
        "controller's, such as -90 deg for an upright second axis.")] = 0.0
    mass: Annotated[Mass, Key("Mass of the link.", "from CAD or the manual; an error of ten percent is one of ten "
        "percent in stiffness, since inertia sets the scale.")] = 0.0
    center_of_mass: Annotated[Vector3, Key("Centre of mass in the link's frame.", "convert from the maker's frame; "
        "only its distance from the axes counts for stiffness, its direction for gravity.")] = (0.0, 0.0, 0.0)
    inertia: Annotated[InertiaTensor, Key("Inertia as that of a body, about the point that inertia_about names.",
        "three numbers suffice where the axes are nearly principal; 0 for a point mass.")] = 0.0
    elastic: Annotated[tuple[Joint, ...], Key("Further elastic joints right behind it, in axes that have z in common "
        "with it.", "bearings and link bending, behind the gear; the commonest are two, across the driven axis.")] = ()
    name: Annotated[OptionalName, Key("Name of the body; default: that of the joint.", "where a message should say "
        "`upper arm` in place of a joint's number.")] = ""
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
    name: Annotated[Name, Key("Name of the robot.", "a new one for each set of numbers, since results quote it.")]
    convention: Annotated[Literal["standard", "modified"], Key("Convention of the Denavit-Hartenberg table, `standard` "
        "or `modified`.", "`modified` (Craig) where the rotation alpha comes first in a row, `standard` where last; a "
        "mix of both gives a robot that looks right at zero only.")]
    links: Annotated[tuple[Link, ...], Key("Rows of the table, from the base to the tool.", "one row per driven joint, "
        "in order; elastic joints are written inside the rows.")]
    base: Annotated[Placement, Key("Placement of frame 0 in the base.", "for robots on a pedestal, a wall or upside "
        "down; gravity stays in the base frame.")] = field(default_factory=Placement)
    tool: Annotated[Placement, Key("Placement of the tool in the last link's frame; it becomes the robot's frame "
        "`tool`.", "the flange's frame, or the tip where sensors sit.")] = field(default_factory=Placement)
    inertia_about: Annotated[Literal["center_of_mass", "origin"], Key("Reference point of the links' inertia tensors: "
        "the centre of mass or the origin of the link's frame.", "`origin` for tables of dynamic parameters, which "
        "hold m c^2 already; a wrong choice counts it twice or not at all.")] = "center_of_mass"
    gravity: Annotated[Acceleration3, Key("Acceleration of gravity in the base frame.", "turn it for a robot on a wall "
        "or the ceiling, or tilt the base instead, not both.")] = (0.0, 0.0, -9.81)
    source: Annotated[str, Key("Source of the robot's numbers, as free text.", "cite paper, file and table, and say "
        "which numbers are made up.")] = ""
    frames: Annotated[tuple[Frame, ...], Key("Further named frames fixed to bodies.", "one for every accelerometer or "
        "marker whose motion is logged.")] = ()
    payload: Annotated[Payload | None, Key("Load that the robot carries at one of its frames or bodies.", "whatever "
        "hung at the flange when the data was taken.")] = None
    tolerances: Annotated[FileTolerances, Key("Tolerances of the table's numbers that a fit holds, {} for common ones, "
        "or `exact` (default as for a robot of bodies).", "a length exact and masses to 3 % for a table from a "
        "calibration and a data sheet; wide ones for tables of papers, whose origin is rarely said.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if not self.links:
            raise ValueError("links is empty; give a row for each joint, from the base to the tool")
        self.robot()

    def robot(self) -> Robot:
        """Robot as bodies and joints."""
        bodies, parent, last = [], BASE, self.base
        for link in self.links:
            bodies.append(self._body(link, parent, last))
            parent, last = link.body_name, Placement()
        frames = (Frame(TOOL, parent, self.tool), *self.frames)
        described = self.name, tuple(bodies), self.gravity, self.source, frames, self.payload
        return Robot(*described, tolerances=self.tolerances)

    def _body(self, link: Link, parent: str, before: Placement) -> Body:
        """The link as a body.  before: placement of frame i - 1 in its body, the identity but for the base."""
        turn = Placement(rpy=(0.0, 0.0, link.offset))
        across = Placement((link.a, 0.0, 0.0), (link.alpha, 0.0, 0.0))
        along = Placement((0.0, 0.0, link.d))
        standard = self.convention == "standard"
        placement = before if standard else _chained(before, across)
        mounting = _chained(turn, along, across) if standard else _chained(turn, along)
        contents = (link.joint, *link.elastic), link.mass, link.center_of_mass, self._inertia(link)
        return Body(link.body_name, parent, placement, *contents, mounting)

    def _inertia(self, link: Link) -> InertiaTensor:
        if self.inertia_about == "center_of_mass":
            return link.inertia
        c = np.array(link.center_of_mass)
        about_origin = Body(link.body_name, inertia=link.inertia).inertia_matrix
        return six_numbers(about_origin - link.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def _chained(*placements: Placement) -> Placement:
    R, p = np.eye(3), np.zeros(3)
    for placement in placements:
        R, p = R @ placement.rotation, p + R @ np.array(placement.xyz)
    return Placement.of(R, p)
