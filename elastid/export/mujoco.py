r"""Export to MuJoCo: the fitted robot as MJCF, elasticity and rotors included, a keyframe for each configuration.

A flexible joint becomes two hinges (or slides) of one axis on one body, motor angle and twist of the gear, so that
q_a = q_m + twist:

.. math:: V = \tfrac12 k\, twist^2, \quad R = \tfrac12 d\, \dot{twist}^2 + \tfrac12 f_m \dot q_m^2
          + \tfrac12 f (\dot q_m + \dot{twist})^2, \quad T_m = \tfrac12 J_m \dot q_m^2

Rotors are armatures, named frames sites, viscous friction of the arm a damped tendon. Everything is on the link side:
an actuator exerts link-side torque. The keyframes are the equilibria, controls included.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree as ET

import numpy as np

from elastid.base.errors import StudyError
from elastid.export.intervals import known_numbers
from elastid.export.mujoco_loops import (
    MIN_INERTIA,
    Elements,
    RodPose,
    add_loops,
    add_rod_springs,
    number,
    numbers,
    quaternion,
    rod_poses,
    rod_positions,
)
from elastid.fit.fitted_robot import FittedRobot
from elastid.linear.equilibrium import OperatingPoint, equilibrium
from elastid.robot import BASE, Body, Joint, Placement, Robot, unit_axis
from elastid.store.files import text_file

# Of a robot without loops.
NO_RODS: Mapping[str, RodPose] = MappingProxyType({})


def write_mujoco(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """robot.xml. StudyError where MJCF cannot represent the robot."""
    _check(model.robot)
    rest = [equilibrium(model.model, model.theta[:-1], linear.configuration) for linear in model.linear]
    start = rod_poses(model.robot, rest[0].q[: len(model.robot.joints)])
    root = mjcf(model.robot, start)
    _intervals(root, model)
    _keyframes(root, model, rest, start)
    ET.indent(root)
    path = folder / "robot.xml"
    with text_file(path) as file:
        file.write(ET.tostring(root, encoding="unicode") + "\n")
    return (path,)


def mjcf(robot: Robot, rods: Mapping[str, RodPose] = NO_RODS) -> ET.Element:
    """The robot without keyframes; StudyError where MJCF cannot represent it.  rods: the poses they are drawn in."""
    _check(robot)
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false", balanceinertia="false")
    # An implicit step keeps stiff gears stable; MuJoCo's default would not.
    ET.SubElement(root, "option", gravity=numbers(robot.gravity), integrator="implicit", timestep="0.0005")
    elements = _bodies(ET.SubElement(root, "worldbody"), robot)
    add_loops(root, elements, robot, rods)
    _tendons(root, robot)
    add_rod_springs(root, elements, robot)
    _actuators(root, robot)
    _check_names(root, robot)
    return root


def _check(robot: Robot) -> None:
    """StudyError where the robot has a part that MJCF cannot represent."""
    nonlinear = [f"spring of joint {j.name}" for j in robot.joints if j.spring is not None and not j.spring.is_linear]
    nonlinear += [f"compensator {compensator.name}" for compensator in robot.compensators]
    if nonlinear:
        raise StudyError(
            f"robot {robot.name}: MJCF has linear joint springs only, and the {', '.join(nonlinear)} would be lost; "
            "export to casadi or c instead"
        )
    for joint in robot.driven:
        if joint.motor is not None and (joint.motor.on or joint.motor.spring is not None):
            cause = f"rides on {joint.motor.on}" if joint.motor.on else "has a spring in its shaft"
            raise StudyError(
                f"robot {robot.name}: the motor of joint {joint.name} {cause}, which MJCF's armature cannot represent; "
                "export to casadi or c instead"
            )
    if robot.gears:
        raise StudyError(
            f"gears couple the axes of robot {robot.name}, which MJCF's armature cannot represent; export to casadi or "
            "c instead"
        )


def _check_names(root: ET.Element, robot: Robot) -> None:
    """StudyError where two elements of a kind have one name: of a loop's rod and of a body, for example."""
    kinds = {"body": "worldbody//body", "site": "worldbody//site", "tendon": "tendon/*", "equality": "equality/*"}
    for kind, path in kinds.items():
        names = ["world"] if kind == "body" else []
        for name in (element.get("name", "") for element in root.findall(path)):
            if name in names:
                raise StudyError(
                    f"robot {robot.name}: MJCF would have two elements of the kind {kind} called '{name}'; give the "
                    "body, frame or loop another name"
                )
            names.append(name)


def _bodies(world: ET.Element, robot: Robot) -> Elements:
    """The element of each body, with its axes in it."""
    elements = {BASE: (world, Placement())}  # with the placement of the body's axes in the element
    for body in robot.all_bodies:
        parent, mounted = elements[body.parent]
        element = ET.SubElement(parent, "body", {"name": body.name} | _seat(mounted, body.placement))
        if body.mass or np.any(body.inertia_matrix):
            _inertial(element, body)
        for joint in body.joints:
            _hinges(element, joint)
        elements[body.name] = element, body.mounting
    for frame in robot.frames:
        parent, mounted = elements[frame.body]
        ET.SubElement(parent, "site", {"name": frame.name} | _seat(mounted, frame.placement))
    return elements


