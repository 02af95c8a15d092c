r"""What the robot's file knows of a joint alone: whether gravity turns against it, and its inertia.

.. math:: J = J_m n^2 + M_{jj}(q)

An angle or a torque of the motor that is taken for one of the joint makes the inertia of a log wrong by the ratio n of
the gear, both by n^2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.model.rigid_body import inverse_dynamics
from elastid.record import Configuration
from elastid.robot import Joint, Robot

# Gears below have sides that differ by no more than masses may be wrong.
SMALLEST_RATIO = 10.0
# Stds by which an inertia differs from the robot's before it counts.
CERTAIN_STDS = 3.0
# By so much an inertia may miss a power of the ratio.
CLOSE_FACTOR = 4.0
# Of a torque with that of the robot's file: below, friction or errors of the file make most of it.
MIN_CORRELATION = 0.5
# Of the largest torque of gravity at a joint, below which a change with its angle is rounding.
ROUNDING = 1e-9
# Angles at which gravity is compared: no two of them alike, whatever its phase.
GRAVITY_ANGLES = (0.0, 1.1, 2.3)


def check_sides(
    robot: Robot, joint: Joint, inertia: float, std: float, posture: Configuration | None, place: str
) -> None:
    """DataError where a measured inertia (kg m^2, of a slide kg) is wrong by as much as the ratio of the gear.

    It counts where it is known, and close to a power of the ratio times the robot's.
    """
    if joint.motor is None or abs(joint.motor.ratio) < SMALLEST_RATIO:
        return
    ratio, known = abs(joint.motor.ratio), joint_inertia(robot, joint, posture)
    wrong = inertia / known if known > 0 else 1.0
    if abs(inertia - known) < CERTAIN_STDS * std or wrong <= 0:
        return
    power = round(math.log(wrong) / math.log(ratio))
    if power == 0 or abs(math.log(wrong) - power * math.log(ratio)) > math.log(CLOSE_FACTOR):
        return
    unit = "kg" if joint.slides else "kg*m^2"
    many = "torque and angle are" if abs(power) > 1 else "either torque or angle is"
    advice = (
        f"{many} of the motor: give the channel side: motor"
        if wrong < 1
        else f"{many} of the joint, but marked side: motor: leave that out"
    )
    raise DataError(
        f"{place}: the motion gives joint {joint.name} an inertia of {inertia:.4g} {unit}, the robot's file "
        f"{known:.4g}: {wrong:.3g} times as much, and the gear's ratio is {ratio:.4g}; {advice}, or correct its unit"
    )


def check_torques(
    robot: Robot, measured: Mapping[str, FloatArray], expected: Mapping[str, FloatArray], place: str
) -> None:
    """DataError where torques (n,) by joint are as small or large as those of the other side of the gears.

    expected: by the robot's file.  Joints count whose torque follows it, and the middle one of them decides.
    """
    powers = []
    for joint, torque in measured.items():
        known, ratio = expected[joint], abs(robot.ratio(joint))
        size = float(np.linalg.norm(known))
        follows = float(torque @ known) / max(size * float(np.linalg.norm(torque)), 1e-300)
        if ratio >= SMALLEST_RATIO and follows > MIN_CORRELATION:
            powers.append(math.log(float(torque @ known) / size**2) / math.log(ratio))
    power = float(np.median(powers)) if powers else 0.0
    if round(power) == 0:
        return
    advice = "of the motors: give their channels side: motor" if power < 0 else "of the joints: leave side: motor out"
    raise DataError(
        f"{place}: torques are {'smaller' if power < 0 else 'larger'} than those of the robot's file by about the "
        f"ratios of the gears (in the middle, by their power {power:.2f}): they are {advice}, or correct their unit"
    )


def turns_against_gravity(robot: Robot, joint: Joint, posture: Configuration | None) -> bool:
    """Whether the torque of gravity at a joint changes with its angle, the others held; of a robot with loops yes."""
    if joint.slides:
        return False
    if robot.loops:
        return True
    names = [each.name for each in robot.joints]
    theta = np.array([value for value, _ in robot.parameters().values()])
    tau, zero = inverse_dynamics(robot), np.zeros(len(names))
    held = np.zeros(len(names))
    if posture is not None:
        held[list(robot.driven_indices)] = posture.angles
    turned = held + np.outer(GRAVITY_ANGLES, np.array([name == joint.name for name in names]))
    found = [float(np.asarray(tau(q, zero, zero, theta))[names.index(joint.name), 0]) for q in turned]
    return bool(np.ptp(found) > ROUNDING * max(1.0, *map(abs, found)))


def joint_inertia(robot: Robot, joint: Joint, posture: Configuration | None) -> float:
    """Inertia that a motor drives with the others held, link side; of a robot with loops the rotor's alone."""
    motor = joint.motor
    rotor = motor.inertia * motor.ratio**2 if motor is not None else 0.0
    if robot.loops:
        return rotor
    names = [each.name for each in robot.joints]
    q, zero, one = np.zeros((3, len(names)))
    one[names.index(joint.name)] = 1.0
    if posture is not None:
        q[list(robot.driven_indices)] = posture.angles
    theta, tau = [value for value, _ in robot.parameters().values()], inverse_dynamics(robot)
    torque = np.asarray(tau(q, zero, one, theta)) - np.asarray(tau(q, zero, zero, theta))
    return rotor + float(torque[names.index(joint.name), 0])
