"""The artefacts of a friction study: plan.h5, records.h5, levels.h5, friction.h5 and filter.h5."""

from __future__ import annotations

from pathlib import Path

from elastid.base.errors import Note
from elastid.experiment.plan.friction import FrictionPlan
from elastid.friction_study.extended_kalman_filter import FollowedFriction
from elastid.friction_study.result import FrictionResult, JointLevels
from elastid.record import FrictionRecord, FrictionRecords, WarmUpLog
from elastid.store.artefacts import opened
from elastid.store.reading import read_value, reader
from elastid.store.values import writer
from elastid.validation.twin import NO_TWIN, TwinFindings

PLAN, RECORDS, LEVELS = "friction plan", "friction records", "friction levels"
FRICTION, FILTER = "friction", "filter"


# plan.h5, levels.h5 with a group for each joint, and filter.h5 with friction followed over its motions.
write_friction_plan, read_friction_plan = writer(PLAN, plan=(None, None)), reader(PLAN, "plan", FrictionPlan)
write_levels = writer(LEVELS, joints=(tuple[JointLevels, ...], ()))
read_levels = reader(LEVELS, "joints", tuple[JointLevels, ...])
write_filter = writer(FILTER, joints=(tuple[FollowedFriction, ...], ()))
read_filter = reader(FILTER, "joints", tuple[FollowedFriction, ...])
# friction.h5: the result, its twin, and the prediction of logs that were left out, empty where none was.
_TWIN = TwinFindings, NO_TWIN
write_friction_result = writer(FRICTION, result=(FrictionResult, None), twin=_TWIN, left_out=_TWIN)
read_friction_result = reader(FRICTION, "result", FrictionResult)
read_left_out = reader(FRICTION, "left_out", TwinFindings)
# records.h5: a group for each record, written one at a time, then the logs of warm-ups.
write_friction_records = writer(
    RECORDS,
    records=(tuple[FrictionRecord, ...], ()),
    warm_ups=(tuple[WarmUpLog, ...], ()),
    notes=(tuple[Note, ...], ()),
)


def read_friction_records(path: Path | str) -> FrictionRecords:
    """Everything in records.h5."""
    with opened(path, RECORDS) as file:
        return FrictionRecords(
            read_value(file, "records", tuple[FrictionRecord, ...]),
            read_value(file, "warm_ups", tuple[WarmUpLog, ...]),
            read_value(file, "notes", tuple[Note, ...]),
        )
