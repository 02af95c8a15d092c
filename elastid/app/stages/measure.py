"""Stage measure: simulated experiments or logs -> records.h5, and simulated deflections of static load tests."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from elastid.app.console import Console
from elastid.app.run import Artefacts, Work
from elastid.base.errors import Note
from elastid.experiment.simulated.plant import true_robot
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.fit.load_tests import LoadsSpec
from elastid.fit.problem.static_loads import PlacedTest, load_of, placed_tests
from elastid.friction_record import FrictionRecord
from elastid.linear.static_deflection import LoadedRobot
from elastid.logs.rig import RecordedRig
from elastid.model.formulation import formulate
from elastid.record import Record
from elastid.response import Response
from elastid.robot.robot import with_frames
from elastid.store.checkpoint import Checkpoint
from elastid.store.measured import write_records
from elastid.store.plan import read_plan
from elastid.study import Study

R = TypeVar("R", Record, FrictionRecord)


def simulate(study: Study, work: Work) -> Artefacts:
    """Simulate the experiments of the plan: records.h5."""
    plan = read_plan(work.sources["design"])
    return _measure(SimulatedRig(study.as_robot(), study.experiment, plan, study.seed), work)


def import_logs(study: Study, work: Work) -> Artefacts:
    """Import the logs of the study: records.h5."""
    rig = RecordedRig(study.places, study.experiment, work.base)
    return _measure(rig, work, rig.is_large)


def _measure(rig: SimulatedRig | RecordedRig, work: Work, *is_large: Callable[[Any], bool]) -> Artefacts:
    records, report = measure_parts(work, rig.experiments, rig.measure, *is_large)
    return Artefacts({"records.h5": lambda path, stamp: write_records(path, records, stamp)}, report)


def measure_parts(
    work: Work, parts: Sequence[Any], measure: Callable[[Any], R], is_large: Callable[[Any], bool] = lambda item: False
) -> tuple[Iterator[R], Callable[[Console], None]]:
    """Measure each experiment or motion (part) to the checkpoint; finished parts of an interrupted run are kept.

    Workers write the records, so that no record is sent between processes.  is_large: True for a part whose record is
    written directly to the result.  Return an iterator of the records in the order of the parts, and the report, which
    is complete after the iteration.
    """
    finished, notes = work.checkpoint(), list[Note]()
    remaining = [part for part in parts if not is_large(part) and part.name not in finished]
    with work.execution() as execution:
        execution.ordered(partial(_measure_part, measure, finished), remaining)

    def collected() -> Iterator[R]:
        for part in parts:
            record = finished.get(part.name) or measure(part)
            notes.extend(record.notes)
            yield record

    return collected(), partial(report_count, notes, len(parts))


def _measure_part(measure: Callable[[Any], R], finished: Checkpoint, part: Any) -> None:
    finished[part.name] = measure(part)


def report_count(notes: Iterable[Note], count: int, console: Console) -> None:
    """Print notes and the number of records."""
    name = next((m for note in notes if (m := re.fullmatch(r"record ((.*)-r(\d+)-e(\d+))", note.place))), None)
    name_text = f". {name[1]}: configuration {name[2]}, realisation {name[3]}, experiment {name[4]}" if name else ""
    console.say(f"measure: {count} record{'s' * (count != 1)}{name_text}")
    console.notes(notes)


def tests_of(study: Study, loads: LoadsSpec, responses: Sequence[Response]) -> tuple[PlacedTest, ...]:
    """Return the load tests of a study; a simulated rig adds missing deflections with the stated errors."""
    experiment = study.experiment
    measured = {response.configuration.name: response.configuration for response in responses}
    tests = placed_tests(loads.tests, experiment.postures | measured)
    if experiment.simulated is None or all(load.test.deflection is not None for load in tests):
        return tests
    truth = true_robot(study.as_robot(), experiment.simulated.truth)
    placed = tuple(load_of(load, truth) for load in tests)
    frames = (name for load in placed for name in (load.frame, load.read_at))
    model = formulate(with_frames(truth, frames), experiment.simulated.model)
    thetas = [model.theta] * len(placed)
    exact, _ = LoadedRobot.of(model, placed, thetas, ()).deflections(thetas)
    draws = np.random.SeedSequence([study.seed, len(tests)]).spawn(len(tests))
    deflections = []
    for load, y, draw in zip(tests, exact, draws, strict=True):
        test = load.test
        if test.deflection is None:
            values = np.random.default_rng(draw).normal(y, test.deviations).tolist()
            test = replace(test, deflection=values[0] if test.n_readings == 1 else tuple(values))
        deflections.append(replace(load, test=test))
    return tuple(deflections)
