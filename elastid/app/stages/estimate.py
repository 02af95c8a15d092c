"""Stage estimate: records, or responses of other programs -> frf.h5, a response for each configuration."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from elastid.app.console import Console
from elastid.app.run import Artefacts, Work
from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import DataError, Note, StudyError, notes_of
from elastid.base.execution import Execution
from elastid.experiment.specs.experiment import ToolSpec
from elastid.experiment.specs.logs import RecordedSpec, ResponseFileSpec
from elastid.frf.spec import EstimatorSpec
from elastid.logs.files.formats import naming_file
from elastid.logs.responses.reading import link_side_response, read_table
from elastid.nonlinear.compensate_friction import shaft_couplings, to_shafts
from elastid.nonlinear.compensated_friction import CompensatedFriction, friction_rows
from elastid.nonlinear.identify_friction import identify_motor_friction
from elastid.nonlinear.net_response import estimate_net_response
from elastid.nonlinear.spectra import ConfigurationSpectra
from elastid.record import Configuration, Record
from elastid.response import Response, in_quantity
from elastid.robot import Robot
from elastid.store.artefacts import kind_of
from elastid.store.measured import read_configurations, read_records, read_responses, write_responses
from elastid.store.plan import read_plan
from elastid.study import Study


def estimate(study: Study, work: Work) -> Artefacts:
    """Estimate the frequency responses: frf.h5; each process has one configuration in memory at a time."""
    robot, estimator, records = study.robot, study.estimator, work.sources["measure"]
    lines = read_plan(work.sources["design"]).lines if "design" in work.sources else None
    names, friction, recorded = read_configurations(records), None, study.experiment.recorded
    friction_execution = Execution(work.jobs)
    if estimator.friction != "none" and (recorded is None or not recorded.has_no_torque):
        on_motors = [RecordsOnShafts(records, name, shaft_couplings(robot)) for name in names]
        friction = identify_motor_friction(on_motors, estimator, lines, friction_execution)
        work.console.notes(note for note in friction.notes if note.severity == "warning")
    estimate_one = partial(estimate_configuration, records, estimator, lines, friction, robot, recorded=recorded)
    with work.execution() as execution:
        estimates = execution.ordered(estimate_one, [(name, friction_execution.checkpoint.get(name)) for name in names])
    responses = [response for response, _ in estimates]
    record_notes = {note for _, notes in estimates for note in notes}  # printed by the stage measure
    notes = [note for note in notes_of(responses) if note not in record_notes]
    return _artefacts(responses, work.unanswered(notes), friction)


def import_responses(study: Study, work: Work) -> Artefacts:
    """Import frequency responses of other programs or of another run: frf.h5."""
    responses = list(imported_responses(study, work.base))
    return _artefacts(responses, notes_of(responses))


def estimate_configuration(
    path: Path, spec: EstimatorSpec, lines: IntArray | None, friction: CompensatedFriction | None, robot: Robot | None,
    configuration: tuple[str, ConfigurationSpectra | None], recorded: RecordedSpec | None = None,
) -> tuple[Response, set[Note]]:  # fmt: skip
    """Estimate the response of one configuration; return it with the notes of its records.

    friction: compensated in the torque before the estimation.  robot: with the gears of the motors, or None.
    configuration: name, and its spectra or None.  recorded: section of the logs, with or without a controller.
    """
    records = tuple(read_records(path, configuration[0]))
    response = estimate_net_response(records, friction, spec, lines, shaft_couplings(robot), robot, configuration[1])
    if recorded is not None and recorded.controller is not None and robot is not None:
        from elastid.logs.reference_loop import with_reference_loop  # slow imports: CasADi
        from elastid.logs.step_images import with_image_errors

        if recorded.has_no_torque:
            response = with_reference_loop(response, recorded, robot, records[0])
        else:
            response = with_image_errors(response, recorded, robot)
    repairs = sum((Counter(record.repairs) for record in records), Counter())
    return replace(response, repairs=dict(repairs)), {*notes_of(records)}


@dataclass(frozen=True)
class RecordsOnShafts:
    """Records of a configuration in records.h5 with the signals of the motor shafts, read at each iteration."""

    path: Path
    configuration: str
    E: FloatArray | None

    def __iter__(self) -> Iterator[Record]:
        return (to_shafts(record, self.E) for record in read_records(self.path, self.configuration))


def _artefacts(
    responses: Sequence[Response], notes: Sequence[Note], friction: CompensatedFriction | None = None
) -> Artefacts:
    """Return frf.h5 and the report on notes, sizes and compensated friction."""

    def report(console: Console) -> None:
        """Print the notes, the number of responses and lines, and the compensated friction."""
        console.notes((note for note in notes if note.code == "frf/method"), on_page=True)
        console.notes(note for note in notes if note.code != "frf/method")
        lines = {r.configuration.name: r.n_lines for r in responses}
        plural = "s" * (len(responses) != 1)
        sizes = f"(DFT lines: {list_values(lines)})"
        if len({*lines.values()}) == 1:
            sizes = f"with {responses[0].n_lines} DFT lines{' each' * bool(plural)}"
        console.say(f"estimate: FRF{plural} of {len(responses)} configuration{plural} {sizes}")
        if friction is None:
            return
        if rows := [row for row in friction_rows(friction) if row.coulomb_torque is not None]:
            torques = {row.place: f"{row.coulomb_torque:.4g} {row.unit} (std {row.std:.2g})" for row in rows}
            motors = "Coulomb friction of the motors (link-side values)"
            console.say(f"estimate: {motors} subtracted from the torque: {list_values(torques)}")
        for note in friction.notes:  # warnings are printed already
            if note.severity == "information" and note.code != "nonlinear/friction-compensated":
                console.say(f"estimate: {note.text}")

    return Artefacts({"frf.h5": lambda path, stamp: write_responses(path, responses, stamp, friction)}, report)


def list_values(values: Mapping[str, object]) -> str:
    """Return names and values as text."""
    return ", ".join(f"{name} {value}" for name, value in values.items())


def imported_responses(study: Study, base: Path) -> Iterator[Response]:
    """Read a response per file; StudyError if channels or configurations do not fit, DataError for an unusable file."""
    spec, estimator = study.experiment.responses, study.estimator
    assert spec is not None
    configurations = study.experiment.postures
    for file in spec.files:
        path, configuration = base / file.path, configurations[file.configuration]
        if kind_of(path) == "frf":
            response = in_quantity(_response_of_another_run(path, file, configuration, study.robot), estimator.quantity)
            if "zero-order" in (spec.hold, *(channel.hold for channel in spec.channels)):
                text = "its hold is not removed: the study that estimated it states it in experiment.recorded.hold"
                response = replace(response, notes=(*response.notes, Note("responses/hold", text, str(path))))
        else:
            if not spec.channels:
                text = "the inputs and outputs of this file are not stated. List them in experiment.responses.channels"
                raise StudyError("study/invalid", text, path)
            with naming_file(path, f"its values are no frequency response; look at them with `elastid inspect {path}`"):
                table = read_table(path, spec, file.response)
                response = link_side_response(table, spec, configuration, study.places, estimator.quantity)
        if estimator.band_hz is not None:
            low, high = estimator.band_hz
            inside = (response.freq_hz >= low) & (response.freq_hz <= high)
            if not inside.any():
                raise DataError("responses/lines", f"none of its lines lies in band_hz, {low:g} to {high:g} Hz", path)
            response = response.lines(inside)
        yield response


def tool_responses(tool: ToolSpec | None, study: Study, base: Path) -> list[Response]:
    """Read the responses to forces at the tool, which may complement any experiment."""
    if tool is None:
        return []
    experiment = replace(study.experiment, simulated=None, recorded=None, responses=tool.responses)
    at_tool = replace(study, experiment=experiment, estimator=replace(study.estimator, band_hz=None))
    return [replace(G, motors=tool.motors, loop=tool.loop) for G in imported_responses(at_tool, base)]


def _response_of_another_run(
    path: Path, file: ResponseFileSpec, configuration: Configuration, robot: Robot | None
) -> Response:
    responses = {response.configuration.name: response for response in read_responses(path)}
    name = file.response or configuration.name
    if name not in responses:
        names = ", ".join(responses) or "none"
        raise DataError("responses/table", f"no response of configuration {name} in it; there are {names}", path)
    response = responses[name]
    angles, planned = response.configuration.angles, configuration.angles
    if robot is None or not angles.size:  # one of the studies has no robot
        return replace(response, configuration=configuration)
    # Angles of one configuration agree within 1e-3 rad (positions: 1e-3 m).
    if angles.shape != planned.shape or np.any(np.abs(angles - planned) > 1e-3):
        text = f"{name} was measured at {angles.tolist()}, the study's {configuration.name} is at {planned.tolist()}"
        raise DataError("responses/table", f"{text}; correct experiment.configurations", path)
    return replace(response, configuration=configuration)
