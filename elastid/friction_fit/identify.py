"""Levels and records of a friction study -> the friction of each joint: law, presliding, warm-up, table of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.errors import DataError, FitError
from elastid.base.note import Note
from elastid.friction_fit.before_sliding import BeforeSliding, find_before_sliding
from elastid.friction_fit.joint_law import joint_law
from elastid.friction_fit.levels import Levels
from elastid.friction_fit.numbers import (
    Truth,
    numbers_at_rest,
    numbers_of_bristles,
    numbers_of_heat,
    numbers_of_law,
    numbers_of_motion,
)
from elastid.friction_fit.result import FrictionNumber, FrictionResult, JointFriction, JointLevels, Status
from elastid.friction_fit.spec import FrictionSpec
from elastid.friction_fit.static_law import StaticLaw
from elastid.friction_fit.truth import true_numbers
from elastid.friction_fit.warm_up import ThermalModel, WarmUp, fit_warm_up, level_over_heat
from elastid.friction_fit.warm_up_records import warm_up_of
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.robot import Friction, Robot

# Numbers of a joint that the sentence on it has.
SAID = 4


def identify_friction(
    robot: Robot,
    levels: Sequence[JointLevels],
    measured: FrictionRecords,
    spec: FrictionSpec,
    truth: Robot | None = None,
) -> FrictionResult:
    """The friction of all joints; truth: the robot that was simulated.

    Raises FitError where a part of the law that is asked for (`yes`) cannot be told.
    """
    joints = tuple(_joint(robot, each, measured, spec, truth) for each in levels)
    status: Status = "partly" if any(joint.missing for joint in joints) else "identified"
    if all(joint.friction is None for joint in joints):
        status = "failed"
    return FrictionResult(joints, measured.notes, status, "; ".join(map(_sentence, joints)))


def _joint(
    robot: Robot, found: JointLevels, measured: FrictionRecords, spec: FrictionSpec, truth: Robot | None
) -> JointFriction:
    """All parts of one joint."""
    name, passes = found.joint, found.levels
    static = StaticLaw.of(_of_loads(passes.levels, measured.of(name, "passes")), spec.law) if passes else None
    loops, rest = measured.of(name, "loops"), measured.of(name, "at_rest")
    before = find_before_sliding(robot, loops, rest, passes, static, spec)
    warm_up, thermal, notes = _heat(name, measured, static)
    friction, viscous, refused = _law(found, static, before, spec)
    true = {} if truth is None else true_numbers(truth, name, static)
    numbers = {each.name: each for each in _numbers(found, static, before, true)}
    if warm_up is not None and thermal is not None:
        numbers |= {each.name: each for each in numbers_of_heat(name, thermal, warm_up)}
    held = static.held if static is not None else found.motion.held if found.motion is not None else ()
    return JointFriction(
        name, found.slides, passes, found.motion, static, before.presliding, before.loops, before.at_rest,
        before.bristles, thermal, warm_up, friction, viscous, tuple(numbers.values()), held, found.example,
        (*found.notes, *before.notes, *notes, *refused),
    )  # fmt: skip


def _of_loads(levels: Levels, records: Sequence[FrictionRecord]) -> Levels:
    """The levels, of one load under their mean load: what its paths differ in goes with the speed and tells no load."""
    if len({record.load for record in records}) > 1:
        return levels
    return replace(levels, load=np.full_like(levels.load, levels.load.mean()))


def _law(
    found: JointLevels, static: StaticLaw | None, before: BeforeSliding, spec: FrictionSpec
) -> tuple[Friction | None, float | None, tuple[Note, ...]]:
    """The law and the viscous friction beside it; a note where the numbers are those of no contact."""
    try:
        law = joint_law(static, found.motion, before, spec.law)
        if law is not None:
            law[0].check_passive(law[1], found.slides)
    except ValueError as error:
        text = f"its numbers make no law for a robot's file: {error}; more or quieter levels tell them better"
        return None, None, (Note("no-law", text, f"joint {found.joint}"),)
    return (*(law or (None, None)), ())


def _numbers(
    found: JointLevels, static: StaticLaw | None, before: BeforeSliding, truth: Truth
) -> Iterator[FrictionNumber]:
    """The table; of a number that two experiments tell the later one counts, passes more than a motion."""
    if static is not None:
        yield from numbers_of_law(found.joint, static, truth)
    if found.motion is not None:
        yield from _beside(numbers_of_motion(found.joint, found.motion, truth), static)
    if before.at_rest is not None:
        yield from numbers_at_rest(found.joint, before.at_rest, found.slides, truth)
    if before.bristles is not None:
        yield from numbers_of_bristles(found.joint, before.bristles, found.slides, truth)


def _beside(numbers: Iterator[FrictionNumber], static: StaticLaw | None) -> Iterator[FrictionNumber]:
    """Numbers of a motion that are no friction, and all where no passes tell friction."""
    return (each for each in numbers if static is None or each.symbol in ("J", "o", "G", "H"))


def _heat(
    joint: str, measured: FrictionRecords, static: StaticLaw | None
) -> tuple[WarmUp | None, ThermalModel | None, tuple[Note, ...]]:
    """The joint's warm-up with its thermal model, or the note on why there is none."""
    log = next((log for log in measured.warm_ups if log.joint == joint), None)
    if log is None:
        return None, None, ()
    try:
        warm_up = warm_up_of(log, [record for record in measured.of(joint, "passes") if record.is_warm_up])
        return warm_up, fit_warm_up(warm_up, level_over_heat(static, warm_up)), ()
    except (DataError, FitError) as error:
        return None, None, (Note("no-warm-up", str(error), f"warm-up of joint {joint}"),)


def _sentence(joint: JointFriction) -> str:
    parts = [f"{number.symbol} = {number.value:.4g} {number.unit}" for number in joint.numbers[:SAID]]
    return f"joint {joint.joint}: {', '.join(parts) or 'nothing was found'}"
