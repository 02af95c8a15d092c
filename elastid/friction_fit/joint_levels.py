"""Records of a friction study -> levels of passes and regressions of motions, joint by joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.errors import DataError
from elastid.friction_fit.angle_dependence import angle_note
from elastid.friction_fit.joint_motions import JointMotion, evaluate_motions
from elastid.friction_fit.load_levels import levels_of_records
from elastid.friction_fit.loop_counts import check_counts
from elastid.friction_fit.plausibility import turns_against_gravity
from elastid.friction_fit.record_passes import passes_of
from elastid.friction_fit.result import JointLevels
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.robot import Joint, Robot


def find_joint_levels(robot: Robot, joints: Sequence[Joint], measured: FrictionRecords) -> tuple[JointLevels, ...]:
    """Levels and motions of each joint that was measured.

    Raises DataError where passes or motions of a joint cannot be evaluated, and where a joint has neither.
    """
    motions = evaluate_motions(robot, joints, measured)
    return tuple(_of_joint(robot, joint, measured, motions.get(joint.name)) for joint in joints)


def _of_joint(robot: Robot, joint: Joint, measured: FrictionRecords, motion: JointMotion | None) -> JointLevels:
    # Test passes of a warm-up tell what temperature does; without a thermometer they are at unlike conditions.
    planned = [r for r in measured.of(joint.name, "passes") if not r.is_warm_up or np.isfinite(r.mean_temperature)]
    records = [*planned, *(motion.passes if motion is not None else ())]
    own = [record for record in measured.records if record.joint == joint.name]
    notes = [note for record in own for note in record.notes]
    notes += [note for record in own if record.purpose == "loops" for note in check_counts(record)]
    if motion is not None:
        notes += motion.notes
    friction = motion.friction if motion is not None else None
    if not records and friction is None:
        raise DataError(
            f"joint {joint.name}: neither passes nor a motion were recorded; leave it out of friction.joints, or "
            "record them"
        )
    if not records:
        return JointLevels(joint.name, joint.slides, motion=friction, notes=tuple(notes))
    against = turns_against_gravity(robot, joint, planned[0].configuration) if planned else False
    has_gravity = against or (motion is not None and motion.has_gravity)
    found = levels_of_records(records, has_gravity, motor_turn(joint))
    passes = [each for record in records if record.load == records[0].load for each in passes_of(record)]
    by_angle = angle_note(passes, found.shared.get("inertia", (0.0, 0.0))[0])
    notes += [*found.notes, *([] if by_angle is None else [by_angle])]
    return JointLevels(joint.name, joint.slides, found, friction, _example(records), tuple(notes))


def motor_turn(joint: Joint) -> float:
    """Angle (path) of the joint for one turn of its motor."""
    return 2 * np.pi / abs(joint.motor.ratio) if joint.motor is not None else 0.0


def _example(records: Sequence[FrictionRecord]) -> FrictionRecord:
    """The pass of the middle speed."""
    ordered = sorted(records, key=lambda record: record.speed or 0.0)
    return ordered[len(ordered) // 2]
