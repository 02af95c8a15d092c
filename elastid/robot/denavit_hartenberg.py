r"""A robot given by Denavit and Hartenberg's parameters, in either convention, as bodies and joints.

.. math:: T_i = R_z(\theta_i)\, T_z(d_i)\, T_x(a_i)\, R_x(\alpha_i) \quad (standard), \qquad
          T_i = R_x(\alpha_i)\, T_x(a_i)\, R_z(\theta_i)\, T_z(d_i) \quad (modified)

theta_i = offset_i + q_i where the joint turns, d_i + q_i instead of d_i where it slides. Frame i is that of link i.
(standard or distal: Denavit and Hartenberg 1955, Paul 1981; modified or proximal: Craig 1986, Khalil and Kleinfinger.)
"""

from __future__ import annotations

from dataclasses import field
from typing import Literal

import numpy as np

from elastid.base.section import section
from elastid.base.units import Angle, Length, Mass
from elastid.robot.body import BASE, TOOL, Body, Frame, InertiaTensor, Payload
from elastid.robot.joint import Joint
from elastid.robot.placement import Acceleration3, Placement, Vector3
from elastid.robot.robot import Robot


@section
class Link:
    """One row of the table, the joint that moves the link, and the link as a body in its frame i.

    joint: about or along z; its `motion` says which.
    d, a: lengths along z and along x.  alpha: angle about x.  offset: added to the joint's angle.
    mass: of the link.  center_of_mass: in its frame.  inertia: as that of a body, about the point that inertia_about
    names.
    elastic: further joints right behind it, in axes that have z in common with it.
    name: of the body; default: that of the joint.
    """

    joint: Joint
    d: Length = 0.0
    a: Length = 0.0
    alpha: Angle = 0.0
    offset: Angle = 0.0
    mass: Mass = 0.0
    center_of_mass: Vector3 = (0.0, 0.0, 0.0)
    inertia: InertiaTensor = 0.0
    elastic: tuple[Joint, ...] = ()
    name: str = ""

    def __post_init__(self) -> None:
        """Refuse an axis: in these conventions it is z."""
        if self.joint.axis != "z":
            raise ValueError(
                f"joint {self.joint.name}: its axis is z by convention, not {self.joint.axis}; leave it out"
            )

    @property
    def body_name(self) -> str:
        """The name of the link as a body."""
        return self.name or self.joint.name


@section
class DenavitHartenberg:
    """A serial robot as a table of links, from the base to the tool.

    name: of the robot.  convention: `standard` or `modified`.  links: the rows, from the base to the tool.
    inertia_about: reference point of the links' inertia tensors, the centre of mass or the origin of the link's frame.
    base: frame 0 in the base.  tool: in the last link's frame; it becomes the robot's frame `tool`.
    gravity: acceleration in the base frame.  source: where the numbers come from; free text.  frames: further named
    frames.
    payload: carried at one of them.
    """

    name: str
    convention: Literal["standard", "modified"]
    links: tuple[Link, ...]
    base: Placement = field(default_factory=Placement)
    tool: Placement = field(default_factory=Placement)
    inertia_about: Literal["center_of_mass", "origin"] = "center_of_mass"
    gravity: Acceleration3 = (0.0, 0.0, -9.81)
    source: str = ""
    frames: tuple[Frame, ...] = ()
    payload: Payload | None = None

    def __post_init__(self) -> None:
        """Refuse an empty table, and rows that make no robot."""
        if not self.links:
            raise ValueError("links is empty; give a row for each joint, from the base to the tool")
        self.robot()

    def robot(self) -> Robot:
        """The same robot as bodies and joints."""
        bodies, parent, last = [], BASE, self.base
        for link in self.links:
            bodies.append(self._body(link, parent, last))
            parent, last = link.body_name, Placement()
        frames = (Frame(TOOL, parent, self.tool), *self.frames)
        return Robot(self.name, tuple(bodies), self.gravity, self.source, frames, self.payload)

    def _body(self, link: Link, parent: str, before: Placement) -> Body:
        """The link as a body.  before: placement of frame i - 1 in its body, the identity but for the base."""
        turn = Placement(rpy=(0.0, 0.0, link.offset))
        across = Placement((link.a, 0.0, 0.0), (link.alpha, 0.0, 0.0))
        along = Placement((0.0, 0.0, link.d))
        standard = self.convention == "standard"
        return Body(
            name=link.body_name,
            parent=parent,
            placement=before if standard else _chained(before, across),
            joints=(link.joint, *link.elastic),
            mass=link.mass,
            center_of_mass=link.center_of_mass,
            inertia=self._inertia(link),
            mounting=_chained(turn, along, across) if standard else _chained(turn, along),
        )

    def _inertia(self, link: Link) -> InertiaTensor:
        if self.inertia_about == "center_of_mass":
            return link.inertia
        c = np.array(link.center_of_mass)
        tensor = Body("", inertia=link.inertia).inertia_matrix - link.mass * (c @ c * np.eye(3) - np.outer(c, c))
        xx, yy, zz, xy, xz, yz = (float(tensor[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        return xx, yy, zz, xy, xz, yz


def _chained(*placements: Placement) -> Placement:
    """The placements one after the other."""
    R, p = np.eye(3), np.zeros(3)
    for placement in placements:
        R, p = R @ placement.rotation, p + R @ np.array(placement.xyz)
    return Placement.of(R, p)
