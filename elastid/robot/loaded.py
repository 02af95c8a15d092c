"""A robot that carries a point mass at its last frame."""

from __future__ import annotations

from dataclasses import replace

from elastid.base.errors import StudyError
from elastid.base.escape import unused
from elastid.robot.body import Body
from elastid.robot.robot import Robot


def with_point_mass(robot: Robot, mass: float) -> Robot:
    """The robot with a further mass in kg at the origin of its last frame, beside its own payload.

    Raises StudyError for a robot without frames.
    """
    if not mass:
        return robot
    if not robot.frames:
        raise StudyError(
            f"robot {robot.name} has no frame that could carry {mass:g} kg; give it frames: [{{name: tool}}]"
        )
    seat = robot.frames[-1]
    name = unused("point_mass", [body.name for body in robot.all_bodies])
    return replace(robot, bodies=(*robot.bodies, Body(name, seat.body, seat.placement, mass=mass)))
