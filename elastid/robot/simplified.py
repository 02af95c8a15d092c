"""Simplified robots: with rigid coordinates, without motor coupling or friction, with a point mass."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any, Literal

from elastid.base.errors import StudyError
from elastid.base.escape import unique_name
from elastid.robot.body import Body
from elastid.robot.connections import Loop
from elastid.robot.joint import Joint
from elastid.robot.robot import Robot
from elastid.robot.spring import Spring


@dataclass(frozen=True)
class ElasticCoordinate:
    """Elastic coordinate that can be made rigid, with the name of its joint or loop.

    kind: `gear` of a driven joint, including the shaft of its motor; `joint` without motor; `rod` of a loop.
    """

    name: str
    kind: Literal["gear", "joint", "rod"]

    @property
    def label(self) -> str:
        """`gear 2`, `2x`, `rod pull`: in tables and messages."""
        return self.name if self.kind == "joint" else f"{self.kind} {self.name}"


def elastic_coordinates(robot: Robot) -> tuple[ElasticCoordinate, ...]:
    """List the elastic coordinates of a robot: joints in order, then rods."""
    joints = [
        ElasticCoordinate(joint.name, "joint" if joint.motor is None else "gear")
        for joint in robot.joints
        if joint.spring is not None or joint.is_flexible
    ]
    rods = [ElasticCoordinate(loop.name, "rod") for loop in robot.loops if loop.rod is not None and loop.rod.is_elastic]
    return (*joints, *rods)


def with_stiff_joints(robot: Robot, names: Collection[str]) -> Robot:
    """Return the robot without the springs of these coordinates.

    The rotor of a driven joint is then rigidly coupled to it. A joint without motor is removed, with its locations. A
    rod keeps its length and mass.  StudyError for a name that is no elastic coordinate.
    """
    elastic = [coordinate.name for coordinate in elastic_coordinates(robot)]
    for name in names:
        if name not in elastic:
            kind = "loop" if any(loop.name == name for loop in robot.loops) else "joint"
            raise StudyError(
                "robot/no-spring",
                f"{kind} {name} has no spring to be left out; elastic joints and rods of robot {robot.name}: "
                f"{', '.join(elastic)}",
            )

    def rigid(joint: Joint) -> Joint | None:
        if joint.name not in names:
            return joint
        return None if joint.motor is None else replace(_with_motor(joint, spring=None), spring=None, gear=None)

    def stiff(loop: Loop) -> Loop:
        if loop.rod is None or loop.name not in names:
            return loop
        return replace(loop, rod=replace(loop.rod, stiffness=None, damping=0.0))

    try:
        return replace(with_joints(robot, rigid), loops=tuple(map(stiff, robot.loops)))
    except ValueError as error:
        raise StudyError("robot/no-spring", str(error), f"without the springs of {', '.join(names)}") from None


def without_motor_coupling(robot: Robot) -> Robot:
    """Return the robot with rotors that only rotate about their own axes: the reduced model of Spong."""
    return with_joints(robot, lambda joint: _with_motor(joint, on="", axis=None))


def without_dry_friction(robot: Robot) -> Robot:
    """Return the robot with viscous friction only, in motors, gears and joints."""

    def smooth(joint: Joint) -> Joint:
        gear = None if joint.gear is None else replace(joint.gear, load=0.0, hysteresis=())
        return replace(_with_motor(joint, coulomb=0.0, friction=None), friction=None, gear=gear)

    return with_joints(robot, smooth)


def without_friction(robot: Robot) -> Robot:
    """Return the robot without viscous and dry friction of motors and joints."""
    return with_joints(without_dry_friction(robot), lambda joint: replace(_with_motor(joint, viscous=0.0), viscous=0.0))


def with_straight_springs(robot: Robot) -> Robot:
    """Return the robot with linear springs of stiffness k in its gears, without backlash."""

    def straight(joint: Joint) -> Joint:
        if joint.motor is None or joint.spring is None:
            return joint
        return replace(joint, spring=Spring(joint.spring.stiffness, joint.spring.damping))

    return with_joints(robot, straight)


def with_joints(robot: Robot, change: Callable[[Joint], Joint | None]) -> Robot:
    """Return the robot with changed joints; None removes a joint."""
    bodies = ((body, tuple(filter(None, map(change, body.joints)))) for body in robot.bodies)
    return replace(robot, bodies=tuple(replace(body, joints=joints) for body, joints in bodies))


def _with_motor(joint: Joint, **changes: Any) -> Joint:
    return joint if joint.motor is None else replace(joint, motor=replace(joint.motor, **changes))


def with_point_mass(robot: Robot, mass: float) -> Robot:
    """Return the robot with an additional mass in kg at the origin of its last frame.

    Raises StudyError for a robot without frames.
    """
    if not mass:
        return robot
    if not robot.frames:
        raise StudyError(
            "robot/unknown-name",
            f"robot {robot.name} has no frame for the mass of {mass:g} kg. Add one: "
            f"`frames: [{{name: tool, body: {robot.bodies[-1].name}}}]`",
        )
    seat = robot.frames[-1]
    name = unique_name("point_mass", [body.name for body in robot.all_bodies])
    return replace(robot, bodies=(*robot.bodies, Body(name, seat.body, seat.placement, mass=mass)))
