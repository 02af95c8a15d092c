"""measure: a plan and a rig, or logs -> records.h5, of an elastic or a friction study; resumed where interrupted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from elastid.app.console import Console
from elastid.app.work import Artefacts, Work
from elastid.base.note import Note
from elastid.experiment.plan.friction import FrictionRig, PlannedMotion
from elastid.experiment.plan.plan import Experiment
from elastid.experiment.plan.rig import Rig
from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.structure import Places
from elastid.friction_fit.spec import LoadSpec
from elastid.friction_record import FrictionRecord
from elastid.record import Record
from elastid.recorded.friction_logs import read_friction_logs
from elastid.recorded.rig import RecordedRig
from elastid.robot import Joint, Robot
from elastid.store import Stamp, read_plan, read_records, read_stamp, remove_leftovers, write_records
from elastid.store.friction_study import read_friction_plan, read_friction_records, write_friction_records


def simulate(*, seed: int, robot: Robot, experiment: ExperimentSpec, design_file: Path, work: Work) -> Artefacts:
    """records.h5 of the simulated rig, which carries out the plan."""
    return _measure(SimulatedRig(robot, experiment, read_plan(design_file), seed), work)


def import_logs(*, places: Places, experiment: ExperimentSpec, files: Path, work: Work) -> Artefacts:
    """records.h5 of the logs that the study names."""
    return _measure(RecordedRig(places, experiment, files), work)


def simulate_motions(
    *, seed: int, robot: Robot, experiment: ExperimentSpec, design_file: Path, work: Work
) -> Artefacts:
    """records.h5 of the simulated rig, which carries out the motions of a friction study, each in a process."""
    rig = SimulatedFrictionRig(robot, experiment, read_friction_plan(design_file), seed)
    measure_parts(work, rig.motions, partial(_measure_motion, rig), "motions")
    notes: list[Note] = []

    def write(path: Path, stamp: Stamp) -> None:
        write_friction_records(path, _measured_motions(work.parts, rig.motions, notes), rig.warm_ups(), stamp=stamp)

    return Artefacts({"records.h5": write}, partial(_report, notes, len(rig.motions)))


def import_motions(
    *,
    robot: Robot,
    friction_joints: tuple[Joint, ...],
    experiment: ExperimentSpec,
    loads: tuple[LoadSpec, ...],
    files: Path,
    work: Work,
) -> Artefacts:
    """records.h5 of the logs of a friction study."""
    joints, payloads = [joint.name for joint in friction_joints], {load.name: load.payload for load in loads}
    logs = read_friction_logs(robot, experiment, files, joints, payloads)
    notes = (*logs.notes, *(note for record in logs.records for note in record.notes))
    return Artefacts(
        {
            "records.h5": lambda path, stamp: write_friction_records(
                path, logs.records, logs.warm_ups, logs.notes, stamp
            )
        },
        partial(_report, notes, len(logs.records)),
    )


class Named(Protocol):
    """An experiment or motion."""

    @property
    def name(self) -> str:
        """That of its file."""
        ...


def measure_parts(work: Work, parts: Sequence[Named], measure: Callable[[Path, Stamp, Any], None], noun: str) -> None:
    """A file of each part in the folder of finished parts; those of an interrupted measurement are kept.

    measure(path, stamp, part) is run in a worker, which writes the record itself: no record travels between processes.
    """
    work.parts.mkdir(parents=True, exist_ok=True)
    remove_leftovers(work.parts)
    remaining = [part for part in parts if not _is_measured(work, part)]
    if len(remaining) < len(parts):
        work.console.say(f"measure: resumed, {len(parts) - len(remaining)} of {len(parts)} {noun} are kept")
    with work.execution() as execution:
        for _ in execution.unordered(partial(_measured_part, measure, work.parts, work.stamp), remaining):
            pass


def _part_path(folder: Path, part: Named) -> Path:
    return folder / f"{part.name}.h5"


def _is_measured(work: Work, part: Named) -> bool:
    stamp = read_stamp(_part_path(work.parts, part))
    return stamp is not None and stamp.is_of(work.stamp)


def _measured_part(measure: Callable[[Path, Stamp, Any], None], folder: Path, stamp: Stamp, part: Named) -> None:
    measure(_part_path(folder, part), stamp, part)


def _measure(rig: Rig, work: Work) -> Artefacts:
    measure_parts(work, rig.experiments, partial(_measure_one, rig), "experiments")
    notes: list[Note] = []
    records = _measured(rig, work.parts, notes)
    return Artefacts(
        {"records.h5": lambda path, stamp: write_records(path, records, stamp)},
        partial(_report, notes, len(rig.experiments)),
    )


def _report(notes: Iterable[Note], count: int, console: Console) -> None:
    """notes: of records that are streamed, complete once these are written."""
    console.notes(notes)
    console.say(f"measure: {count} records")


def _measure_one(rig: Rig, path: Path, stamp: Stamp, experiment: Experiment) -> None:
    write_records(path, [rig.measure(experiment)], stamp)


def _measured(rig: Rig, folder: Path, notes: list[Note]) -> Iterator[Record]:
    """The records in the order of the plan, one at a time; their notes are gathered on the way."""
    for experiment in rig.experiments:
        for record in read_records(_part_path(folder, experiment)):
            notes += record.notes
            yield record


def _measure_motion(rig: FrictionRig, path: Path, stamp: Stamp, motion: PlannedMotion) -> None:
    write_friction_records(path, [rig.measure(motion)], stamp=stamp)


def _measured_motions(folder: Path, motions: Sequence[PlannedMotion], notes: list[Note]) -> Iterator[FrictionRecord]:
    """The records in the order of the plan, one at a time; their notes are gathered on the way."""
    for motion in motions:
        for record in read_friction_records(_part_path(folder, motion)).records:
            notes += record.notes
            yield record
