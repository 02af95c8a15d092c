"""Levels and records of a friction study -> the friction of each joint: law, presliding, warm-up, table of numbers.

The law of a joint as a whole, as a robot's file has it, has sliding from passes or a motion, and before it Maxwell slip
from loops or LuGre's bristles from responses at rest. A part that fails leaves a note instead: the rest of the
friction does not depend on it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.errors import DataError, FitError, Note
from elastid.friction_study.laws import StaticLaw, friction_of
from elastid.friction_study.motion import MotionFriction
from elastid.friction_study.presliding import AtRest, Elements, fit_at_rest, fit_presliding, rest_responses
from elastid.friction_study.result import (
    FrictionNumber,
    FrictionResult,
    JointFriction,
    JointLevels,
    Status,
    Truth,
    number_of_gain,
    numbers_at_rest,
    numbers_of_heat,
    numbers_of_law,
    numbers_of_motion,
    true_numbers,
)
from elastid.friction_study.spec import FrictionSpec, LawSpec
from elastid.friction_study.warm_up import ThermalModel, WarmUp, fit_warm_up, warm_up_note, warm_up_of
from elastid.record import FrictionRecord, FrictionRecords
from elastid.robot import Friction, LuGre, MeasuredRange, Robot
from elastid.robot.friction import MAX_DAMPING_VELOCITY_RATIO
from elastid.simulation.elastic_joint import ElasticJoint, held_joint


def identify_friction(
    robot: Robot,
    levels: Sequence[JointLevels],
    measured: FrictionRecords,
    spec: FrictionSpec,
    truth: Robot | None = None,
) -> FrictionResult:
    """The friction of all joints; truth: the simulated robot.  FitError for a part that is `yes` and not identified."""
    joints = tuple(_joint(robot, each, measured, spec, truth) for each in levels)
    status: Status = "partly" if any(joint.missing for joint in joints) else "identified"
    if misfits := [f"joint {joint.joint}: {joint.misfit}" for joint in joints if joint.misfit]:
        status = "misfit"
    parts = [part for joint in joints for part in (joint.friction, joint.presliding, joint.at_rest, joint.thermal)]
    if all(part is None for part in parts):
        status = "failed"
    message = "; ".join([*misfits, *(f"joint {joint.joint}: {_first_numbers(joint)}" for joint in joints)])
    return FrictionResult(joints, measured.notes, status, message)


def _joint(
    robot: Robot, levels: JointLevels, measured: FrictionRecords, spec: FrictionSpec, truth: Robot | None
) -> JointFriction:
    name, passes = levels.joint, levels.levels
    static = None
    if passes:
        curve = passes.levels
        if len({record.load for record in measured.of(name, "passes")}) <= 1:  # it changes along the paths with speed
            curve = replace(curve, load=np.full_like(curve.load, curve.load.mean()))
        static = StaticLaw.of(curve, spec.law)
    loops, rest = measured.of(name, "loops"), measured.of(name, "at_rest")
    before = find_before_sliding(robot, loops, rest, static, spec)
    warm_up, thermal, notes = _heat(name, measured)
    friction, viscous, refused = _law(levels, static, before, spec)
    true = {} if truth is None else true_numbers(truth, name, static)
    numbers = {each.name: each for each in _numbers(levels, None if refused else static, before, true)}
    if warm_up is not None and thermal is not None:
        numbers |= {each.name: each for each in numbers_of_heat(name, thermal, warm_up)}
    held = static.held if static is not None else levels.motion.held if levels.motion is not None else ()
    return JointFriction(
        name, levels.slides, passes, levels.motion, static, before.presliding, before.at_rest,
        thermal, friction, viscous, tuple(numbers.values()), held,
        (*levels.notes, *before.notes, *notes, *refused),
    )  # fmt: skip


def _law(
    levels: JointLevels, static: StaticLaw | None, before: BeforeSliding, spec: FrictionSpec
) -> tuple[Friction | None, float | None, tuple[Note, ...]]:
    """The law and its viscous friction; a note where the numbers are physically impossible."""
    try:
        law = joint_law(static, levels.motion, before, spec.law)
        if law is not None:
            law[0].check_passive(law[1], levels.slides)
    except ValueError as error:
        text = f"its numbers make no law for a robot's file: {error}; more or quieter levels narrow them"
        return None, None, (Note("friction/law", text, f"joint {levels.joint}"),)
    return (*(law or (None, None)), ())


def _numbers(
    levels: JointLevels, static: StaticLaw | None, before: BeforeSliding, truth: Truth
) -> Iterator[FrictionNumber]:
    """The table; of a number that two experiments identify the later one counts, passes more than a motion."""
    if static is not None:
        yield from numbers_of_law(levels.joint, static, truth)
    if levels.motion is not None:
        for number in numbers_of_motion(levels.joint, levels.motion, truth):
            if static is None or number.symbol in ("J", "o", "G", "H"):
                yield number
    if levels.gain is not None:
        yield number_of_gain(levels.joint, *levels.gain)
    if before.at_rest is not None:
        yield from numbers_at_rest(levels.joint, before.at_rest, levels.slides, truth)


def _heat(joint: str, measured: FrictionRecords) -> tuple[WarmUp | None, ThermalModel | None, tuple[Note, ...]]:
    """The joint's warm-up with its thermal model, or the note on why there is none."""
    log = next((log for log in measured.warm_ups if log.joint == joint), None)
    if log is None:
        return None, None, ()
    try:
        warm_up = warm_up_of(log, [record for record in measured.of(joint, "passes") if record.is_warm_up])
        thermal = fit_warm_up(warm_up)
        return warm_up, thermal, warm_up_note(thermal, warm_up, f"warm-up of joint {joint}")
    except (DataError, FitError) as error:
        return None, None, (Note("friction/warm-up", str(error), f"warm-up of joint {joint}"),)


