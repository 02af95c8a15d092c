"""summary.json of a friction study, of a fixed form."""

from __future__ import annotations

from typing import Any

from elastid.app.json_values import SCHEMA, all_finite, balance_entries, finite, note_entries, run_entries
from elastid.base.note import grouped
from elastid.friction_study.motion import MotionFriction
from elastid.friction_study.result import FrictionNumber, FrictionResult, JointFriction
from elastid.study import Study
from elastid.validation.twin_run import NO_TWIN, TwinFindings


def friction_study_summary(study: Study, result: FrictionResult, twin: TwinFindings = NO_TWIN) -> dict[str, Any]:
    """The content of summary.json: parameters with intervals and origin, what was not identified, measured ranges.

    torque: of motions, what each part of the model explains.  twin: how far the model is off when it is simulated along
    them.
    """
    every = (*result.notes, *(note for joint in result.joints for note in joint.notes))
    return _head(study, result.status, result.message) | {
        "parameters": {number.name: _row(number) for number in result.numbers},
        "not_identified": [
            {"joint": joint.joint, "part": held.part, "reason": held.reason}
            for joint in result.joints
            for held in joint.held
        ],
        "motions": {joint.joint: _motion(joint.motion) for joint in result.joints if joint.motion is not None},
        "torque": balance_entries(twin.balances),
        "twin": run_entries(twin.runs),
        "measured": {joint.joint: _ranges(joint) for joint in result.joints},
        "warnings": [str(group) for group in grouped(every) if group.first.severity == "warning"],
        "notes": note_entries(every),
    }


def failed_friction(study: Study, message: str) -> dict[str, Any]:
    """summary.json of a study that found nothing: the same keys, no numbers."""
    nothing: dict[str, Any] = {
        "parameters": {},
        "not_identified": [],
        "motions": {},
        "torque": [],
        "measured": {},
        "warnings": [],
        "notes": [],
    }
    return _head(study, "failed", message) | nothing


def _head(study: Study, status: str, message: str) -> dict[str, Any]:
    return {"schema": SCHEMA, "study": study.name, "status": status, "message": message}


def _row(number: FrictionNumber) -> dict[str, Any]:
    found: dict[str, Any] = {
        "value": number.value,
        "std": finite(number.std),
        "interval95": all_finite((number.low, number.high)),
        "unit": number.unit,
        "meaning": number.meaning,
        "learnt_from": number.learnt_from,
    }
    return found if number.truth is None else found | {"truth": number.truth}


def _motion(motion: MotionFriction) -> dict[str, Any]:
    """The regression of a motion with directions apart and alike: which of them counts, and what each leaves."""
    return {
        "directions_apart": motion.are_apart,
        "relative_error": finite(motion.apart.relative_error),
        "relative_error_alike": finite(motion.alike.relative_error),
        "alike": {
            name: {"value": value, "std": finite(motion.alike.std(name)), "unit": motion.unit(name)}
            for name, value in zip(motion.alike.names, motion.alike.values.tolist(), strict=True)
        },
    }


def _ranges(joint: JointFriction) -> dict[str, list[float] | None]:
    """Lowest and highest speed, load and temperature, SI and degC; null where there was one or none."""
    measured = joint.friction.measured if joint.friction is not None else None
    return {
        name: None if measured is None or getattr(measured, name) is None else list(getattr(measured, name))
        for name in ("speed", "load", "temperature")
    }