def _seat(first: Placement, second: Placement) -> dict[str, str]:
    """One placement behind another, as MJCF writes it."""
    R = first.rotation
    return {
        "pos": numbers(np.array(first.xyz) + R @ second.xyz),
        "quat": numbers(quaternion(R @ second.rotation)),
    }


def _inertial(element: ET.Element, body: Body) -> None:
    R = body.mounting.rotation
    I = R @ body.inertia_matrix @ R.T  # noqa: E741
    I = I + max(0.0, MIN_INERTIA - np.linalg.eigvalsh(I)[0]) * np.eye(3)  # noqa: E741
    entries = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    ET.SubElement(
        element,
        "inertial",
        pos=numbers(np.array(body.mounting.xyz) + R @ body.center_of_mass),
        mass=number(max(body.mass, MIN_INERTIA)),
        fullinertia=numbers(entries),
    )


def _hinges(element: ET.Element, joint: Joint) -> None:
    axis = {"axis": numbers(unit_axis(joint.axis)), "type": "slide" if joint.slides else "hinge"}
    axis |= {"pos": numbers(joint.point)} if any(joint.point) else {}
    armature, friction = 0.0, 0.0
    if joint.motor is not None:
        armature = joint.motor.ratio**2 * joint.motor.inertia
        friction = joint.motor.ratio**2 * joint.motor.viscous
    if joint.spring is None:
        _hinge(element, _driven(joint), axis, armature=armature, damping=friction + joint.viscous)
    elif joint.motor is None:
        k, d = joint.spring.stiffness, joint.spring.damping
        _hinge(element, f"joint {joint.name}", axis, stiffness=k, damping=d + joint.viscous)
    else:
        _hinge(element, f"motor {joint.name}", axis, armature=armature, damping=friction)
        _hinge(element, f"twist {joint.name}", axis, stiffness=joint.spring.stiffness, damping=joint.spring.damping)


def _hinge(element: ET.Element, name: str, axis: dict[str, str], **numbers: float) -> None:
    ET.SubElement(element, "joint", {"name": name} | axis | {key: number(n) for key, n in numbers.items()})


def _driven(joint: Joint) -> str:
    return f"joint {joint.name}" if joint.motor is None else f"motor {joint.name}"


def _tendons(root: ET.Element, robot: Robot) -> None:
    """Viscous friction across a flexible joint acts on motor angle and twist together."""
    rough = [joint for joint in robot.flexible if joint.viscous]
    if not rough:
        return
    tendons = ET.SubElement(root, "tendon")
    for joint in rough:
        fixed = ET.SubElement(tendons, "fixed", name=f"joint {joint.name}", damping=number(joint.viscous))
        for part in ("motor", "twist"):
            ET.SubElement(fixed, "joint", joint=f"{part} {joint.name}", coef="1")


def _actuators(root: ET.Element, robot: Robot) -> None:
    actuators = ET.SubElement(root, "actuator")
    for joint in robot.driven:
        ET.SubElement(actuators, "motor", name=f"motor {joint.name}", joint=f"motor {joint.name}", gear="1")


def _intervals(root: ET.Element, model: FittedRobot) -> None:
    """The numbers of the fit with their intervals as custom arrays, which move nothing."""
    custom = ET.SubElement(root, "custom")
    legend = "of each number that was identified: value, standard deviation, ends of the 95 % interval; SI"
    ET.SubElement(custom, "text", name="numeric", data=legend)
    for known in known_numbers(model):
        if known.is_identified:
            row = numbers((known.value, known.std, known.low, known.high))
            ET.SubElement(custom, "numeric", name=known.name, data=row)


def _keyframes(
    root: ET.Element, model: FittedRobot, rest: Sequence[OperatingPoint], start: Mapping[str, RodPose]
) -> None:
    """Rest in every configuration, the joints in the order of the file, which is the engine's."""
    keys = ET.SubElement(root, "keyframe")
    joints = [element.get("name", "") for element in root.findall("worldbody//joint")]
    for point in rest:
        now = rod_poses(model.robot, point.q[: len(model.robot.joints)])
        positions = _positions(model, point) | rod_positions(start, now, model.robot)
        q = [value for joint in joints for value in positions[joint]]
        ET.SubElement(keys, "key", name=point.configuration.name, qpos=numbers(q), ctrl=numbers(point.u))


def _positions(model: FittedRobot, point: OperatingPoint) -> dict[str, list[float]]:
    """Positions of the joints of the bodies by their names in the file."""
    angles = dict(zip(model.model.coordinates, point.q.tolist(), strict=True))
    positions: dict[str, list[float]] = {}
    for joint in model.robot.joints:
        angle = angles[f"joint {joint.name}"]
        if joint.is_flexible:
            motor = angles[f"motor {joint.name}"]
            positions |= {f"motor {joint.name}": [motor], f"twist {joint.name}": [angle - motor]}
        else:
            positions[_driven(joint) if joint.spring is None else f"joint {joint.name}"] = [angle]
    return positions
