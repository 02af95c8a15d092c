"""Logs of motions -> for each joint the regression of its motions, and the passes that they hold.

A joint that moved alone is regressed with its inertia and gravity, joints that moved together beside the rigid body
that they carry; the passes of the latter are free of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_fit.detection import detect_passes, lone_plateaus
from elastid.friction_fit.law_choice import MIN_SPEEDS, TEMPERATURE_STEP_K
from elastid.friction_fit.motion import MotionFriction, regress_motion
from elastid.friction_fit.motion_signals import Motion
from elastid.friction_fit.plateaus import SAME_SPEED
from elastid.friction_fit.plausibility import check_sides, check_torques, turns_against_gravity
from elastid.friction_fit.robot_motion import RobotLog, regress_robot_motion, torques_in_file
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.robot import Joint, Robot


@dataclass(frozen=True)
class JointMotion:
    """Of one joint: the regression (None where its logs cannot tell it), the passes in its logs, and notes.

    has_gravity: whether gravity that changes with the angle is in the passes.
    """

    friction: MotionFriction | None
    passes: tuple[FrictionRecord, ...]
    has_gravity: bool
    notes: tuple[Note, ...]


def evaluate_motions(robot: Robot, joints: Sequence[Joint], measured: FrictionRecords) -> Mapping[str, JointMotion]:
    """The motions of each joint that has some; where it moved alone and with others, alone counts.

    Raises DataError where the logs of a joint give neither a regression nor passes, where torque and angle are of
    different sides, and where friction drives.
    """
    logs: dict[str, dict[str, FrictionRecord]] = {}
    for record in measured.records:
        if record.purpose == "motion":
            logs.setdefault(record.name, {})[record.joint] = record
    found = _together(robot, [log for log in logs.values() if len(log) > 1])
    for joint in joints:
        alone = [log[joint.name] for log in logs.values() if len(log) == 1 and joint.name in log]
        if alone:
            found[joint.name] = _alone(robot, joint, alone)
    return found


def _alone(robot: Robot, joint: Joint, records: Sequence[FrictionRecord]) -> JointMotion:
    against = turns_against_gravity(robot, joint, records[0].configuration)
    problems: list[str] = []
    passes: list[FrictionRecord] = []
    notes: list[Note] = []
    friction = None
    for record in records:
        try:
            passes += (own := detect_passes(record, against))
            notes += lone_plateaus(record, own)
        except DataError as error:
            problems.append(str(error))
    try:
        friction = regress_motion(*(_motion(record, against) for record in records))
    except DataError as error:
        problems.append(str(error))
    enough = _enough(passes)
    if friction is None and not enough:
        raise DataError(problems[0])
    if friction is not None:
        inertia, std = friction.chosen["inertia"], friction.chosen.std("inertia")
        check_sides(robot, joint, inertia, std, records[0].configuration, records[0].place)
    notes += [Note("not-evaluated", problem) for problem in problems]
    return JointMotion(friction, enough, against, tuple(notes))


def _together(robot: Robot, logs: Sequence[Mapping[str, FrictionRecord]]) -> dict[str, JointMotion]:
    """Logs of the same joints are regressed at once."""
    groups: dict[tuple[str, ...], list[Mapping[str, FrictionRecord]]] = {}
    for log in logs:
        groups.setdefault(tuple(log), []).append(log)
    found: dict[str, JointMotion] = {}
    for joints, members in groups.items():
        robot_logs = [_robot_log(robot, log) for log in members]
        for log, one in zip(members, robot_logs, strict=True):
            measured = {joint: record.torque for joint, record in log.items()}
            check_torques(robot, measured, torques_in_file(robot, one), next(iter(log.values())).place)
        result = regress_robot_motion(robot, robot_logs)
        for joint in joints:
            records = [
                replace(log[joint], torque=alone[joint].torque)
                for log, alone in zip(members, result.alone, strict=True)
            ]
            passes = [each for record in records for each in detect_passes(record, has_gravity=False)]
            friction = result.friction[joint]
            found[joint] = JointMotion(friction, _enough(passes), False, friction.notes)
    return found


def _enough(passes: Sequence[FrictionRecord]) -> tuple[FrictionRecord, ...]:
    """The passes where they tell more than the regression: of a stated speed, or of enough conditions for a curve."""
    conditions = {
        (
            round(np.log(each.speed or 1.0) / SAME_SPEED),
            each.load,
            round(float(np.nan_to_num(each.mean_temperature)) / TEMPERATURE_STEP_K),
        )
        for each in passes
    }
    return tuple(passes) if len(conditions) >= MIN_SPEEDS else ()


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
