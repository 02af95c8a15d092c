r"""Export to MuJoCo: the fitted robot as MJCF with elasticity and rotors, and a keyframe for each configuration.

A flexible joint becomes two hinges (or slides) of one axis on one body, motor angle and twist of the gear, so that
q_a = q_m + twist:

.. math:: V = \tfrac12 k\, twist^2, \quad R = \tfrac12 d\, \dot{twist}^2 + \tfrac12 f_m \dot q_m^2
          + \tfrac12 f (\dot q_m + \dot{twist})^2, \quad T_m = \tfrac12 J_m \dot q_m^2

Rotors are armatures, frames are sites, viscous link-side friction is a damped tendon. All values are link-side values,
also the torques of the actuators. The keyframes are equilibria with their controls.

For a gear with backlash b and inner stiffness k_i, the twist has the stiffness k_i, and a tendon over the twist has the
stiffness k - k_i and is slack within +-b (`springlength`): lost motion with sharp ends.

Rods of loops are bodies on ball joints, closed by equality constraints between sites. A rod with uniform strain has its
mass in two points: one at its first end, and one at the fraction f of its length, which moves by f s (elongation s):

.. math:: f = a + \frac{I}{m a L^2}, \qquad m_f = m a / f, \qquad m_0 = m - m_f

Mass, centre, transverse inertia and all terms of s in T then equal the values of the rod,
:math:`T = \tfrac12 m |(1-a) \dot p_1 + a \dot p_2|^2 + \tfrac12 (I / L^2) |\dot p_2 - \dot p_1|^2`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from elastid.base.arrays import FloatArray, values_by_name
from elastid.base.errors import StudyError
from elastid.base.escape import xml_text
from elastid.fit.fitted_robot import FittedRobot
from elastid.linear.equilibrium import OperatingPoint, equilibrium
from elastid.model.kinematics import frame_poses
from elastid.robot import BASE, Body, Joint, Loop, Placement, Robot, Rod, unit_axis
from elastid.robot.body import six_numbers
from elastid.store.files import write_text
from elastid.targets.numbers import exported_numbers, in_full
from elastid.targets.target import Target

MIN_INERTIA = 1e-12  # kg and kg m^2, negligible; MuJoCo requires mass and inertia of a moving body
# Element to which the joints of a body are added, and the placement of the body's axes in it.
Elements: TypeAlias = Mapping[str, tuple[ET.Element, Placement]]
Positions: TypeAlias = dict[str, list[float]]  # of joints by name
# Constraints settle within two steps of 0.5 ms and are as stiff as MuJoCo allows.
_HARD = {"solref": "0.001 1", "solimp": "0.9999 0.99999 0.001"}
_ALONG = np.array([1.0, 0.0, 0.0])  # direction of a rod in its own axes
NO_RODS: "Mapping[str, RodPose]" = MappingProxyType({})  # for a robot without loops
_NO_GAP: Mapping[str, Any] = {"backlash": None, "inner_stiffness": 0.0}


def write_mujoco(folder: Path, linear_model: FittedRobot, geared: Robot | None = None) -> tuple[Path, ...]:
    """Write robot.xml with friction and lost motion of `geared`; StudyError if MJCF cannot represent the robot."""
    model = linear_model
    points = [equilibrium(model.model, model.theta[:-1], linear.configuration) for linear in model.linear]
    start = rod_poses(model.robot, points[0].q[: model.robot.n_l])
    root = mjcf(model.robot, start)
    if geared is not None:
        _add_friction(root, geared)
        _add_lost_motion(root, geared)
    _add_intervals(root, model)
    _add_keyframes(root, model, points, start)
    path = folder / "robot.xml"
    write_text(path, xml_text(root) + "\n")
    return (path,)


def mjcf(robot: Robot, rods: "Mapping[str, RodPose]" = NO_RODS) -> ET.Element:
    """Return the robot without keyframes; StudyError if MJCF cannot represent it.  rods: their poses in the file."""
    _check(robot)
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false", balanceinertia="false")
    # Stiff gears need implicit time steps, which are not MuJoCo's default.
    ET.SubElement(root, "option", gravity=in_full(robot.gravity), integrator="implicit", timestep="0.0005")
    elements = _bodies(ET.SubElement(root, "worldbody"), robot)
    add_loops(root, elements, robot, rods)
    for joint in robot.flexible:
        if joint.viscous:
            _tendon(root, joint).set("damping", repr(float(joint.viscous)))
    _add_lost_motion(root, robot)
    add_rod_springs(root, elements, robot)
    actuators = ET.SubElement(root, "actuator")
    for joint in robot.driven:
        ET.SubElement(actuators, "motor", name=f"motor {joint.name}", joint=f"motor {joint.name}", gear="1")
    return root


def _check(robot: Robot) -> None:
    """Raise StudyError for a robot that MJCF cannot represent."""
    omissions = [
        f"the spring of joint {j.name}" for j in robot.joints if j.spring and not replace(j.spring, **_NO_GAP).is_linear
    ]
    omissions += [f"compensator {compensator.name}" for compensator in robot.compensators]
    omissions += [
        f"the motor of joint {joint.name}, which {f'rides on {motor.on}' if motor.on else 'has a spring in its shaft'}"
        for joint in robot.driven
        if (motor := joint.motor) is not None and (motor.on or motor.spring is not None)
    ]
    omissions += ["gears that couple axes"] if robot.gears else []
    if omissions:
        raise StudyError(
            "export/not-representable",
            f"MJCF cannot represent {', '.join(omissions)}. Export to casadi or c instead",
            f"robot {robot.name}",
        )


def _bodies(world: ET.Element, robot: Robot) -> Elements:
    """Add bodies with joints and inertia, and frames; return the element of each body."""
    elements = {BASE: (world, Placement())}
    for body in robot.all_bodies:
        parent, mounted = elements[body.parent]
        element = ET.SubElement(parent, "body", {"name": body.name} | _pose(mounted, body.placement))
        if body.mass or np.any(body.inertia_matrix):
            _inertial(element, body)
        for joint in body.joints:
            _add_joints(element, joint)
        elements[body.name] = element, body.mounting
    for frame in robot.frames:
        parent, mounted = elements[frame.body]
        ET.SubElement(parent, "site", {"name": frame.name} | _pose(mounted, frame.placement))
    return elements


def _pose(first: Placement, second: Placement) -> dict[str, str]:
    R = first.rotation
    return {"pos": in_full(np.array(first.xyz) + R @ second.xyz), "quat": in_full(quaternion(R @ second.rotation))}


def _inertial(element: ET.Element, body: Body) -> None:
    R = body.mounting.rotation
    I = R @ body.inertia_matrix @ R.T  # noqa: E741
    I = I + max(0.0, MIN_INERTIA - np.linalg.eigvalsh(I)[0]) * np.eye(3)  # noqa: E741
    entries = in_full(six_numbers(I))
    center, mass = np.array(body.mounting.xyz) + R @ body.center_of_mass, float(max(body.mass, MIN_INERTIA))
    ET.SubElement(element, "inertial", pos=in_full(center), mass=repr(mass), fullinertia=entries)


def _add_joints(element: ET.Element, joint: Joint) -> None:
    axis = {"axis": in_full(unit_axis(joint.axis)), "type": "slide" if joint.slides else "hinge"}
    axis |= {"pos": in_full(joint.point)} if any(joint.point) else {}
    armature = friction = 0.0
    if (motor := joint.motor) is not None:
        armature, friction = motor.ratio**2 * motor.inertia, motor.ratio**2 * motor.viscous
    if joint.spring is None:
        _add_joint(element, _joint_name(joint), axis, armature=armature, damping=friction + joint.viscous)
    elif joint.motor is None:
        k, d = joint.spring.stiffness, joint.spring.damping
        _add_joint(element, f"joint {joint.name}", axis, stiffness=k, damping=d + joint.viscous)
    else:
        _add_joint(element, f"motor {joint.name}", axis, armature=armature, damping=friction)
        _add_joint(element, f"twist {joint.name}", axis, stiffness=joint.spring.stiffness, damping=joint.spring.damping)


def _add_joint(element: ET.Element, name: str, axis: dict[str, str], **numbers: float) -> None:
    ET.SubElement(element, "joint", {"name": name} | axis | {key: repr(float(n)) for key, n in numbers.items()})


def _joint_name(joint: Joint) -> str:
    return f"joint {joint.name}" if joint.motor is None else f"motor {joint.name}"


def _tendon(root: ET.Element, joint: Joint) -> ET.Element:
    """Return the tendon over motor angle plus twist of a flexible joint; add it if it is missing."""
    tendons = _tendon_list(root)
    fixed = next((tendon for tendon in tendons if tendon.get("name") == f"joint {joint.name}"), None)
    if fixed is None:
        fixed = ET.SubElement(tendons, "fixed", name=f"joint {joint.name}")
        for kind in ("motor", "twist"):
            ET.SubElement(fixed, "joint", joint=f"{kind} {joint.name}", coef="1")
    return fixed


def _tendon_list(root: ET.Element) -> ET.Element:
    """Return the element of all tendons; add it if it is missing."""
    tendons = root.find("tendon")
    return ET.SubElement(root, "tendon") if tendons is None else tendons


def _joints_by_name(root: ET.Element) -> dict[str | None, ET.Element]:
    return {element.get("name"): element for element in root.iter("joint")}


def _add_lost_motion(root: ET.Element, robot: Robot) -> None:
    """Add tendons over the springs with backlash, slack within the gap; the joints keep the inner stiffness."""
    hinges = _joints_by_name(root)
    for joint in robot.joints:
        spring = joint.spring
        if spring is None or spring.backlash is None:
            continue
        name = f"joint {joint.name}" if joint.motor is None else f"twist {joint.name}"
        hinges[name].set("stiffness", repr(float(spring.inner_stiffness)))
        outer, gap = float(spring.stiffness - spring.inner_stiffness), in_full((-spring.backlash, spring.backlash))
        names = {"name": f"lost motion {joint.name}", "stiffness": repr(outer), "springlength": gap}
        ET.SubElement(ET.SubElement(_tendon_list(root), "fixed", names), "joint", joint=name, coef="1")


def _add_friction(root: ET.Element, robot: Robot) -> None:
    hinges = _joints_by_name(root)
    for joint in robot.driven:
        if joint.motor is not None and joint.motor.dry_friction is not None:
            torque = abs(joint.motor.ratio) * joint.motor.dry_friction.coulomb
            hinges[f"motor {joint.name}"].set("frictionloss", repr(float(torque)))
        if joint.friction is not None and joint in robot.flexible:
            _tendon(root, joint).set("frictionloss", repr(float(joint.friction.coulomb)))


def _add_intervals(root: ET.Element, model: FittedRobot) -> None:
    custom = ET.SubElement(root, "custom")
    legend = "of each number that was identified: value, standard deviation, ends of the 95 % interval; SI"
    if model.result.has_tolerances:
        legend += "; then the parts of the deviation by noise and by the tolerances of the robot's file"
    ET.SubElement(custom, "text", name="numeric", data=legend)
    for parameter in exported_numbers(model):
        if math.isfinite(parameter.std):
            row = in_full(value for value in parameter.row.values() if math.isfinite(value))
            ET.SubElement(custom, "numeric", name=parameter.name, data=row)


def _add_keyframes(
    root: ET.Element, model: FittedRobot, points: Sequence[OperatingPoint], start: "Mapping[str, RodPose]"
) -> None:
    """Add a keyframe at equilibrium for each configuration, with the joints in the order of the file."""
    keys = ET.SubElement(root, "keyframe")
    joints = [element.get("name", "") for element in root.findall("worldbody//joint")]
    for point in points:
        rods = rod_poses(model.robot, point.q[: model.robot.n_l])
        positions = _positions(model, point) | rod_positions(start, rods, model.robot)
        q = [value for joint in joints for value in positions[joint]]
        ET.SubElement(keys, "key", name=point.configuration.name, qpos=in_full(q), ctrl=in_full(point.u))


def _positions(model: FittedRobot, point: OperatingPoint) -> Positions:
    angles = values_by_name(model.model.coordinates, point.q)
    positions: Positions = {}
    for joint in model.robot.joints:
        angle = angles[f"joint {joint.name}"]
        if joint.is_flexible:
            motor = angles[f"motor {joint.name}"]
            positions |= {f"motor {joint.name}": [motor], f"twist {joint.name}": [angle - motor]}
        else:
            positions[_joint_name(joint) if joint.spring is None else f"joint {joint.name}"] = [angle]
    return positions


@dataclass(frozen=True)
class RodPose:
    """Pose of a rod: its direction (3,) in the axes of its first body, and its elongation, m."""

    direction: FloatArray
    elongation: float


def rod_poses(robot: Robot, q: FloatArray) -> dict[str, RodPose]:
    """Return the poses of the rods by loop, with the joints at q (n_l,)."""
    poses = {}
    for loop in robot.loops:
        if loop.rod is not None:
            (R, p), (R_2, p_2) = (_body_pose(robot, q, end.body) for end in loop.ends)
            gap = p_2 + R_2 @ np.array(loop.ends[1].point) - p - R @ np.array(loop.ends[0].point)
            length = float(np.linalg.norm(gap))
            poses[loop.name] = RodPose(R.T @ gap / length, length - loop.rod.length)
    return poses


def add_loops(root: ET.Element, elements: Elements, robot: Robot, start: Mapping[str, RodPose]) -> None:
    """Add rods below their first bodies, sites at the ends, and constraints.  start: poses in the model file."""
    if not robot.loops:
        return
    equality = ET.SubElement(root, "equality")
    for loop in robot.loops:
        if loop.rod is not None:
            _add_rod(equality, elements, loop, loop.rod, start[loop.name].direction)
        else:
            # A loop with a pin needs two points on its axis, 0.1 m apart; other loops without a rod need one point.
            axes = (None, None) if loop.pin is None else (loop.pin.axis, loop.pin.other_axis or loop.pin.axis)
            for i in range(1 if loop.pin is None or loop.pin.planar else 2):
                for number, (end, axis) in enumerate(zip(loop.ends, axes, strict=True), start=1):
                    point = np.array(end.point) + (0.1 * unit_axis(axis) if i and axis is not None else 0.0)
                    _site(*elements[end.body], f"{loop.name} end {number}{i}", point)
                _connect(equality, f"{loop.name} {i}", f"{loop.name} end 1{i}", f"{loop.name} end 2{i}")


def rod_positions(start: Mapping[str, RodPose], rods: Mapping[str, RodPose], robot: Robot) -> Positions:
    """Return the joint positions of all rods by name: a quaternion relative to the pose `start`, and slides, m."""
    positions = {}
    for loop in robot.loops:
        if loop.rod is None:
            continue
        direction = start[loop.name].direction
        rotation = _rotation_between(_ALONG, direction)
        turn = rotation.T @ _rotation_between(direction, rods[loop.name].direction) @ rotation
        positions[f"turn {loop.name}"] = quaternion(turn).tolist()
        if loop.rod.is_elastic:
            s = rods[loop.name].elongation
            positions |= {f"stretch {loop.name}": [s], f"part {loop.name}": [_mass_location(loop.rod) * s]}
    return positions


def _add_rod(equality: ET.Element, elements: Elements, loop: Loop, rod: Rod, direction: FloatArray) -> None:
    """Add a rod with two point masses below its first body, and the constraints that close its loop."""
    parent, mounted = elements[loop.ends[0].body]
    R = mounted.rotation
    seat = np.array(mounted.xyz) + R @ np.array(loop.ends[0].point)
    pose = {"pos": in_full(seat), "quat": in_full(quaternion(R @ _rotation_between(_ALONG, direction)))}
    body = ET.SubElement(parent, "body", {"name": f"rod {loop.name}"} | pose)
    f = _mass_location(rod)
    moving_mass = rod.mass * rod.center / f if f > 0 else 0.0
    _point_mass(body, rod.mass - moving_mass, 0.0)
    ET.SubElement(body, "joint", name=f"turn {loop.name}", type="ball")
    middle = ET.SubElement(body, "body", name=f"rod {loop.name} middle")
    _point_mass(middle, moving_mass, f * rod.length)
    end = ET.SubElement(body, "body", name=f"rod {loop.name} end")
    _point_mass(end, 0.0, rod.length)
    if rod.is_elastic:
        slide = {"type": "slide", "axis": "1 0 0"}
        ET.SubElement(middle, "joint", {"name": f"part {loop.name}"} | slide)
        ET.SubElement(end, "joint", {"name": f"stretch {loop.name}"} | slide)
        coupled = {"joint1": f"part {loop.name}", "joint2": f"stretch {loop.name}", "polycoef": f"0 {f!r} 0 0 0"}
        ET.SubElement(equality, "joint", {"name": f"{loop.name} stretch"} | coupled | _HARD)
    ET.SubElement(end, "site", name=f"{loop.name} end 1", pos=in_full((rod.length, 0.0, 0.0)))
    _site(*elements[loop.ends[1].body], f"{loop.name} end 2", loop.ends[1].point)
    _connect(equality, loop.name, f"{loop.name} end 1", f"{loop.name} end 2")


def add_rod_springs(root: ET.Element, elements: Elements, robot: Robot) -> None:
    """Add the springs of elastic rods as tendons between their two bodies.

    A spring in the slide of the rod would act on its massless end, which the implicit time steps do not treat.
    """
    for loop in robot.loops:
        if loop.rod is None or not loop.rod.is_elastic:
            continue
        _site(*elements[loop.ends[0].body], f"{loop.name} start", loop.ends[0].point)
        spring = {"stiffness": loop.rod.stiffness or 0.0, "damping": loop.rod.damping, "springlength": loop.rod.length}
        numbers = {key: repr(float(n)) for key, n in spring.items()}
        spatial = ET.SubElement(_tendon_list(root), "spatial", {"name": loop.name} | numbers)
        for site in (f"{loop.name} start", f"{loop.name} end 2"):
            ET.SubElement(spatial, "site", site=site)


def _mass_location(rod: Rod) -> float:
    """Return f, the relative location of the moving mass of a rod; 1 without mass."""
    return rod.center + rod.inertia / (rod.mass * rod.center * rod.length**2) if rod.mass * rod.center > 0 else 1.0


def _point_mass(body: ET.Element, mass: float, x: float) -> None:
    """Add a mass (kg) at a distance (m) along the rod; at least 1 g and 1e-4 kg m^2, which time steps need."""
    inertia = in_full([1e-4] * 3)
    ET.SubElement(body, "inertial", pos=in_full((x, 0.0, 0.0)), mass=repr(float(max(mass, 1e-3))), diaginertia=inertia)


def _site(element: ET.Element, mounted: Placement, name: str, point: Sequence[float] | FloatArray) -> None:
    ET.SubElement(element, "site", name=name, pos=in_full(np.array(mounted.xyz) + mounted.rotation @ point))


def _connect(equality: ET.Element, name: str, first: str, second: str) -> None:
    ET.SubElement(equality, "connect", {"name": name, "site1": first, "site2": second} | _HARD)


def _body_pose(robot: Robot, q: FloatArray, body: str) -> tuple[FloatArray, FloatArray]:
    """Return the rotation (3, 3) and the origin (3,) of a body or the base, with the joints at q."""
    if body == BASE:
        return np.eye(3), np.zeros(3)
    poses = frame_poses(robot, q[None], body)
    return np.asarray(poses.rotation[0]), np.asarray(poses.position[0])


def _rotation_between(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the smallest rotation (3, 3) that takes one direction to another."""
    return np.asarray(Rotation.align_vectors([second], [first])[0].as_matrix())


def quaternion(R: FloatArray) -> FloatArray:
    """Return (w, x, y, z) (4,) of a rotation matrix (3, 3), with w >= 0."""
    return np.asarray(Rotation.from_matrix(R).as_quat(canonical=True)[[3, 0, 1, 2]])


TARGETS = (
    Target(
        "mujoco",
        ("linear_model", "geared"),
        "linear springs, rotors, Coulomb friction and lost motion as MJCF",
        write_mujoco,
    ),
)
