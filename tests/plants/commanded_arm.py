"""A small arm under gravity whose second link bends in a joint that no motor drives, with limits, and moves of it."""

from dataclasses import replace

import numpy as np

from elastid.robot import Body, Frame, Joint, Limits, Motor, Placement, Robot, Spring
from elastid.robot.simplified import with_joints
from elastid.use.moves import Move, point_to_point

START, END = np.radians([0.0, 40.0]), np.radians([35.0, 15.0])


def arm(torque: float = 900.0, stiffness: float = 1.0, friction: float = 0.05) -> Robot:
    """stiffness: a factor on all springs.  friction: Coulomb's, motor side."""
    limits = Limits(velocity=3.0, torque=torque, angle=(-2.0, 2.0))
    motor = Motor(2e-3, 100, 1e-3, friction)
    return Robot(
        "arm",
        (
            Body("upper", joints=(Joint("1", "z", Spring(6e4 * stiffness, 80.0), motor, limits=limits),), mass=20,
                 center_of_mass=(0.3, 0, 0), inertia=1.0),
            Body("fore", "upper", Placement((0.6, 0, 0)), (
                Joint("2", "y", Spring(4e4 * stiffness, 60.0), motor, limits=limits),
                Joint("2z", "z", Spring(2e4 * stiffness, 20.0)),
            ), 12, (0.3, 0, 0.02), 0.5),
        ),
        frames=(Frame("tool", "fore", Placement((0.6, 0, 0))),),
    )  # fmt: skip


def move(duration: float) -> Move:
    return point_to_point(START, END, duration)


def rigid_gears(robot: Robot) -> Robot:
    """The same with rigid gears; its elastic joint stays."""
    return with_joints(robot, lambda joint: joint if joint.motor is None else replace(joint, spring=None))
