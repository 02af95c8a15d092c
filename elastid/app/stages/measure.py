"""measure: a plan and a rig, or logs -> records.h5; an interrupted measurement is resumed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

from elastid.app.console import Console
from elastid.app.work import Artefacts, Work
from elastid.base.note import Note
from elastid.experiment.plan.plan import Experiment, Rig
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.channels import Places
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.record import FrictionRecord, Record
from elastid.recorded.rig import RecordedRig
from elastid.robot import Robot
from elastid.store.artefacts import Stamp, read_stamp
from elastid.store.design import read_plan
from elastid.store.files import remove_leftovers
from elastid.store.measured import read_records, write_records


def simulate(*, seed: int, robot: Robot, experiment: ExperimentSpec, design_file: Path, work: Work) -> Artefacts:
    """records.h5 of the simulated rig, which carries out the plan."""
    return _measure(SimulatedRig(robot, experiment, read_plan(design_file), seed), work)


def import_logs(*, places: Places, experiment: ExperimentSpec, files: Path, work: Work) -> Artefacts:
    """records.h5 of the logs that the study names."""
    return _measure(RecordedRig(places, experiment, files), work)


R = TypeVar("R", Record, FrictionRecord)


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
    stamps = [read_stamp(part_path(work.parts, part)) for part in parts]
    remaining = [p for p, stamp in zip(parts, stamps, strict=True) if stamp is None or not stamp.is_of(work.stamp)]
    if len(remaining) < len(parts):
        work.console.say(f"measure: resumed, {len(parts) - len(remaining)} of {len(parts)} {noun} are kept")
    with work.execution() as execution:
        for _ in execution.unordered(partial(_measured_part, measure, work.parts, work.stamp), remaining):
            pass


def part_path(folder: Path, part: Named) -> Path:
    """The file of a part."""
    return folder / f"{part.name}.h5"


def _measured_part(measure: Callable[[Path, Stamp, Any], None], folder: Path, stamp: Stamp, part: Named) -> None:
    measure(part_path(folder, part), stamp, part)


def _measure(rig: Rig, work: Work) -> Artefacts:
    measure_parts(work, rig.experiments, partial(_measure_one, rig), "experiments")
    notes: list[Note] = []
    records = gather_records(work.parts, rig.experiments, read_records, notes)
    return Artefacts(
        {"records.h5": lambda path, stamp: write_records(path, records, stamp)},
        partial(report_count, notes, len(rig.experiments)),
    )


def report_count(notes: Iterable[Note], count: int, console: Console) -> None:
    """Notes and number of records; the notes of records that are streamed are complete once these are written."""
    console.notes(notes)
    console.say(f"measure: {count} records")


def _measure_one(rig: Rig, path: Path, stamp: Stamp, experiment: Experiment) -> None:
    write_records(path, [rig.measure(experiment)], stamp)


def gather_records(
    folder: Path, parts: Iterable[Named], read: Callable[[Path], Iterable[R]], notes: list[Note]
) -> Iterator[R]:
    """The records in the order of the plan, one at a time; their notes are gathered on the way."""
    for part in parts:
        for record in read(part_path(folder, part)):
            notes += record.notes
            yield record
