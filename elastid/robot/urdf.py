"""Robot from a URDF file, with springs, motors and other properties from the robot model.

Links become bodies; a fixed link without mass, or on the base, becomes a frame. Revolute, continuous, prismatic and
fixed joints are read, with their damping and limits; the effort is the torque limit on the link side.
"""

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal
from xml.parsers import expat

import numpy as np

from elastid.base.errors import StudyError
from elastid.base.names import SEPARATOR, NameRule, OptionalName, check_different
from elastid.base.section import Key, section
from elastid.base.units import Damping
from elastid.robot.body import BASE, TENSOR, TENSOR_LETTERS, Body, Frame, six_numbers, with_possible_moments
from elastid.robot.gears import GearCouplings
from elastid.robot.joint import Joint, Limits, OptionalMotor, OptionalSpring
from elastid.robot.placement import Placement
from elastid.robot.robot import Frames, Gravity, OptionalPayload, Robot, RobotTolerances, Source

_RULE = NameRule(without=SEPARATOR)


@dataclass(frozen=True)
class UrdfElement:
    """XML element of the file with its location."""

    tag: str
    attributes: Mapping[str, str]
    path: Path
    line: int
    children: "list[UrdfElement]" = field(default_factory=list)

    def all(self, tag: str) -> "Iterator[UrdfElement]":
        """Return the child elements with a tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> "UrdfElement | None":
        """Return the first child element with a tag; None without one."""
        return next(self.all(tag), None)

    def wrong(self, message: str) -> StudyError:
        """Return an error with the location of the element."""
        return StudyError("robot/file", message, f"{self.path}:{self.line}")

    def text(self, key: str) -> str:
        """Return an attribute; StudyError if it is missing."""
        if key not in self.attributes:
            raise self.wrong(f"<{self.tag}> needs {key}")
        return self.attributes[key]

    @property
    def name(self) -> str:
        """Attribute `name`; StudyError if it is missing or invalid."""
        name = self.text("name")
        try:
            return _RULE.check(name)
        except ValueError as error:
            raise self.wrong(str(error)) from None

    def numbers(self, key: str, count: int, default: str | None = None) -> tuple[float, ...]:
        """Return `count` finite numbers of an attribute; StudyError for anything else."""
        text = self.text(key) if default is None else self.attributes.get(key, default)
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError:
            values = ()
        if len(values) != count or not all(map(math.isfinite, values)):
            raise self.wrong(f"{key} of <{self.tag}> must be {count} finite numbers (got '{text}')")
        return values

    def number(self, key: str, default: str | None = None) -> float:
        """Return one finite number of an attribute; StudyError for anything else."""
        return self.numbers(key, 1, default)[0]


def read_elements(path: Path) -> UrdfElement:
    """Read the root of a file; StudyError with `file:line` for invalid XML or a DOCTYPE (it could define entities)."""
    stack = [UrdfElement("", {}, path, 1)]
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = UrdfElement(tag, attributes, path, parser.CurrentLineNumber)
        stack[-1].children.append(element)
        stack.append(element)

    def doctype(*_: object) -> None:
        raise StudyError(
            "robot/file",
            "a URDF has no DOCTYPE; remove it (expand a xacro first)",
            f"{path}:{parser.CurrentLineNumber}",
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(path.read_bytes(), True)
    except expat.ExpatError as error:
        raise StudyError("robot/file", f"not XML: {expat.ErrorString(error.code)}", f"{path}:{error.lineno}") from None
    return stack[0].children[0]


_MOVING: dict[str, Literal["rotation", "translation"]] = {
    "revolute": "rotation", "continuous": "rotation", "prismatic": "translation"
}  # fmt: skip


@section
class UrdfJoint:
    """Properties of a joint that a URDF does not contain."""

    # fmt: off
    spring: OptionalSpring = None
    motor: OptionalMotor = None
    elastic: Annotated[tuple[Joint, ...], Key("Further elastic joints behind the joint, in the axes of the link.",
        "for bending and bearing tilt, which the URDF does not contain.")] = ()
    viscous: Annotated[Damping | None, Key("Viscous friction (default: damping of the URDF file).", "if the damping in "
        "the URDF is a placeholder for simulators, which is common.")] = None
    limits: Annotated[Limits | None, Key("Limits (default: limits of the URDF file).", "if the cell or the test allows "
        "less than the URDF file.")] = None


@section
class UrdfRobot:
    """A URDF file with the properties that it does not contain."""

    # fmt: off
    urdf: Annotated[str, Key("Path of the URDF file, relative to this file.", "expand xacro files to plain URDF "
        "first.")]
    joints: Annotated[dict[str, UrdfJoint], Key("Properties of all movable joints, by their names in the URDF.",
        "list every movable joint, at least as {}; motors and springs are added here.")]
    name: Annotated[OptionalName, Key("Name of the robot (default: name in the URDF).", "if two robots of one type "
        "need different names.")] = ""
    gravity: Gravity = (0.0, 0.0, -9.81)
    source: Source = ""
    frames: Frames = ()
    payload: OptionalPayload = None
    gears: GearCouplings = ()
    tolerances: RobotTolerances = None
    # fmt: on

    def robot(self, folder: Path) -> Robot:
        """Read the robot; ValueError without its file, StudyError with `file:line` for an invalid file."""
        path = folder / self.urdf
        if not os.path.isfile(path):
            raise ValueError(f"urdf: no such file (looked for {path}; the path is relative to the robot's file)")
        root = read_elements(path)
        if root.tag != "robot":
            raise root.wrong(f"a URDF begins with <robot>, this file with <{root.tag}>")
        bodies, frames = _Reader(root, self.joints).read()
        name = self.name or (root.name if "name" in root.attributes else path.stem)
        fields = name, bodies, self.gravity, self.source, (*frames, *self.frames), self.payload
        return Robot(*fields, gears=self.gears, tolerances=self.tolerances)


class _Reader:
    """Reader of the links and joints of a file, from the base."""

    def __init__(self, root: UrdfElement, joints: Mapping[str, UrdfJoint]) -> None:
        self.root, self.properties = root, joints
        self.links = {link.name: link for link in root.all("link")}
        for kind in ("link", "joint"):
            names = []
            for element in root.all(kind):
                names.append(element.name)
                try:
                    check_different(kind, names)
                except ValueError as error:
                    raise element.wrong(str(error)) from None
        self.below: dict[str, list[UrdfElement]] = {}
        self.child_of: dict[str, UrdfElement] = {}
        for joint in root.all("joint"):
            parent, child = (self._link_of(joint, role) for role in ("parent", "child"))
            if child in self.child_of:
                raise joint.wrong(f"link {child} has two parents; loops cannot be read from a URDF")
            self.below.setdefault(parent, []).append(joint)
            self.child_of[child] = joint

    def read(self) -> tuple[tuple[Body, ...], tuple[Frame, ...]]:
        """Return all bodies, parents first, and frames for fixed links without mass or on the base."""
        roots = [name for name in self.links if name not in self.child_of]
        if len(roots) != 1:
            raise self.root.wrong(f"one link must be the base; without a parent are {', '.join(roots) or 'none'}")
        moving = [joint.name for joint in self.root.all("joint") if joint.text("type") != "fixed"]
        for name in self.properties:
            if name not in moving:
                names = ", ".join(moving) or "none"
                raise StudyError(
                    "robot/unknown-name", f"{self.root.path} has no moving joint {name}; there are {names}", "joints"
                )
        bodies = []
        frames = [Frame(roots[0], BASE)]
        waiting = [(joint, BASE, Placement()) for joint in self.below.get(roots[0], [])]
        while waiting:
            joint, body, placement = waiting.pop(0)
            child, placement = self._link_of(joint, "child"), placement.then(_origin(joint))
            link = self.links[child]
            if self._is_fixed(joint) and (body == BASE or not _has_mass(link)):
                frames.append(Frame(child, body, placement))
            else:
                bodies.append(_body(link, body, placement, self._joints(joint)))
                body, placement = child, Placement()
            waiting += [(joint_below, body, placement) for joint_below in self.below.get(child, [])]
        reached = {body.name for body in bodies} | {frame.name for frame in frames}
        for name in self.links:
            if name not in reached:
                raise self.child_of[name].wrong(
                    f"link {name} is part of a circle of joints, without a connection to {roots[0]}"
                )
        return tuple(bodies), tuple(frames)

    def _joints(self, joint: UrdfElement) -> tuple[Joint, ...]:
        name, kind = joint.name, joint.text("type")
        if self._is_fixed(joint):
            return ()
        if kind not in _MOVING or joint.first("mimic") is not None:
            kind_text = f"of type {kind}" if kind not in _MOVING else "that mimics another"
            raise joint.wrong(
                f"joint {name}: a joint {kind_text} cannot be modelled; take revolute, prismatic or fixed joints"
            )
        if name not in self.properties:
            raise joint.wrong(
                f"joint {name} moves and is not among the joints given with the URDF; give its motor (and spring) "
                "there, or make it fixed"
            )
        if not self._mass_below(self._link_of(joint, "child")):
            raise joint.wrong(
                f"joint {name} moves links without mass; give link {self._link_of(joint, 'child')} an <inertial>"
            )
        axis_of = joint.first("axis")
        x, y, z = (1.0, 0.0, 0.0) if axis_of is None else axis_of.numbers("xyz", 3)
        dynamics, properties = joint.first("dynamics"), self.properties[name]
        viscous = 0.0 if dynamics is None else dynamics.number("damping", "0")
        viscous = viscous if properties.viscous is None else properties.viscous
        try:
            limits = _limits(joint) if properties.limits is None else properties.limits
            axis, contents = (x, y, z), (properties.spring, properties.motor, viscous)
            return Joint(name, axis, *contents, limits=limits, motion=_MOVING[kind]), *properties.elastic
        except StudyError:
            raise
        except ValueError as error:
            raise joint.wrong(str(error)) from None

    def _is_fixed(self, joint: UrdfElement) -> bool:
        """Return True for a fixed joint, and for a mimic joint without properties, which is fixed at zero."""
        mimic = joint.first("mimic")
        is_mimic = mimic is not None and joint.name not in self.properties and mimic.number("offset", "0") == 0
        return is_mimic or joint.text("type") == "fixed"

    def _link_of(self, joint: UrdfElement, role: str) -> str:
        element = joint.first(role)
        if element is None:
            raise joint.wrong(f"joint {joint.text('name')} has no <{role}>")
        name = element.text("link")
        if name not in self.links:
            raise element.wrong(
                f"joint {joint.text('name')}: no link is called {name}; there are {', '.join(self.links)}"
            )
        return name

    def _mass_below(self, link: str) -> bool:
        children = (self._link_of(joint, "child") for joint in self.below.get(link, []))
        return _has_mass(self.links[link]) or any(self._mass_below(child) for child in children)


def _has_mass(link: UrdfElement) -> bool:
    inertial = link.first("inertial")
    mass = None if inertial is None else inertial.first("mass")
    return mass is not None and mass.number("value") > 0


def _origin(element: UrdfElement) -> Placement:
    origin = element.first("origin")
    if origin is None:
        return Placement()
    x, y, z = origin.numbers("xyz", 3, "0 0 0")
    roll, pitch, yaw = origin.numbers("rpy", 3, "0 0 0")
    return Placement((x, y, z), (roll, pitch, yaw))


def _limits(joint: UrdfElement) -> Limits:
    limit = joint.first("limit")
    if limit is None:
        return Limits()
    velocity, effort = (limit.number(key, "0") or math.inf for key in ("velocity", "effort"))
    is_unlimited = joint.text("type") == "continuous" or not {"lower", "upper"} & limit.attributes.keys()
    low, high = (-math.inf, math.inf) if is_unlimited else (limit.number("lower", "0"), limit.number("upper", "0"))
    if low == high == 0:  # some exporters write this for a joint without limits
        low, high = -math.inf, math.inf
    try:
        return Limits((low, high), velocity, effort)
    except ValueError as error:
        raise limit.wrong(f"joint {joint.text('name')}: {error} (lower {low:g}, upper {high:g})") from None


def _body(link: UrdfElement, parent: str, placement: Placement, joints: tuple[Joint, ...]) -> Body:
    body = Body(link.name, parent, placement, joints)
    inertial = link.first("inertial")
    if inertial is None:
        return body
    mass, tensor = inertial.first("mass"), inertial.first("inertia")
    if mass is None or tensor is None:
        raise inertial.wrong(f"<inertial> of link {body.name} needs <mass> and <inertia>")
    entries, origin = np.array([tensor.number(f"i{axes}", "0") for axes in TENSOR_LETTERS]), _origin(inertial)
    inertia = origin.rotation @ with_possible_moments(entries[TENSOR]) @ origin.rotation.T
    try:
        return replace(body, mass=mass.number("value"), center_of_mass=origin.xyz, inertia=six_numbers(inertia))
    except ValueError as error:
        raise inertial.wrong(str(error)) from None
