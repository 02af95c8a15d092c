"""measure: a plan and a rig, or logs -> records.h5; an interrupted measurement is resumed."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from elastid.app.provenance import file_hashes
from elastid.app.run import Run
from elastid.base.note import Note
from elastid.experiment.plan.plan import Experiment
from elastid.experiment.plan.rig import Rig
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.record import Record
from elastid.recorded.rig import RecordedRig
from elastid.store import Stamp, read_plan, read_records, read_stamp, remove_leftovers, write_records
from elastid.study import LoadedStudy


def simulate(run: Run) -> None:
    """records.h5 of the simulated rig, which carries out the plan."""
    study = run.study
    _measure(run, SimulatedRig(study.as_robot(), study.experiment, read_plan(run.path("design")), study.seed))


def import_logs(run: Run) -> None:
    """records.h5 of the logs that the study names."""
    _measure(run, RecordedRig(run.study.places, run.study.experiment, run.loaded.base))


def planned_for_the_fit(loaded: LoadedStudy, inputs: Mapping[str, str]) -> str | None:
    """The hash of the design's inputs where it chose configurations or spectra for the fit.

    Another plan follows from the sections that `measure` reads itself; its forecast does not concern the rig.
    """
    study = loaded.study
    chosen = study.design is not None or (study.excitation is not None and study.excitation.flat == "information")
    return inputs["design"] if chosen else None


def log_hashes(loaded: LoadedStudy, inputs: Mapping[str, str]) -> list[Any]:
    """The content of every log."""
    files = loaded.study.experiment.as_recorded().files
    return file_hashes(loaded.base, (path for file in files for path in (file.path, *file.also)))


def _measure(run: Run, rig: Rig) -> None:
    stamp, folder = run.stamps["measure"], run.partial("measure")
    folder.mkdir(parents=True, exist_ok=True)
    remove_leftovers(folder)
    todo = [experiment for experiment in rig.experiments if not _is_measured(folder, experiment, stamp)]
    if len(todo) < len(rig.experiments):
        kept = len(rig.experiments) - len(todo)
        run.console.say(f"measure: resumed, {kept} of {len(rig.experiments)} experiments are kept")
    with run.execution("measure") as execution:
        for _ in execution.unordered(partial(_measure_one, rig, folder, stamp), todo):
            pass
    notes: list[Note] = []
    write_records(run.path("measure"), _measured(rig, folder, notes), stamp)
    shutil.rmtree(folder)
    run.console.notes(notes)
    run.console.say(f"measure: {len(rig.experiments)} records")


def _path(folder: Path, experiment: Experiment) -> Path:
    return folder / f"{experiment.name}.h5"


def _is_measured(folder: Path, experiment: Experiment, stamp: Stamp) -> bool:
    found = read_stamp(_path(folder, experiment))
    return found is not None and found.is_of(stamp)


def _measure_one(rig: Rig, folder: Path, stamp: Stamp, experiment: Experiment) -> None:
    """Run in a worker, which writes the record itself: no record travels between processes."""
    write_records(_path(folder, experiment), [rig.measure(experiment)], replace(stamp, study=""))


def _measured(rig: Rig, folder: Path, notes: list[Note]) -> Iterator[Record]:
    """The records in the order of the plan, one at a time; their notes are gathered on the way."""
    for experiment in rig.experiments:
        for record in read_records(_path(folder, experiment)):
            notes += record.notes
            yield record
