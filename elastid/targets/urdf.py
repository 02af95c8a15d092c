"""Export to URDF: the fitted robot as rigid bodies, since the format has no elasticity.

Driven and passive joints with axes, limits, viscous and Coulomb friction (link side), bodies with mass, centre of mass
and inertia, and frames. The comment of the file names the omitted springs, elastic joints (rigid here), rotors and
gears, and the targets that contain them.
"""

import math
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from elastid.base.errors import StudyError
from elastid.base.escape import unique_name, xml_comment, xml_text
from elastid.fit.fitted_robot import FittedRobot
from elastid.friction.robot_friction import joint_laws
from elastid.robot import BASE, Body, Joint, Placement, Robot, unit_axis
from elastid.store.files import write_text
from elastid.targets.numbers import in_full, interval_lines
from elastid.targets.target import Target


def write_urdf(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """Write robot.urdf; StudyError if the robot has loops, since a URDF is a tree."""
    root = urdf(model.robot)
    path = folder / "robot.urdf"
    comment = xml_comment("\n".join([_omissions(model.robot), *interval_lines(model)]))
    write_text(path, f'<?xml version="1.0"?>\n<!-- {comment} -->\n{xml_text(root)}\n')
    return (path,)


def urdf(robot: Robot) -> ET.Element:
    """Return the rigid robot; StudyError if it has loops."""
    if robot.loops:
        raise StudyError(
            "export/not-representable",
            f"robot {robot.name} has loops ({', '.join(loop.name for loop in robot.loops)}), and a URDF is a tree; "
            "export to mujoco, fmu, casadi or c instead",
        )
    root = ET.Element("robot", name=robot.name)
    ET.SubElement(root, "link", name=BASE)
    # The link of each body, and the pose of the body's axes in this link.
    seats = {BASE: (BASE, Placement())}
    for body in robot.all_bodies:
        seats[body.name] = _body(root, robot, body, *seats[body.parent])
    for frame in robot.frames:
        link, seat = seats[frame.body]
        name = _link_name(root, robot, frame.name)
        ET.SubElement(root, "link", name=name)
        _fixed_joint(root, name, link, name, seat.then(frame.placement))
    return root


def _body(root: ET.Element, robot: Robot, body: Body, parent: str, seat: Placement) -> tuple[str, Placement]:
    """Add a body's link and the joints from its parent; an empty link precedes each further joint.

    seat: pose of the parent body in its link.  Returns the name of the body's link and the body's pose in it.
    """
    pose = seat.then(body.placement)
    # Joints that are only elastic are rigid in URDF.
    joints = [joint for joint in body.joints if joint.motor is not None or joint.is_passive]
    names = [_link_name(root, robot, f"{body.name} before {joint.name}") for joint in joints[1:]] + [body.name]
    for joint, name in zip(joints, names, strict=bool(joints)):
        _joint(root, robot, joint, parent, name, pose.then(Placement(joint.point)))
        ET.SubElement(root, "link", name=name)
        x, y, z = joint.point
        parent, pose = name, Placement((-x, -y, -z))
    if not joints:
        ET.SubElement(root, "link", name=body.name)
        _fixed_joint(root, body.name, parent, body.name, pose)
        parent, pose = body.name, Placement()
    seat = pose.then(body.mounting)
    if body.mass or np.any(body.inertia_matrix):
        _inertial(next(link for link in root.iter("link") if link.get("name") == parent), body, seat)
    return parent, seat


def _link_name(root: ET.Element, robot: Robot, name: str) -> str:
    """Return a unique name for a link that is no body: a body and a frame may share a name, two links may not."""
    bodies = [BASE, *(body.name for body in robot.all_bodies)]
    return unique_name(name, [*bodies, *(link.get("name", "") for link in root.iter("link"))])


def _joint(root: ET.Element, robot: Robot, joint: Joint, parent: str, child: str, pose: Placement) -> None:
    low, high = joint.limits.angle
    is_limited = joint.slides or math.isfinite(low) or math.isfinite(high)
    kind = "prismatic" if joint.slides else "revolute" if is_limited else "continuous"
    element = _joint_element(root, joint.name, kind, parent, child, pose)
    ET.SubElement(element, "axis", xyz=in_full(unit_axis(joint.axis)))
    limits = {"effort": joint.limits.torque, "velocity": joint.limits.velocity}
    limits |= {"lower": low, "upper": high} if is_limited else {}
    # The format requires limits.
    finite = {key: math.copysign(min(abs(value), 1e6), value) for key, value in limits.items()}
    ET.SubElement(element, "limit", {key: repr(value) for key, value in finite.items()})
    coulomb = sum(float(law.curve()[0]) for law in joint_laws(robot, joint.name))
    ET.SubElement(element, "dynamics", damping=repr(float(joint.all_viscous)), friction=repr(float(coulomb)))


def _fixed_joint(root: ET.Element, name: str, parent: str, child: str, pose: Placement) -> None:
    names = [joint.get("name", "") for joint in root.iter("joint")]
    _joint_element(root, unique_name(f"{name} fixed", names), "fixed", parent, child, pose)


def _joint_element(root: ET.Element, name: str, kind: str, parent: str, child: str, pose: Placement) -> ET.Element:
    element = ET.SubElement(root, "joint", name=name, type=kind)
    _origin(element, pose)
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    return element


def _inertial(link: ET.Element, body: Body, seat: Placement) -> None:
    element = ET.SubElement(link, "inertial")
    _origin(element, seat.then(Placement(body.center_of_mass)))
    ET.SubElement(element, "mass", value=repr(float(body.mass)))
    I = body.inertia_matrix  # noqa: E741
    entries = {
        f"i{a}{b}": repr(float(I["xyz".index(a), "xyz".index(b)])) for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")
    }
    ET.SubElement(element, "inertia", entries)


def _origin(element: ET.Element, placement: Placement) -> None:
    ET.SubElement(element, "origin", xyz=in_full(placement.xyz), rpy=in_full(placement.rpy))


def _omissions(robot: Robot) -> str:
    springs = [joint.name for joint in robot.joints if joint.spring is not None]
    parts = [f"springs of the joints {', '.join(springs)}" if springs else "", "rotors, gears and their ripple"]
    parts += ["compensators"] if robot.compensators else []
    return f"{robot.name}, rigid. Left out: {'; '.join(filter(None, parts))}. Targets mujoco, fmu, casadi, c have them."


TARGETS = (Target("urdf", ("model",), "rigid bodies with viscous and Coulomb friction as URDF", write_urdf),)
