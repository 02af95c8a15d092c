"""The artefacts of a friction study: plan.h5, records.h5, levels.h5, friction.h5 and filter.h5."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from elastid.base.errors import Note
from elastid.experiment.plan.friction import FrictionPlan
from elastid.friction_study.extended_kalman_filter import FollowedFriction
from elastid.friction_study.result import FrictionNumber, FrictionResult, JointLevels
from elastid.record import FrictionRecord, FrictionRecords, WarmUpLog
from elastid.store.artefacts import NO_STAMP, Stamp, opened
from elastid.store.reading import read_part, read_value
from elastid.store.values import write_artefact
from elastid.validation.twin import NO_PREDICTION, NO_TWIN, Prediction, TwinFindings

PLAN, RECORDS, LEVELS = "friction plan", "friction records", "friction levels"
FRICTION, FILTER = "friction", "filter"


def write_friction_plan(path: Path, plan: FrictionPlan, stamp: Stamp = NO_STAMP) -> None:
    """plan.h5 of a friction study."""
    write_artefact(path, PLAN, stamp, {"plan": (plan, FrictionPlan)})


def read_friction_plan(path: Path | str) -> FrictionPlan:
    """The plan in plan.h5."""
    return read_part(path, PLAN, "plan", FrictionPlan)


def write_friction_records(
    path: Path,
    records: Iterable[FrictionRecord],
    stamp: Stamp = NO_STAMP,
    warm_ups: Sequence[WarmUpLog] = (),
    notes: Sequence[Note] = (),
) -> None:
    """records.h5: a group for each record, written one at a time, then the logs of warm-ups."""
    parts = {
        "records": (records, tuple[FrictionRecord, ...]),
        "warm_ups": (tuple(warm_ups), tuple[WarmUpLog, ...]),
        "notes": (tuple(notes), tuple[Note, ...]),
    }
    write_artefact(path, RECORDS, stamp, parts)


def read_friction_records(path: Path | str) -> FrictionRecords:
    """Everything in records.h5."""
    with opened(path, RECORDS) as file:
        return FrictionRecords(
            read_value(file, "records", tuple[FrictionRecord, ...]),
            read_value(file, "warm_ups", tuple[WarmUpLog, ...]),
            read_value(file, "notes", tuple[Note, ...]),
        )


def write_levels(path: Path, levels: Sequence[JointLevels], stamp: Stamp = NO_STAMP) -> None:
    """levels.h5: a group for each joint."""
    write_artefact(path, LEVELS, stamp, {"joints": (tuple(levels), tuple[JointLevels, ...])})


def read_levels(path: Path | str) -> tuple[JointLevels, ...]:
    """The joints in levels.h5."""
    return read_part(path, LEVELS, "joints", tuple[JointLevels, ...])


def write_friction_result(
    path: Path,
    result: FrictionResult,
    stamp: Stamp = NO_STAMP,
    twin: TwinFindings = NO_TWIN,
    left_out: Prediction = NO_PREDICTION,
) -> None:
    """friction.h5: the numbers of all joints as a table, a group with everything, the twin, and logs that judge it."""
    parts = {
        "numbers": (result.numbers, tuple[FrictionNumber, ...]),
        "result": (result, FrictionResult),
        "twin": (twin, TwinFindings),
        "left_out": (left_out, Prediction),
    }
    write_artefact(path, FRICTION, stamp, parts)


def read_friction_result(path: Path | str) -> FrictionResult:
    """The result in friction.h5."""
    return read_part(path, FRICTION, "result", FrictionResult)


def read_left_out(path: Path | str) -> Prediction:
    """The prediction of the logs that were left out, in friction.h5; empty where none was."""
    return read_part(path, FRICTION, "left_out", Prediction)


def write_filter(path: Path, joints: Sequence[FollowedFriction], stamp: Stamp = NO_STAMP) -> None:
    """filter.h5: friction followed over the motions of joints, a group for each."""
    write_artefact(path, FILTER, stamp, {"joints": (tuple(joints), tuple[FollowedFriction, ...])})


def read_filter(path: Path | str) -> tuple[FollowedFriction, ...]:
    """The joints in filter.h5."""
    return read_part(path, FILTER, "joints", tuple[FollowedFriction, ...])
