"""The same robot, simpler: motors that ride on nothing, joints that do not give way."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

from elastid.errors import StudyError
from elastid.robot.assembly import Robot
from elastid.robot.body import Body
from elastid.robot.joint import Joint
from elastid.robot.motor import Motor


def without_motor_coupling(robot: Robot) -> Robot:
    """Every rotor turns about its own axis only: the reduced model of Spong."""
    return _with_joints(robot, lambda joint: replace(joint, motor=_alone(joint)))


def stiffened(robot: Robot, joints: Collection[str]) -> Robot:
    """Without the springs of these joints: a driven one turns with its motor, any other is not there.

    StudyError for a joint that is not there or has no spring, and where a coupled gear would be left half rigid.
    """
    elastic = [joint.name for joint in robot.joints if joint.spring is not None or joint.is_flexible]
    for name in joints:
        if name not in elastic:
            raise StudyError(
                f"joint {name} has no spring that could be left out; elastic joints of robot {robot.name}: "
                f"{', '.join(elastic)}"
            )
    try:
        return _with_joints(robot, lambda joint: _rigid(joint) if joint.name in joints else joint)
    except ValueError as error:
        raise StudyError(f"without the springs of {', '.join(joints)}: {error}") from None


def further_elastic(robot: Robot) -> tuple[str, ...]:
    """The joints that are elastic but not driven: what the extended flexible joint model has beyond the plain one."""
    return tuple(joint.name for joint in robot.joints if joint.spring is not None and joint.motor is None)


def _with_joints(robot: Robot, changed: Callable[[Joint], Joint | None]) -> Robot:
    def of(body: Body) -> Body:
        return replace(body, joints=tuple(new for joint in body.joints if (new := changed(joint)) is not None))

    return replace(robot, bodies=tuple(of(body) for body in robot.bodies))


def _alone(joint: Joint) -> Motor | None:
    return None if joint.motor is None else replace(joint.motor, on="", axis=None)


def _rigid(joint: Joint) -> Joint | None:
    if joint.motor is None:
        return None
    return replace(joint, spring=None, motor=replace(joint.motor, spring=None))
