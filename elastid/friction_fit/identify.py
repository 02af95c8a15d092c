"""Levels and records of a friction study -> the friction of each joint: law, presliding, warm-up, table of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.errors import DataError, FitError
from elastid.base.note import Note
from elastid.friction_fit.at_rest import AtRest, fit_at_rest
from elastid.friction_fit.motion import MotionFriction
from elastid.friction_fit.numbers import (
    numbers_at_rest,
    numbers_of_heat,
    numbers_of_law,
    numbers_of_motion,
)
from elastid.friction_fit.presliding import Loops, Presliding, fit_presliding
from elastid.friction_fit.record_passes import passes_of
from elastid.friction_fit.rest_response import rest_responses
from elastid.friction_fit.result import FrictionNumber, FrictionResult, JointFriction, JointLevels, Status
from elastid.friction_fit.spec import FrictionSpec, LawSpec
from elastid.friction_fit.static_law import StaticLaw
from elastid.friction_fit.warm_up import ThermalModel, WarmUp, fit_warm_up, level_over_heat
from elastid.friction_record import FrictionRecord, FrictionRecords, WarmUpLog
from elastid.robot import Directions, Friction, LuGre, MeasuredRange, Robot
from elastid.robot.friction import MAX_DAMPING_VELOCITY_RATIO

# Of the largest damping velocity with which a LuGre law is passive.
PASSIVE_MARGIN = 0.9


def identify_friction(
    robot: Robot,
    levels: Sequence[JointLevels],
    measured: FrictionRecords,
    spec: FrictionSpec,
    truth: Mapping[str, float] | None = None,
) -> FrictionResult:
    """The friction of all joints; truth: of a simulated robot, by name, link side.

    Raises FitError where a part of the law that is asked for (`yes`) cannot be told.
    """
    joints = tuple(_joint(robot, each, measured, spec, truth or {}) for each in levels)
    status: Status = "partly" if any(joint.missing for joint in joints) else "identified"
    if all(joint.friction is None for joint in joints):
        status = "failed"
    return FrictionResult(joints, measured.notes, status, _message(joints))


def _joint(
    robot: Robot, found: JointLevels, measured: FrictionRecords, spec: FrictionSpec, truth: Mapping[str, float]
) -> JointFriction:
    """All parts of one joint; a part that fails leaves a note and the others."""
    name, notes = found.joint, list(found.notes)
    static = StaticLaw.of(found.levels.levels, spec.law) if found.levels is not None else None
    bent = _presliding(measured.of(name, "loops"), spec.law, notes)
    rest = _at_rest(robot, measured.of(name, "at_rest"), static, notes)
    heat = _heat(name, measured, static, notes)
    friction, viscous = _law(static, found.motion, bent, rest, spec.law)
    numbers: list[FrictionNumber] = []
    if static is not None:
        numbers += numbers_of_law(name, static, truth)
    if found.motion is not None:
        known = {number.name for number in numbers}
        numbers += (each for each in numbers_of_motion(name, found.motion, truth) if each.name not in known)
    if rest is not None:
        numbers += numbers_at_rest(name, rest, found.slides, truth)
    if heat is not None:
        numbers += numbers_of_heat(name, heat.model, heat.warm_up)
    held = static.held if static is not None else found.motion.held if found.motion is not None else ()
    return JointFriction(
        name, found.slides, found.levels, found.motion, static,
        presliding=bent.found if bent else None, loops=bent.loops if bent else None, at_rest=rest,
        thermal=heat.model if heat else None, warm_up=heat.warm_up if heat else None,
        friction=friction, viscous=viscous, numbers=tuple(numbers), held=held, example=found.example,
        notes=tuple(notes),
    )  # fmt: skip


@dataclass(frozen=True)
class _Bent:
    loops: Loops
    found: Presliding


@dataclass(frozen=True)
class _Heat:
    warm_up: WarmUp
    model: ThermalModel


def _presliding(records: Sequence[FrictionRecord], law: LawSpec, notes: list[Note]) -> _Bent | None:
    """Maxwell slip elements of the first log of loops."""
    if not records or law.presliding in ("no", "lugre"):
        return None
    record = records[0]
    # The first half loop only tells the elements where they start.
    frequency_hz = record.rate_hz / record.period_samples if record.period_samples else 1 / record.duration_s
    loops = Loops(
        f"joint {record.joint}", record.rate_hz, record.position, record.torque, frequency_hz, record.resolution,
        round(record.rate_hz / frequency_hz / 2) if record.period_samples else 0,
    )  # fmt: skip
    try:
        return _Bent(loops, fit_presliding(loops, law.elements))
    except DataError as error:
        notes.append(Note("no-presliding", str(error), f"record {record.name}"))
        return None


def _at_rest(
    robot: Robot, records: Sequence[FrictionRecord], static: StaticLaw | None, notes: list[Note]
) -> AtRest | None:
    if not records:
        return None
    joint = records[0].joint
    viscous = (0.0, 0.0)
    if static is not None and "viscous" in static.names:
        i = static.names.index("viscous")
        viscous = static.viscous, float(np.sqrt(static.covariance[i, i]))
    try:
        return fit_at_rest(f"joint {joint}", rest_responses(records), None, viscous)
    except (DataError, FitError) as error:
        notes.append(Note("nothing-at-rest", str(error), f"record {records[0].name}"))
        return None


def _heat(joint: str, measured: FrictionRecords, static: StaticLaw | None, notes: list[Note]) -> _Heat | None:
    """The thermal model of the joint's warm-up, from its thermometer, its test passes, or both."""
    log = next((log for log in measured.warm_ups if log.joint == joint), None)
    if log is None:
        return None
    try:
        warm_up = _warm_up(log, [record for record in measured.of(joint, "passes") if record.is_warm_up])
        return _Heat(warm_up, fit_warm_up(warm_up, level_over_heat(static, warm_up.load)))
    except (DataError, FitError) as error:
        notes.append(Note("no-warm-up", str(error), f"warm-up of joint {joint}"))
        return None


