"""Artefacts of a friction study: plan.h5, records.h5, constant_velocity.h5, friction.h5 and filter.h5."""

from pathlib import Path

from elastid.base.errors import Note
from elastid.experiment.plan.friction import FrictionPlan
from elastid.friction_record import FrictionRecord, FrictionRecords, WarmUpLog
from elastid.friction_study.friction_tracking import TrackedFriction
from elastid.friction_study.result import FrictionNumber, FrictionResult, SlidingFriction
from elastid.store.artefacts import NO_STAMP, Stamp, open_artefact
from elastid.store.reading import read_dataclass, reader
from elastid.store.writing import write_artefact, writer
from elastid.validation.log_comparison import NO_COMPARISON, LogComparison

PLAN, RECORDS, CONSTANT_VELOCITY = "friction plan", "friction records", "constant-velocity torques"
FRICTION, FILTER = "friction", "filter"

# constant_velocity.h5 and filter.h5 have a group for each joint.
write_friction_plan, read_friction_plan = writer(PLAN, plan=(None, None)), reader(PLAN, "plan", FrictionPlan)
write_constant_velocity = writer(CONSTANT_VELOCITY, joints=(tuple[SlidingFriction, ...], ()))
read_constant_velocity = reader(CONSTANT_VELOCITY, "joints", tuple[SlidingFriction, ...])
write_filter = writer(FILTER, joints=(tuple[TrackedFriction, ...], ()))
read_filter = reader(FILTER, "joints", tuple[TrackedFriction, ...])
# Parts of friction.h5: the result, and its comparisons with the logs of the study and with validation logs.
read_friction_result = reader(FRICTION, "result", FrictionResult)
read_simulation, read_validation_logs = (reader(FRICTION, part, LogComparison) for part in ("simulation", "validation"))
# records.h5 has a group for each record and for each log of a warm-up.
write_friction_records = writer(
    RECORDS,
    records=(tuple[FrictionRecord, ...], ()),
    warm_ups=(tuple[WarmUpLog, ...], ()),
    notes=(tuple[Note, ...], ()),
)


def read_friction_records(path: Path | str) -> FrictionRecords:
    """Read all of records.h5."""
    with open_artefact(path, RECORDS) as file:
        return read_dataclass(file, FrictionRecords)


def write_friction_result(
    path: Path, result: FrictionResult, stamp: Stamp = NO_STAMP, log_comparison: LogComparison = NO_COMPARISON,
    validation: LogComparison = NO_COMPARISON,
) -> None:  # fmt: skip
    """Write friction.h5: a table of all numbers, the whole result, and its comparisons with logs."""
    groups = {
        "numbers": (result.numbers, tuple[FrictionNumber, ...]),
        "result": (result, FrictionResult),
        "simulation": (log_comparison, LogComparison),
        "validation": (validation, LogComparison),
    }
    write_artefact(path, FRICTION, stamp, groups)
