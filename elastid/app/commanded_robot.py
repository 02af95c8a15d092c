"""The robot that a friction study by commands has identified: rotors or pendulums, and the delay of the commands."""

from collections.abc import Mapping
from dataclasses import replace

from elastid.app.identified_robot import with_identified_friction
from elastid.friction_study.commanded import DELAY
from elastid.friction_study.result import RIGID_TERMS, FrictionResult, JointFriction
from elastid.robot import Body, Joint, Motor, Robot
from elastid.robot.simplified import with_joints


def rigid_numbers(result: FrictionResult) -> dict[tuple[str, str], float]:
    """Numbers of a friction study that are no friction, by joint and term."""
    return {
        (joint.joint, path): number.value
        for joint in result.joints
        for path, term in RIGID_TERMS.items()
        for number in joint.numbers
        if number.name == term.name(joint.joint)
    }


def command_delay(result: FrictionResult) -> float | None:
    """Delay of the commands in s that a friction study has found; None without one."""
    return next((value for (_, path), value in rigid_numbers(result).items() if path == DELAY), None)


def with_armatures(robot: Robot, result: FrictionResult) -> Robot:
    """A study's robot with the law of friction of each joint, and the armatures that the study has found as rotors."""
    values = rigid_numbers(result)

    def with_armature(joint: Joint) -> Joint:
        armature = values.get((joint.name, "armature"))
        if joint.motor is None or armature is None:
            return joint
        return replace(joint, motor=replace(joint.motor, inertia=armature / joint.motor.ratio**2))

    return with_joints(with_identified_friction(robot, result), with_armature)


def commanded_robot(robot: Robot, result: FrictionResult) -> Robot:
    """The robot with all numbers of a friction study.

    If a study by commands has found the inertia of each joint as a whole, the bodies of the file are replaced: each
    joint is a pendulum about y with the inertia and gravity of the study.
    """
    values = rigid_numbers(result)
    if command_delay(result) is None or any((name, "inertia") not in values for name in robot.driven_names):
        return with_armatures(robot, result)
    return Robot(robot.name, tuple(_pendulum(joint, result.at(joint.name), values) for joint in robot.driven))


def _pendulum(joint: Joint, found: JointFriction, values: Mapping[tuple[str, str], float]) -> Body:
    """A body on a joint about y, or along x: u = J q'' + G cos q + H sin q + friction, half of J in the rotor."""
    J, G, H = (values.get((joint.name, path), 0.0) for path in ("inertia", "gravity.cos", "gravity.sin"))
    motor = Motor(J / 2, 1.0, found.viscous or 0.0, friction=found.friction)
    if joint.slides:
        return Body(
            f"{joint.name} body", joints=(Joint(joint.name, "x", motor=motor, motion="translation"),), mass=J / 2
        )
    g = 9.81
    mass = max(2 * (G**2 + H**2) / (g**2 * J), 1e-9)
    inertia = J / 2 - (G**2 + H**2) / (g**2 * mass)
    center = (-G / (mass * g), 0.0, -H / (mass * g))
    axis = Joint(joint.name, "y", motor=motor)
    return Body(f"{joint.name} body", joints=(axis,), mass=mass, center_of_mass=center, inertia=max(inertia, 0.0))
