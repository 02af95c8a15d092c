"""measure: a plan and a rig, or logs -> records.h5; an interrupted measurement is resumed."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from elastid.app.run import Run
from elastid.base.note import Note
from elastid.experiment.plan.plan import Experiment
from elastid.experiment.plan.rig import Rig
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.record import Record
from elastid.recorded.rig import RecordedRig
from elastid.store import Stamp, read_plan, read_records, read_stamp, remove_leftovers, write_records


def simulate(run: Run) -> None:
    """records.h5 of the simulated rig, which carries out the plan."""
    study = run.study
    _measure(run, SimulatedRig(study.as_robot(), study.experiment, read_plan(run.path("design")), study.seed))


def import_logs(run: Run) -> None:
    """records.h5 of the logs that the study names."""
    _measure(run, RecordedRig(run.study.places, run.study.experiment, run.loaded.base))


class Named(Protocol):
    """An experiment or motion."""

    @property
    def name(self) -> str:
        """That of its file."""
        ...


def measure_parts(run: Run, todo: Sequence[Named], measure: Callable[[Path, Stamp, Any], None], noun: str) -> Path:
    """The folder with a file of each of `todo`, those of an interrupted measurement kept.

    measure(path, stamp, one) is run in a worker, which writes the record itself: no record travels between processes.
    """
    stamp, folder = run.stamps["measure"], run.partial("measure")
    folder.mkdir(parents=True, exist_ok=True)
    remove_leftovers(folder)
    left = [one for one in todo if not _is_measured(folder, one, stamp)]
    if len(left) < len(todo):
        run.console.say(f"measure: resumed, {len(todo) - len(left)} of {len(todo)} {noun} are kept")
    with run.execution("measure") as execution:
        for _ in execution.unordered(partial(_measured_part, measure, folder, replace(stamp, study="")), left):
            pass
    return folder


def part_path(folder: Path, one: Named) -> Path:
    """The file of one part."""
    return folder / f"{one.name}.h5"


def _is_measured(folder: Path, one: Named, stamp: Stamp) -> bool:
    found = read_stamp(part_path(folder, one))
    return found is not None and found.is_of(stamp)


def _measured_part(measure: Callable[[Path, Stamp, Any], None], folder: Path, stamp: Stamp, one: Named) -> None:
    measure(part_path(folder, one), stamp, one)


def _measure(run: Run, rig: Rig) -> None:
    folder = measure_parts(run, rig.experiments, partial(_measure_one, rig), "experiments")
    notes: list[Note] = []
    write_records(run.path("measure"), _measured(rig, folder, notes), run.stamps["measure"])
    shutil.rmtree(folder)
    run.console.notes(notes)
    run.console.say(f"measure: {len(rig.experiments)} records")


def _measure_one(rig: Rig, path: Path, stamp: Stamp, experiment: Experiment) -> None:
    write_records(path, [rig.measure(experiment)], stamp)


def _measured(rig: Rig, folder: Path, notes: list[Note]) -> Iterator[Record]:
    """The records in the order of the plan, one at a time; their notes are gathered on the way."""
    for experiment in rig.experiments:
        for record in read_records(part_path(folder, experiment)):
            notes += record.notes
            yield record
