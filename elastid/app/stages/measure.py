"""measure: a plan and a rig, or logs -> records.h5; an interrupted measurement is resumed. Static load tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from elastid.app.console import Console
from elastid.app.run import Artefacts, Work
from elastid.base.arrays import FloatArray
from elastid.base.errors import Note
from elastid.experiment.simulated.plant import true_robot
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.fit.load_tests import LoadsSpec, LoadTest
from elastid.fit.problem.static_loads import PlacedTest, load_of, placed_tests
from elastid.linear.loaded import LoadedRobot
from elastid.model.formulation import formulate
from elastid.record import FrictionRecord, Record
from elastid.recorded.rig import RecordedRig
from elastid.response import Response
from elastid.robot.robot import with_frames
from elastid.store.artefacts import Stamp, read_stamp
from elastid.store.files import remove_leftovers
from elastid.store.measured import read_plan, read_records, write_records
from elastid.study import Study

R = TypeVar("R", Record, FrictionRecord)
_NAME = attrgetter("name")


def simulate(study: Study, work: Work) -> Artefacts:
    """records.h5 of the simulated rig, which carries out the plan."""
    plan = read_plan(work.sources["design"])
    rig = SimulatedRig(study.as_robot(), study.experiment, plan, study.seed)
    return _measure(rig, work, lambda experiment: (experiment.configuration.name, experiment.realisation))


def import_logs(study: Study, work: Work) -> Artefacts:
    """records.h5 of the logs that the study names."""
    rig = RecordedRig(study.places, study.experiment, work.base)
    return _measure(rig, work, is_large=rig.is_large)


def _measure(
    rig: SimulatedRig | RecordedRig,
    work: Work,
    together: Callable[[Any], Any] = _NAME,
    is_large: Callable[[Any], bool] = lambda part: False,
) -> Artefacts:
    records, report = measure_parts(
        work, rig.experiments, rig.measure, read_records, write_records, "experiments", together, is_large
    )
    return Artefacts({"records.h5": lambda path, stamp: write_records(path, records, stamp)}, report)


def measure_parts(
    work: Work,
    parts: Sequence[Any],
    measure: Callable[[Any], R],
    read: Callable[[Path], Iterable[R]],
    write: Callable[[Path, Iterable[R], Stamp], None],
    noun: str,
    together: Callable[[Any], Any] = _NAME,
    is_large: Callable[[Any], bool] = lambda part: False,
) -> tuple[Iterator[R], Callable[[Console], None]]:
    """Measure each part, an experiment or motion, into a file that the run keeps when it is interrupted.

    A worker writes the records itself: none travels between processes.  together: the same of neighbours whose records
    have one file, which takes a third of the time of one for each.  is_large: true of a part whose record goes
    straight to the result, as it is measured: it would be written, hashed and read once more.
    Returns the records in the order of the parts, one at a time, and the report on them once they have been gathered.
    """
    work.parts.mkdir(parents=True, exist_ok=True)
    remove_leftovers(work.parts)
    groups = [list(group) for _, group in groupby(parts, lambda part: (is_large(part), together(part)))]
    files = [None if is_large(group[0]) else work.parts / f"{group[0].name}.h5" for group in groups]
    remaining = [(file, group) for file, group in zip(files, groups, strict=True) if not _is_kept(file, work.stamp)]
    kept = len(parts) - sum(len(group) for _, group in remaining)
    if kept:
        work.console.say(f"measure: resumed, {kept} of {len(parts)} {noun} are kept")
    with work.execution() as execution:
        remaining = [(file, group) for file, group in remaining if file is not None]
        execution.ordered(partial(_measure_part, measure, write, work.stamp), remaining)
    notes: list[Note] = []

    def gathered() -> Iterator[R]:
        for file, group in zip(files, groups, strict=True):
            for record in map(measure, group) if file is None else read(file):
                notes.extend(record.notes)
                yield record

    return gathered(), partial(report_count, notes, len(parts))


def _is_kept(file: Path | None, wanted: Stamp) -> bool:
    stamp = None if file is None else read_stamp(file)
    return stamp is not None and stamp.is_of(wanted)


def _measure_part(
    measure: Callable[[Any], R],
    write: Callable[[Path, Iterable[R], Stamp], None],
    stamp: Stamp,
    file: tuple[Path, Sequence[Any]],
) -> None:
    path, group = file
    write(path, map(measure, group), stamp)


def report_count(notes: Iterable[Note], count: int, console: Console) -> None:
    """Notes and number of records."""
    console.notes(notes)
    console.say(f"measure: {count} records")


def tests_of(study: Study, loads: LoadsSpec, responses: Sequence[Response]) -> tuple[PlacedTest, ...]:
    """Load tests of a study in the configurations of its responses or experiment.

    On a simulated rig a test without a deflection is measured, with the error that it states; the same seed gives the
    same readings.
    """
    experiment = study.experiment
    measured = {response.configuration.name: response.configuration for response in responses}
    tests = placed_tests(loads.tests, experiment.postures | measured)
    if experiment.simulated is None or all(load.test.deflection is not None for load in tests):
        return tests
    truth = true_robot(study.as_robot(), experiment.simulated.truth)
    given = tuple(load_of(load, truth) for load in tests)
    model = formulate(
        with_frames(truth, (name for load in given for name in (load.frame, load.read_at))), experiment.simulated.model
    )
    exact, _ = LoadedRobot.of(model, given, [model.theta] * len(given), ()).deflections([model.theta] * len(given))
    draws = np.random.SeedSequence([study.seed, len(tests)]).spawn(len(tests))
    return tuple(
        load if load.test.deflection is not None else replace(load, test=_measured(load.test, y, draw))
        for load, y, draw in zip(tests, exact, draws, strict=True)
    )


def _measured(test: LoadTest, exact: FloatArray, draw: np.random.SeedSequence) -> LoadTest:
    values = np.random.default_rng(draw).normal(exact, test.deviations).tolist()
    return replace(test, deflection=values[0] if test.n_readings == 1 else tuple(values))