def _warm_up(log: WarmUpLog, tests: Sequence[FrictionRecord]) -> WarmUp:
    """The log with the level of each test pass: half the difference of its directions' means."""
    speeds, levels, stds = [], [], []
    for record in tests:
        there, back = sorted(passes_of(record), key=lambda each: -each.direction)
        speeds.append(float((there.velocity.mean() - back.velocity.mean()) / 2))
        levels.append(float((there.torque.mean() - back.torque.mean()) / 2))
        spread = [np.std(each.torque - each.torque.mean()) / np.sqrt(len(each.torque)) for each in (there, back)]
        stds.append(float(np.hypot(*spread) / 2))
    at = np.searchsorted(log.time_s, [record.start_s for record in tests], side="right") - 1
    return WarmUp(
        log.time_s, log.power, log.ambient_degc, log.start_degc, log.temperature, log.temperature_std,
        np.clip(at, 0, len(log.time_s) - 1), np.array(speeds), np.array(levels), np.array(stds),
        float(np.mean([record.load_torque for record in tests])) if tests else 0.0,
    )  # fmt: skip


def _law(
    static: StaticLaw | None,
    motion: MotionFriction | None,
    bent: _Bent | None,
    rest: AtRest | None,
    spec: LawSpec,
) -> tuple[Friction | None, float | None]:
    """The law as a whole, and the viscous friction beside it."""
    if static is not None:
        friction, viscous = static.to_friction(), static.viscous
    elif motion is not None and motion.chosen["coulomb"] > 0:
        friction, viscous = _law_of_motion(motion)
    else:
        return None, None
    if bent is not None and spec.presliding in ("auto", "maxwell_slip"):
        return replace(friction, maxwell_slip=bent.found.few.to_maxwell_slip()), viscous
    if rest is not None and spec.presliding in ("auto", "lugre") and rest.sigma_0 > 0:
        damping = max(0.0, rest.sigma_1)
        falling = PASSIVE_MARGIN * MAX_DAMPING_VELOCITY_RATIO * friction.coulomb / damping if damping > 0 else None
        return replace(friction, lugre=LuGre(rest.sigma_0, damping, falling)), viscous
    return friction, viscous


def _law_of_motion(motion: MotionFriction) -> tuple[Friction, float]:
    """Coulomb and viscous friction of a motion, in the range of its plateaus."""
    fit = motion.chosen
    viscous = max(0.0, fit["viscous"])
    has = "directions.coulomb" in fit.names or "directions.viscous" in fit.names
    apart = {name: fit[f"directions.{name}"] for name in ("coulomb", "viscous") if f"directions.{name}" in fit.names}
    speeds = [abs(plateau.velocity) for plateau in motion.plateaus]
    measured = MeasuredRange((min(speeds), max(speeds))) if speeds else None
    return Friction(fit["coulomb"], directions=Directions(**apart) if has else None, measured=measured), viscous


def _message(joints: Sequence[JointFriction]) -> str:
    said = []
    for joint in joints:
        parts = [f"{number.symbol} = {number.value:.4g} {number.unit}" for number in joint.numbers[:4]]
        said.append(f"joint {joint.joint}: {', '.join(parts)}" if parts else f"joint {joint.joint}: nothing was found")
    return "; ".join(said)
