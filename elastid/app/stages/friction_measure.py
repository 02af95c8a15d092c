"""measure of a friction study: a plan and the simulated rig, or logs -> records.h5; an interrupted one is resumed."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

from elastid.app.run import Run
from elastid.app.stages.measure import measure_parts, part_path
from elastid.base.note import Note
from elastid.experiment.plan.friction import FrictionRig, PlannedMotion
from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig
from elastid.friction_record import FrictionRecord
from elastid.recorded.friction_logs import read_friction_logs
from elastid.store import Stamp
from elastid.store.friction_study import read_friction_plan, read_friction_records, write_friction_records


def simulate(run: Run) -> None:
    """records.h5 of the simulated rig, which carries out the plan, one motion a process."""
    study = run.study
    rig = SimulatedFrictionRig(study.as_robot(), study.experiment, read_friction_plan(run.path("design")), study.seed)
    folder = measure_parts(run, rig.motions, partial(_measure_one, rig), "motions")
    notes: list[Note] = []
    records = _measured(folder, rig.motions, notes)
    write_friction_records(run.path("measure"), records, rig.warm_ups(), stamp=run.stamps["measure"])
    shutil.rmtree(folder)
    _say(run, notes, len(rig.motions))


def import_logs(run: Run) -> None:
    """records.h5 of the logs that the study names."""
    study = run.study
    joints = [joint.name for joint in study.friction_joints]
    payloads = {load.name: load.payload for load in study.as_friction().loads}
    found = read_friction_logs(study.as_robot(), study.experiment, run.loaded.base, joints, payloads)
    write_friction_records(run.path("measure"), found.records, found.warm_ups, found.notes, run.stamps["measure"])
    _say(run, (*found.notes, *(note for record in found.records for note in record.notes)), len(found.records))


def _say(run: Run, notes: Iterable[Note], count: int) -> None:
    run.console.notes(notes)
    run.console.say(f"measure: {count} records")


def _measure_one(rig: FrictionRig, path: Path, stamp: Stamp, motion: PlannedMotion) -> None:
    write_friction_records(path, [rig.measure(motion)], stamp=stamp)


def _measured(folder: Path, motions: Sequence[PlannedMotion], notes: list[Note]) -> Iterator[FrictionRecord]:
    """The records in the order of the plan, one at a time; their notes are gathered on the way."""
    for motion in motions:
        for record in read_friction_records(part_path(folder, motion)).records:
            notes += record.notes
            yield record
