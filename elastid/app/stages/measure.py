"""measure: a plan and a rig, or logs -> records.h5; an interrupted measurement is resumed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from elastid.app.console import Console
from elastid.app.work import Artefacts, Work
from elastid.base.note import Note
from elastid.experiment.plan.plan import Rig
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.channels import Places
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.record import FrictionRecord, Record
from elastid.recorded.rig import RecordedRig
from elastid.robot import Robot
from elastid.store.artefacts import Stamp, read_stamp
from elastid.store.files import remove_leftovers
from elastid.store.measured import read_plan, read_records, write_records

R = TypeVar("R", Record, FrictionRecord)


def simulate(*, seed: int, robot: Robot, experiment: ExperimentSpec, design_file: Path, work: Work) -> Artefacts:
    """records.h5 of the simulated rig, which carries out the plan."""
    return _measure(SimulatedRig(robot, experiment, read_plan(design_file), seed), work)


def import_logs(*, places: Places, experiment: ExperimentSpec, files: Path, work: Work) -> Artefacts:
    """records.h5 of the logs that the study names."""
    rig = RecordedRig(places, experiment, files)
    return _measure(rig, work, rig.is_large)


def _measure(rig: Rig, work: Work, is_large: Callable[[Any], bool] = lambda part: False) -> Artefacts:
    records, report = measure_parts(
        work, rig.experiments, rig.measure, read_records, write_records, "experiments", is_large
    )
    return Artefacts({"records.h5": lambda path, stamp: write_records(path, records, stamp)}, report)


def measure_parts(
    work: Work,
    parts: Sequence[Any],
    measure: Callable[[Any], R],
    read: Callable[[Path], Iterable[R]],
    write: Callable[[Path, Iterable[R], Stamp], None],
    noun: str,
    is_large: Callable[[Any], bool] = lambda part: False,
) -> tuple[Iterator[R], Callable[[Console], None]]:
    """Measure each part, an experiment or motion, into a file of its own; those of an interrupted run are kept.

    A worker writes the record itself: no record travels between processes.  is_large: true of a part whose record goes
    straight to the result, as it is measured: a file of its own would be written, hashed and read once more.
    Returns the records in the order of the parts, one at a time, and the report on them once they have been gathered.
    """
    work.parts.mkdir(parents=True, exist_ok=True)
    remove_leftovers(work.parts)
    files = {part.name: work.parts / f"{part.name}.h5" for part in parts if not is_large(part)}
    stamps = {name: read_stamp(path) for name, path in files.items()}
    finished = [name for name, stamp in stamps.items() if stamp is not None and stamp.is_of(work.stamp)]
    remaining = [(files[p.name], p) for p in parts if p.name in files and p.name not in finished]
    if finished:
        work.console.say(f"measure: resumed, {len(finished)} of {len(parts)} {noun} are kept")
    with work.execution() as execution:
        execution.ordered(partial(_measure_part, measure, write, work.stamp), remaining)
    notes: list[Note] = []

    def gathered() -> Iterator[R]:
        for part in parts:
            for record in read(files[part.name]) if part.name in files else [measure(part)]:
                notes.extend(record.notes)
                yield record

    return gathered(), partial(report_count, notes, len(parts))


def _measure_part(
    measure: Callable[[Any], R], write: Callable[[Path, Iterable[R], Stamp], None], stamp: Stamp, file: tuple[Path, Any]
) -> None:
    path, part = file
    write(path, [measure(part)], stamp)


def report_count(notes: Iterable[Note], count: int, console: Console) -> None:
    """Notes and number of records."""
    console.notes(notes)
    console.say(f"measure: {count} records")
