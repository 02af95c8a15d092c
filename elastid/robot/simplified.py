"""Robots derived from a robot: rigid coordinates, no motor coupling, a point mass at the last frame."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Literal

from elastid.base.errors import StudyError
from elastid.base.escape import unused
from elastid.robot.body import Body
from elastid.robot.joint import Joint
from elastid.robot.loop import Loop
from elastid.robot.motor import Motor
from elastid.robot.robot import Robot


@dataclass(frozen=True)
class ElasticCoordinate:
    """A deflection with a spring, which can be rigid instead.  name: of its joint, or of its loop.

    kind: `gear` of of a driven joint, with its own spring and that of the motor's shaft; `joint` that is not driven;
    `rod` of a loop.
    """

    name: str
    kind: Literal["gear", "joint", "rod"]

    @property
    def label(self) -> str:
        """`gear 2`, `2x`, `rod pull`: in tables and messages."""
        return self.name if self.kind == "joint" else f"{self.kind} {self.name}"


def elastic_coordinates(robot: Robot) -> tuple[ElasticCoordinate, ...]:
    """All of them: joints in the robot's order, then rods."""
    joints = [
        ElasticCoordinate(joint.name, "joint" if joint.motor is None else "gear")
        for joint in robot.joints
        if joint.spring is not None or joint.is_flexible
    ]
    rods = [ElasticCoordinate(loop.name, "rod") for loop in robot.loops if loop.rod is not None and loop.rod.is_elastic]
    return (*joints, *rods)


def further_elastic(robot: Robot) -> tuple[str, ...]:
    """The elastic joints that are not driven, which make the flexible joint model an extended one."""
    return tuple(coordinate.name for coordinate in elastic_coordinates(robot) if coordinate.kind == "joint")


def stiffened(robot: Robot, names: Collection[str]) -> Robot:
    """The robot without the springs of these coordinates and their parameters.

    A driven joint turns with its rotor: ratio^2 times its inertia on the joint, with its friction; where gears couple
    axes, with the contributions of the other motors. A joint that is not driven is left out, and so are its places. A
    rod keeps its length and its mass.
    StudyError for a name that is not one of an elastic coordinate.
    """
    elastic = [coordinate.name for coordinate in elastic_coordinates(robot)]
    for name in names:
        if name not in elastic:
            kind = "loop" if any(loop.name == name for loop in robot.loops) else "joint"
            raise StudyError(
                f"{kind} {name} has no spring to be left out; elastic joints and rods of robot {robot.name}: "
                f"{', '.join(elastic)}"
            )
    try:
        rigid = _with_joints(robot, lambda joint: _rigid(joint) if joint.name in names else joint)
        return replace(rigid, loops=tuple(_stiff(loop) if loop.name in names else loop for loop in robot.loops))
    except ValueError as error:
        raise StudyError(f"without the springs of {', '.join(names)}: {error}") from None


def without_motor_coupling(robot: Robot) -> Robot:
    """Every rotor turns about its own axis only: the reduced model of Spong."""
    return _with_joints(robot, lambda joint: replace(joint, motor=_alone(joint)))


def without_dry_friction(robot: Robot) -> Robot:
    """Motors and joints with their viscous friction alone."""

    def smooth(joint: Joint) -> Joint:
        motor = None if joint.motor is None else replace(joint.motor, coulomb=0.0, friction=None)
        return replace(joint, friction=None, motor=motor)

    return _with_joints(robot, smooth)


def without_friction(robot: Robot) -> Robot:
    """Motors and joints without viscous and dry friction."""

    def free(joint: Joint) -> Joint:
        motor = None if joint.motor is None else replace(joint.motor, viscous=0.0)
        return replace(joint, viscous=0.0, motor=motor)

    return _with_joints(without_dry_friction(robot), free)


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


def _stiff(loop: Loop) -> Loop:
    return loop if loop.rod is None else replace(loop, rod=replace(loop.rod, stiffness=None, damping=0.0))


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
