"""measure of a friction study: logs -> records.h5."""

from __future__ import annotations

from elastid.app.run import Run
from elastid.friction_record import FrictionRecords
from elastid.recorded.friction_logs import read_friction_logs
from elastid.store.friction_study import write_friction_records


def import_logs(run: Run) -> None:
    """records.h5 of the logs that the study names."""
    study = run.study
    joints = [joint.name for joint in study.friction_joints]
    payloads = {load.name: load.payload for load in study.as_friction().loads}
    _keep(run, read_friction_logs(study.as_robot(), study.experiment, run.loaded.base, joints, payloads))


def _keep(run: Run, found: FrictionRecords) -> None:
    write_friction_records(run.path("measure"), found.records, found.warm_ups, found.notes, run.stamps["measure"])
    run.console.notes((*found.notes, *(note for record in found.records for note in record.notes)))
    run.console.say(f"measure: {len(found.records)} records")
