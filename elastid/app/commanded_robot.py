"""Robot that a friction study from commands has identified: rotors or pendulums, and the delay of the commands."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from elastid.app.identified_robot import MOTOR_SIDE, with_identified_friction
from elastid.base.arrays import FloatArray
from elastid.friction_study.commanded import DELAY
from elastid.friction_study.result import RIGID_TERMS, FrictionResult
from elastid.robot import BASE, Body, Joint, Robot, unit_axis
from elastid.robot.simplified import with_joints
from elastid.study.robots import yaml_text


def rigid_numbers(result: FrictionResult) -> dict[tuple[str, str], float]:
    """Return inertia, gravity, offset and delay of a friction study by joint and term."""
    return {
        (joint.joint, path): number.value
        for joint in result.joints
        for path, term in RIGID_TERMS.items()
        for number in joint.numbers
        if number.name == term.name(joint.joint)
    }


def command_delay(result: FrictionResult) -> float | None:
    """Return the identified delay of the commands in s; None if the study identified no delay."""
    return next((value for (_, path), value in rigid_numbers(result).items() if path == DELAY), None)


def with_armatures(robot: Robot, result: FrictionResult) -> Robot:
    """Return the study's robot with identified friction models, and identified armatures as rotor inertias."""
    values = rigid_numbers(result)

    def with_armature(joint: Joint) -> Joint:
        armature = values.get((joint.name, "armature"))
        if joint.motor is None or armature is None or armature <= 0:
            return joint
        return replace(joint, motor=replace(joint.motor, inertia=armature / joint.motor.ratio**2))

    return with_joints(with_identified_friction(robot, result), with_armature)


def commanded_robot(robot: Robot, result: FrictionResult) -> Robot:
    """Return the robot with all numbers of a friction study.

    After a study from commands, which identifies the total inertia of each joint, bodies on the base get the identified
    inertia and gravity; the bodies of other robots are replaced by pendulums about y.
    """
    if not _has_total_inertias(robot, result):
        return with_armatures(robot, result)
    identified = with_identified_friction(robot, result)
    if not _is_on_base(robot, result):
        joints = (replace(joint, axis="x" if joint.slides else "y", spring=None) for joint in identified.driven)
        identified = Robot(robot.name, tuple(Body(f"{joint.name} body", joints=(joint,)) for joint in joints))
    return _with_pendulums(identified, rigid_numbers(result))


def robot_of_friction(name: str, robot: Robot, result: FrictionResult) -> str:
    """Return the robot model of study `name` as text with identified friction, rotor inertias, inertia and gravity."""
    has_total_inertias = _has_total_inertias(robot, result)
    identified = commanded_robot(robot, result) if _is_on_base(robot, result) else with_armatures(robot, result)
    usable_joints = [joint.joint for joint in result.joints if joint.friction is not None and joint.viscous is not None]
    comments = [
        f"Robot {robot.name} with the friction that study {name} has identified at the motors of "
        f"joints {', '.join(usable_joints) or 'none'}.",
        f"{MOTOR_SIDE}; `measured` are the ranges outside which they are unknown.",
    ]
    if has_total_inertias and _is_on_base(robot, result):
        comments += ["Inertia and gravity of each joint are identified. Half of the inertia is assigned to the rotor."]
    elif has_total_inertias:
        remark = "This file does not contain the identified total inertia J of each joint. Its masses and inertias are"
        comments += [f"{remark} copied from the robot model."]
    comments += ["Link-side values, with standard deviation and 95 % interval:"]
    for n in result.numbers:
        comments.append(f"  {n.name} = {n.value:.9g} {n.unit}, std {n.std:.3g}, {n.low:.6g} to {n.high:.6g}")
    return yaml_text(identified, tuple(comments))


def _has_total_inertias(robot: Robot, result: FrictionResult) -> bool:
    """Return True if a study from commands identified the total inertia of every driven joint."""
    values = rigid_numbers(result)
    return command_delay(result) is not None and all((name, "inertia") in values for name in robot.driven_names)


def _is_on_base(robot: Robot, result: FrictionResult) -> bool:
    """Return True if each body has one driven joint on the base, with gravity across the axis if it was identified."""
    values = rigid_numbers(result)
    return all(
        body.parent == BASE
        and len(body.joints) == 1
        and body.joints[0].motor is not None
        and (_across(robot, body)[1] > 0 or (body.joints[0].name, "gravity.cos") not in values)
        for body in robot.bodies
    )


def _across(robot: Robot, body: Body) -> tuple[FloatArray, float]:
    """Return the gravity normal to the axis of a body's joint at angle 0: direction (3,) and size in m/s^2."""
    axis, down = unit_axis(body.joints[0].axis), body.placement.rotation.T @ np.asarray(robot.gravity)
    down = down - (down @ axis) * axis
    g = float(np.linalg.norm(down))
    return (down / g, g) if g > 1e-6 else (0 * down, 0.0)


def _with_pendulums(robot: Robot, values: Mapping[tuple[str, str], float]) -> Robot:
    r"""Add the identified inertia and gravity to each body on the base; the rotor gets half of the inertia.

    With e1 along gravity across the axis a at q = 0, e2 = a x e1 and c = (H e1 + G e2) / (m g) the torque is
    G cos q + H sin q.
    """

    def with_numbers(body: Body) -> Body:
        """Return a body with the identified J, G and H of its joint."""
        (joint,) = body.joints
        J, G, H = (values.get((joint.name, path), 0.0) for path in ("inertia", "gravity.cos", "gravity.sin"))
        assert joint.motor is not None
        rotor = replace(joint.motor, inertia=J / 2 / joint.motor.ratio**2)
        joints, (down, g) = (replace(joint, motor=rotor),), _across(robot, body)
        if joint.slides:
            return replace(body, joints=joints, mass=J / 2)
        if not g:
            return replace(body, joints=joints, center_of_mass=(0.0, 0.0, 0.0), inertia=J / 2)
        mass = max(2 * (G**2 + H**2) / (g**2 * J), 1e-9)
        lever = (H * down + G * np.cross(unit_axis(joint.axis), down)) / (mass * g)
        inertia = max(J / 2 - mass * float(lever @ lever), 0.0)
        return replace(body, joints=joints, mass=mass, center_of_mass=tuple(lever.tolist()), inertia=inertia)

    return replace(robot, bodies=tuple(map(with_numbers, robot.bodies)))