# Codes of notes that say why a part of the friction was not identified.
_REASONS = ("friction/law", "friction/presliding", "friction/at-rest", "friction/warm-up", "friction/no-record")


def _first_numbers(joint: JointFriction) -> str:
    numbers = ", ".join(f"{number.symbol} = {number.value:.4g} {number.unit}" for number in joint.numbers[:4])
    return numbers or next((note.text for note in joint.notes if note.code in _REASONS), "nothing was found")


def joint_law(
    static: StaticLaw | None, motion: MotionFriction | None, before: BeforeSliding, spec: LawSpec
) -> tuple[Friction, float] | None:
    """Friction and its viscous friction, link side; None where neither passes nor a motion identify it."""
    if static is not None:
        friction, viscous = static.to_friction(), static.viscous
    elif motion is not None and motion.chosen["coulomb"] > 0:
        friction, viscous = _of_motion(motion)
    else:
        return None
    if before.presliding is not None:
        return replace(friction, maxwell_slip=before.presliding.to_maxwell_slip()), viscous
    if spec.presliding in ("auto", "lugre"):
        return replace(friction, lugre=_lugre(before.at_rest, friction.coulomb)), viscous
    return friction, viscous


def _of_motion(motion: MotionFriction) -> tuple[Friction, float]:
    fit, terms = motion.chosen, motion.terms.at(motion.chosen)
    speeds = [abs(plateau.velocity) for plateau in motion.plateaus]
    measured = MeasuredRange((min(speeds), max(speeds)), None, terms.measured) if speeds else None
    held = {"exponent": terms.exponent, "temperature.decay": terms.decay}
    numbers = held | dict(zip(fit.names, fit.values.tolist(), strict=True))
    return friction_of(numbers, terms.reference, measured), max(0.0, fit["viscous"])


def _lugre(rest: AtRest | None, coulomb: float) -> LuGre | None:
    """sigma_0 and sigma_1, the damping falling with velocity so that the law supplies no energy."""
    if rest is None or rest.sigma_0 <= 0:
        return None
    stiffness, damping = rest.sigma_0, max(0.0, rest.sigma_1)
    # Nine tenths of the largest damping velocity with which a LuGre law is passive.
    falling = 0.9 * MAX_DAMPING_VELOCITY_RATIO * coulomb / damping if damping > 0 else None
    return LuGre(stiffness, damping, falling)


@dataclass(frozen=True)
class BeforeSliding:
    """notes: on what failed."""

    presliding: Elements | None = None
    at_rest: AtRest | None = None
    notes: tuple[Note, ...] = ()


def find_before_sliding(
    robot: Robot,
    loops: Sequence[FrictionRecord],
    rest: Sequence[FrictionRecord],
    static: StaticLaw | None,
    spec: FrictionSpec,
) -> BeforeSliding:
    """Bristles and elements from the records of one joint; static: the law of its passes."""
    notes, law = list[Note](), spec.law
    at_rest = _at_rest(robot, rest, static, notes) if rest else None
    presliding, place = None, f"record {loops[0].name}" if loops else ""
    if loops and law.presliding == "lugre" and at_rest is None:
        text = "loops do not show the damping of bristles; give responses at rest, or law.presliding: maxwell_slip"
        notes.append(Note("friction/presliding", text, place))
    if loops and law.presliding not in ("no", "lugre"):
        try:
            hz = None if spec.presliding is None else spec.presliding.frequency_hz
            presliding = fit_presliding(loops[0], hz, law.elements)
        except DataError as error:
            notes.append(Note("friction/presliding", str(error), place))
    return BeforeSliding(presliding, at_rest, tuple(notes))


def _at_rest(
    robot: Robot, records: Sequence[FrictionRecord], static: StaticLaw | None, notes: list[Note]
) -> AtRest | None:
    joint = records[0].joint
    viscous = (0.0, 0.0)
    if static is not None and "viscous" in static.names:
        i = static.names.index("viscous")
        viscous = static.viscous, float(np.sqrt(static.covariance[i, i]))
    try:
        spring = held_spring(robot, records[0])
        return fit_at_rest(f"joint {joint}", rest_responses(records), spring, viscous)
    except (DataError, FitError) as error:
        notes.append(Note("friction/at-rest", str(error), f"record {records[0].name}"))
        return None


def held_spring(robot: Robot, record: FrictionRecord) -> ElasticJoint | None:
    """The joint with its spring, the others held; None for a rigid one."""
    angles = np.zeros(len(robot.driven)) if record.configuration is None else record.configuration.angles
    return held_joint(robot, record.joint, angles)
