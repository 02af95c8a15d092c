"""Records of a friction study -> levels of passes and regressions of motions, joint by joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elastid.base.errors import DataError
from elastid.friction_fit.motion import MotionFriction, regress_motion
from elastid.friction_fit.motion_signals import Motion
from elastid.friction_fit.pass_levels import find_levels
from elastid.friction_fit.record_passes import passes_of
from elastid.friction_fit.result import JointLevels
from elastid.friction_fit.robot_motion import RobotLog, regress_robot_motion
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.model.rigid_body import inverse_dynamics
from elastid.record import Configuration
from elastid.robot import Joint, Robot

# Of the largest torque of gravity at a joint, below which a change with its angle is rounding.
ROUNDING = 1e-9
# Angles at which gravity is compared: no two of them alike, whatever its phase.
GRAVITY_ANGLES = (0.0, 1.1, 2.3)


def find_joint_levels(robot: Robot, joints: Sequence[Joint], measured: FrictionRecords) -> tuple[JointLevels, ...]:
    """Levels and motions of each joint that was measured.

    Raises DataError where passes or motions of a joint cannot be evaluated, and where a joint has neither.
    """
    motions = _motions(robot, joints, measured)
    return tuple(_of_joint(robot, joint, measured, motions.get(joint.name)) for joint in joints)


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


def _of_joint(robot: Robot, joint: Joint, measured: FrictionRecords, motion: MotionFriction | None) -> JointLevels:
    records = [record for record in measured.of(joint.name, "passes") if not record.is_warm_up]
    notes = tuple(note for record in measured.records if record.joint == joint.name for note in record.notes)
    if not records and motion is None:
        raise DataError(
            f"joint {joint.name}: neither passes nor a motion were recorded; leave it out of friction.joints, or "
            "record them"
        )
    if not records:
        return JointLevels(joint.name, joint.slides, motion=motion, notes=notes)
    passes = [each for record in records for each in passes_of(record)]
    found = find_levels(passes, turns_against_gravity(robot, joint, records[0].configuration), motor_turn(joint))
    return JointLevels(joint.name, joint.slides, found, motion, _example(records), (*notes, *found.notes))


def motor_turn(joint: Joint) -> float:
    """Angle (path) of the joint for one turn of its motor."""
    return 2 * np.pi / abs(joint.motor.ratio) if joint.motor is not None else 0.0


def _example(records: Sequence[FrictionRecord]) -> FrictionRecord:
    """The pass of the middle speed."""
    ordered = sorted(records, key=lambda record: record.speed or 0.0)
    return ordered[len(ordered) // 2]


def _motions(robot: Robot, joints: Sequence[Joint], measured: FrictionRecords) -> Mapping[str, MotionFriction]:
    """The regression of each joint's motions: alone where it moved alone, beside the rigid body where others did."""
    logs: dict[str, dict[str, FrictionRecord]] = {}
    for record in measured.records:
        if record.purpose == "motion":
            logs.setdefault(record.name, {})[record.joint] = record
    together = [log for log in logs.values() if len(log) > 1]
    found: dict[str, MotionFriction] = {}
    if together:
        found |= regress_robot_motion(robot, [_robot_log(robot, log) for log in together]).friction
    for joint in joints:
        alone = [log[joint.name] for log in logs.values() if len(log) == 1 and joint.name in log]
        if alone:
            against = turns_against_gravity(robot, joint, alone[0].configuration)
            found[joint.name] = regress_motion(*(_motion(record, against) for record in alone))
    return found


def _robot_log(robot: Robot, log: Mapping[str, FrictionRecord]) -> RobotLog:
    first = next(iter(log.values()))
    angles = np.zeros(len(robot.driven)) if first.configuration is None else first.configuration.angles
    resting = {
        joint.name: float(angle) for joint, angle in zip(robot.driven, angles, strict=True) if joint.name not in log
    }
    return RobotLog({joint: _motion(record, False) for joint, record in log.items()}, resting)


def _motion(record: FrictionRecord, against_gravity: bool) -> Motion:
    place = f"joint {record.joint}"
    return Motion(place, record.rate_hz, record.position, record.torque, record.slides, against_gravity)
