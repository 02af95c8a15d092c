"""estimate: records, or responses of other programs -> frf.h5, one response for each configuration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from elastid.app.dry_friction import friction_line, shaft_couplings
from elastid.app.imported_responses import imported_responses
from elastid.app.run import Run
from elastid.base.arrays import FloatArray, IntArray
from elastid.base.note import Note
from elastid.frf.friction.find import find_friction
from elastid.frf.friction.result import FrictionTakenOut
from elastid.frf.friction.shafts import on_shafts
from elastid.frf.spec import EstimatorSpec
from elastid.frf.without_friction import estimate_without_friction
from elastid.record import Record
from elastid.response import FrequencyResponse
from elastid.store import read_configurations, read_plan, read_records, write_responses


def estimate(run: Run) -> None:
    """frf.h5 from records.h5, one configuration in memory at a time."""
    path = run.path("measure")
    lines = read_plan(run.path("design")).lines if "design" in run.stages else None
    E = shaft_couplings(run.study)
    friction = find_friction_of_run(path, run.study.estimator, lines, E)
    if friction is not None:
        run.console.notes(note for note in friction.notes if note.severity == "warning")
    responses: list[FrequencyResponse] = []
    said: set[Note] = set()  # when the records were measured
    names = read_configurations(path)
    with run.console.progress("estimate") as progress:
        for done, name in enumerate(names):
            progress(done, len(names))
            response, notes = estimate_configuration(path, name, run.study.estimator, lines, friction, E)
            responses.append(response)
            said |= notes
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


def find_friction_of_run(
    path: Path, spec: EstimatorSpec, lines: IntArray | None, E: FloatArray | None = None
) -> FrictionTakenOut | None:
    """Friction in records.h5, one configuration in memory at a time; None where the study asks for none."""
    if spec.friction == "none":
        return None
    return find_friction(_RecordsOnShafts(path, E), spec, lines)


@dataclass(frozen=True)
class _RecordsOnShafts:
    """The records of records.h5 on the motors' shafts, read anew, one configuration at a time, whenever they are gone
    through."""

    path: Path
    E: FloatArray | None

    def __iter__(self) -> Iterator[tuple[Record, ...]]:
        for name in read_configurations(self.path):
            yield tuple(on_shafts(each, self.E) for each in read_records(self.path, name))


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
