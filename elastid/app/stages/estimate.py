"""estimate: records, or responses of other programs -> frf.h5, one response for each configuration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from elastid.app.dry_friction import friction_line, shaft_couplings
from elastid.app.imported_responses import imported_responses
from elastid.app.run import Run
from elastid.base.arrays import FloatArray, IntArray
from elastid.base.execution import Execution
from elastid.base.note import Note
from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.find import find_friction
from elastid.nonlinear.places import on_shafts
from elastid.nonlinear.result import FrictionTakenOut
from elastid.nonlinear.take_out import estimate_without_friction
from elastid.record import Record
from elastid.response import FrequencyResponse
from elastid.store import read_configurations, read_plan, read_records, write_responses


def estimate(run: Run) -> None:
    """frf.h5 from records.h5; each process has one configuration in memory at a time."""
    path, spec = run.path("measure"), run.study.estimator
    lines = read_plan(run.path("design")).lines if "design" in run.stages else None
    E = shaft_couplings(run.study)
    friction = find_friction_of_run(path, spec, lines, E, Execution(run.jobs))
    if friction is not None:
        run.console.notes(note for note in friction.notes if note.severity == "warning")
    work = partial(_estimated, path, spec, lines, friction, E)
    with run.execution("estimate") as execution:
        found = execution.ordered(work, read_configurations(path))
    responses = [response for response, _ in found]
    said = {note for _, notes in found for note in notes}  # when the records were measured
    run.console.notes(note for response in responses for note in response.notes if note not in said)
    _write(run, responses, friction)


def import_responses(run: Run) -> None:
    """frf.h5 from files of other programs, or of another run."""
    responses = list(imported_responses(run.study, run.loaded.base))
    run.console.notes(note for response in responses for note in response.notes)
    _write(run, responses)


def estimate_configuration(
    path: Path,
    configuration: str,
    spec: EstimatorSpec,
    lines: IntArray | None,
    friction: FrictionTakenOut | None = None,
    E: FloatArray | None = None,
) -> tuple[FrequencyResponse, set[Note]]:
    """Response of one configuration and the notes of its records, which are gone before the next are read.

    friction: what is taken out of the records' torque before.  E: couplings of the motors' gears, or None.
    """
    records = tuple(read_records(path, configuration))
    response = estimate_without_friction(records, friction, spec, lines, E)
    response = replace(response, repairs=_all_repairs(records))
    return response, {note for record in records for note in record.notes}


def _estimated(
    path: Path,
    spec: EstimatorSpec,
    lines: IntArray | None,
    friction: FrictionTakenOut | None,
    E: FloatArray | None,
    configuration: str,
) -> tuple[FrequencyResponse, set[Note]]:
    """`estimate_configuration` with what differs between configurations last."""
    return estimate_configuration(path, configuration, spec, lines, friction, E)


def find_friction_of_run(
    path: Path,
    spec: EstimatorSpec,
    lines: IntArray | None,
    E: FloatArray | None = None,
    execution: Execution | None = None,
) -> FrictionTakenOut | None:
    """Friction in records.h5, one configuration in memory at a time; None where the study asks for none."""
    if spec.friction == "none":
        return None
    records = [_RecordsOnShafts(path, name, E) for name in read_configurations(path)]
    return find_friction(records, spec, lines, execution)


@dataclass(frozen=True)
class _RecordsOnShafts:
    """The records of a configuration in records.h5 on the motors' shafts, read anew whenever they are asked for."""

    path: Path
    configuration: str
    E: FloatArray | None

    def __iter__(self) -> Iterator[Record]:
        return (on_shafts(each, self.E) for each in read_records(self.path, self.configuration))


def _write(run: Run, responses: Sequence[FrequencyResponse], friction: FrictionTakenOut | None = None) -> None:
    write_responses(run.path("estimate"), responses, run.stamps["estimate"], friction)
    counts = ", ".join(f"{r.configuration.name} {r.n_lines}" for r in responses)
    run.console.say(f"estimate: {len(responses)} responses (lines: {counts})")
    if friction is not None and (line := friction_line(friction)):
        run.console.say(f"estimate: {line}")


def _all_repairs(records: Iterable[Record]) -> dict[str, int]:
    total: Counter[str] = Counter()
    for record in records:
        total.update(record.repairs)
    return dict(total)
