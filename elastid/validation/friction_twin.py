"""The torque of motions in a study of friction, part by part: what the regression of each joint explains of its log.

A joint that moved alone has inertia and gravity of its own; of joints that moved together the rigid body is what their
regression took out of the log, gravity and offset with it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.friction_study.motion import MotionFriction, MotionSignals, motion_parts
from elastid.friction_study.result import JointFriction
from elastid.record import drive_unit
from elastid.validation.twin import DRY, GRAVITY, INERTIA, RIGID_BODY, VISCOUS, TorqueBalance, torque_balance

# Number of a regression: the part that it belongs to.
PART_OF = {
    "inertia": INERTIA,
    "gravity.cos": GRAVITY,
    "gravity.sin": GRAVITY,
    "offset": GRAVITY,
    "viscous": VISCOUS,
    "directions.viscous": VISCOUS,
    "coulomb": DRY,
    "directions.coulomb": DRY,
}


def friction_balances(joints: Iterable[JointFriction], measured: FrictionRecords) -> tuple[TorqueBalance, ...]:
    """Of every joint with a regression of its motions, over its first log, in the passband of the regression."""
    return tuple(
        _balance(joint.motion, _record_of(joint.motion, measured.of(joint.joint, "motion")))
        for joint in joints
        if joint.motion is not None
    )


def _record_of(motion: MotionFriction, records: Iterable[FrictionRecord]) -> FrictionRecord:
    """The log of a regression, whose torque holds the rigid body."""
    return next(record for record in records if np.array_equal(record.position, motion.motion.position))


def _balance(found: MotionFriction, record: FrictionRecord) -> TorqueBalance:
    signals = MotionSignals.of(found.motion, found.passband_hz)
    parts: dict[str, FloatArray] = {}
    if "inertia" not in found.chosen.names:
        parts[RIGID_BODY] = signals.filtered(record.torque - found.motion.torque)
    numbers = motion_parts(found, signals)
    for name in sorted(numbers, key=list(PART_OF).index):
        parts[PART_OF[name]] = parts.get(PART_OF[name], 0.0) + numbers[name]
    rate_hz = record.rate_hz / int(signals.kept.step)
    torque, band_hz = signals.filtered(record.torque), (0.0, found.passband_hz)
    return torque_balance(
        f"joint {record.joint}", record.name, drive_unit(record.slides), rate_hz, torque, parts, band_hz
    )
