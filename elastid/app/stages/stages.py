"""design, measure, estimate, fit, validate, report: file -> value -> file, each in the run folder of a study.

Each takes a Run whose earlier results are there and leaves its own; `run_all` works on those that are not current.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from elastid.app.imported_responses import imported_responses
from elastid.app.run import Run
from elastid.app.stages.design_problem import brief_of
from elastid.app.stages.validation import validated
from elastid.app.summaries import failure, interrupted, modes_of, summary, truth, validation_summary
from elastid.app.tables import forecast_table, parameter_table
from elastid.base.arrays import IntArray
from elastid.base.errors import FitError, StudyError
from elastid.base.execution import Execution, unordered
from elastid.base.note import Note, grouped
from elastid.design.design import design as design_experiments
from elastid.experiment.plan.plan import Experiment
from elastid.experiment.plan.references import references
from elastid.experiment.plan.rig import Rig
from elastid.experiment.simulated.closed_loop import feed_forward_of
from elastid.experiment.simulated.plant import model_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.fit.fitted_model import FittedModel, models_by_group
from elastid.fit.identify import identify
from elastid.fit.result import FitResult
from elastid.fit.solve.multistart import Interrupted
from elastid.frf.estimate import estimate as estimate_response
from elastid.frf.spec import EstimatorSpec
from elastid.record import Record
from elastid.recorded.rig import RecordedRig
from elastid.report.parameter_rows import parameter_rows
from elastid.response import FrequencyResponse
from elastid.store import (
    Checkpoint,
    Stamp,
    read_configurations,
    read_fit,
    read_forecast,
    read_peaks,
    read_plan,
    read_records,
    read_rehearsal,
    read_responses,
    read_stamp,
    read_validation,
    remove_leftovers,
    text_file,
    write_fit,
    write_movement,
    write_plan,
    write_records,
    write_responses,
    write_torque,
    write_validation,
)
from elastid.store.comparison import read_comparison
from elastid.validation.agreement import agreement

TRUSTED = ("converged", "at_bound")


def run_all(run: Run) -> None:
    """All stages in order, but for those whose result is current; FitError where the fit cannot be trusted."""
    with run.logged():
        for stage in run.stages:
            if run.is_current(stage):
                run.console.say(f"{stage}: nothing has changed, {run.path(stage).name} is kept")
                # Of a stage that was killed once its result was written, and before it had tidied up.
                shutil.rmtree(run.partial(stage), ignore_errors=True)
            else:
                WORK[stage](run)
        _conclude(run)


def only(run: Run, stage: str) -> None:
    """One stage, whatever it left before; StudyError where a result that it reads is missing or out of date."""
    if stage not in run.stages:
        kind = "frequency responses from elsewhere" if run.study.experiment.kind == "responses" else "recorded"
        raise StudyError(
            f"{run.loaded.path}: the experiment is {kind}, there is nothing to {stage}; the first stage is "
            f"`{run.stages[0]}`"
        )
    run.require(stage)
    with run.logged():
        WORK[stage](run)
        if stage == "fit":
            _conclude(run)


def design(run: Run) -> None:
    """plan.h5 with its forecast, and references/*.csv for a robot controller, within the robot's limits.

    <configuration>-movement.csv: a whole run with its ramps.  <experiment>.csv: one period of torque to inject.
    """
    study = run.study
    with run.console.progress("design") as progress:
        design = design_experiments(brief_of(run.loaded), Execution(run.jobs, progress))
    plan, forecast, peaks = design.plan, design.forecast, design.limit_use
    movements = references(plan, study.experiment.as_simulated().carrier, feed_forward_of(model_of(study.robot)))
    folder = run.folder / "references"
    shutil.rmtree(folder, ignore_errors=True)
    for movement in movements:
        write_movement(folder / f"{movement.configuration.name}-movement.csv", movement, plan.inputs, plan.sliding)
    for experiment in plan.experiments:
        write_torque(folder / f"{experiment.name}.csv", plan, experiment)
    write_plan(run.path("design"), plan, run.stamps["design"], movements, peaks, forecast, design.nearest)
    _pass_on(run, peaks.notes)
    run.console.say(f"design: {peaks.closest}")
    run.console.say(
        f"design: {len(plan.experiments)} experiments in {len(plan.configurations)} configurations, {len(plan.lines)} "
        f"lines from {plan.freq_hz[0]:g} to {plan.freq_hz[-1]:g} Hz, {plan.robot_time_s:g} s of the robot's time"
    )
    if forecast.choice:
        run.console.say(f"design: {forecast.choice}")
    run.console.table(forecast_table(forecast))
    _pass_on(run, forecast.notes)


def measure(run: Run) -> None:
    """records.h5, from the simulated rig or from the recorded logs; an earlier, stopped measurement is gone on with."""
    rig, stamp = _rig(run), run.stamps["measure"]
    folder = run.partial("measure")
    folder.mkdir(parents=True, exist_ok=True)
    remove_leftovers(folder)
    todo = [experiment for experiment in rig.experiments if not _is_measured(folder, experiment, stamp)]
    if len(todo) < len(rig.experiments):
        run.console.say(f"measure: going on, {len(rig.experiments) - len(todo)} of {len(rig.experiments)} are there")
    with run.console.progress("measure") as progress:
        for _ in unordered(partial(_measure, rig, folder, stamp), todo, run.jobs, progress):
            pass
    notes: dict[Note, None] = {}
    write_records(run.path("measure"), _measured(rig, folder, notes), stamp)
    shutil.rmtree(folder)
    _pass_on(run, notes)
    run.console.say(f"measure: {len(rig.experiments)} records")


def estimate(run: Run) -> None:
    """frf.h5: one response for each configuration, from its records or from a file that was made elsewhere."""
    responses = _imported(run) if run.study.experiment.kind == "responses" else _from_records(run)
    write_responses(run.path("estimate"), responses, run.stamps["estimate"])
    counts = ", ".join(f"{r.configuration.name} {r.n_lines}" for r in responses)
    run.console.say(f"estimate: {len(responses)} responses (lines: {counts})")


def _imported(run: Run) -> list[FrequencyResponse]:
    responses = list(imported_responses(run.study, run.loaded.base))
    _pass_on(run, (note for response in responses for note in response.notes))
    return responses


def _from_records(run: Run) -> list[FrequencyResponse]:
    """One configuration in memory at a time."""
    study, path = run.study, run.path("measure")
    lines = read_plan(run.path("design")).lines if study.experiment.simulated is not None else None
    responses: list[FrequencyResponse] = []
    said: set[Note] = set()  # when the records were measured
    names = read_configurations(path)
    with run.console.progress("estimate") as progress:
        for done, name in enumerate(names):
            progress(done, len(names))
            response, notes = _estimated(path, name, study.estimator, lines)
            responses.append(response)
            said |= notes
    _pass_on(run, (note for response in responses for note in response.notes if note not in said))
    return responses


def fit(run: Run) -> None:
    """fit.h5 and summary.json; a fit that found nothing leaves a summary that says why, and raises FitError.

    One that is stopped leaves what it has finished in fit.partial, from where the next goes on.
    """
    study, left_out = run.study, run.study.validation.left_out
    responses = read_responses(run.path("estimate"))
    fitted = [response for response in responses if response.configuration.name not in left_out]
    if not run.is_current("validate"):  # of another fit; nobody is to read it beside this one's summary
        run.summary("validate").unlink(missing_ok=True)
    finished = _taken_up(run, "fit")
    try:
        with run.console.progress("fit") as progress:
            execution = Execution(run.jobs, progress, finished)
            result = identify(fitted, study.robot, study.seeded_fit, model=study.model, execution=execution)
    except FitError as error:
        _write_summary(run, "fit", failure(study, str(error)))
        finished.clear()
        raise
    except Interrupted as stop:
        _write_summary(run, "fit", interrupted(study, stop.ends))
        run.console.say(f"fit: stopped, {finished.words or 'no start'} done and kept")
        raise
    _write_summary(run, "fit", _summary(run, result, responses))
    write_fit(run.path("fit"), result, run.stamps["fit"])
    finished.clear()
    _pass_on(run, result.notes)
    run.console.say(f"fit: {result.message}")


def validate(run: Run) -> None:
    """validation.h5 and validation.json: how far the fitted model carries, on left-out configurations if any."""
    responses, result = read_responses(run.path("estimate")), read_fit(run.path("fit"))
    finished = _taken_up(run, "validate")
    with run.console.progress("validate") as progress:
        validation = validated(run, responses, result, finished, progress)
    _write_summary(run, "validate", validation_summary(run.study, validation))
    write_validation(run.path("validate"), validation, run.stamps["validate"])
    finished.clear()
    for words in (validation.verdict, validation.folded, validation.cost, validation.replayed):
        if words:
            run.console.say(f"validate: {words}")


def export(run: Run, target: str) -> tuple[Path, ...]:
    """export/<target>/: the identified model for another tool; StudyError where there is no current fit.

    Where robots, or other groups of configurations, have parameters of their own: a model of each in a folder below.
    """
    from elastid.export.targets import TARGETS

    run.require("validate")  # reads what an export reads
    responses, result = read_responses(run.path("estimate")), read_fit(run.path("fit"))
    folder = run.folder / "export" / target
    shutil.rmtree(folder, ignore_errors=True)
    models = models_by_group(result, run.study.robot, responses, run.study.model, run.study.name)
    if any(models):
        each = (f"{label} ({', '.join(G.configuration.name for G in of.measured)})" for label, of in models.items())
        run.console.say(f"export: a model for each of {', '.join(each)}, which have parameters of their own")
    paths = tuple(path for label, model in models.items() for path in TARGETS[target](folder / label, model))
    if result.status not in TRUSTED:
        run.console.warn(f"export: the fit is not to be trusted ({result.status.replace('_', ' ')}): {result.message}")
    for path in paths:
        run.console.say(f"export: {path}")
    return paths


def report(run: Run) -> None:
    """report.html and figures/."""
    from elastid.report.content import ReportContent  # matplotlib: half a second that no other stage needs
    from elastid.report.page.page import write_report

    study, stamp = run.study, run.stamps["report"]
    responses, result = read_responses(run.path("estimate")), read_fit(run.path("fit"))
    validation = read_validation(run.path("validate"))
    fitted = FittedModel.of(result, study.robot, responses, study.model)
    content = ReportContent(
        title=study.name,
        verdict=validation.verdict,
        result=result,
        frf=tuple(zip(responses, fitted.responses, strict=True)),
        validation=validation,
        modes=modes_of(fitted),
        study_text=run.loaded.text,
        provenance={
            "elastid": stamp.version,
            "seed": str(stamp.seed),
            "hash of the inputs": stamp.inputs,
            "hash of the code": stamp.code,
        },
        truth=truth(study),
        plan=read_plan(run.path("design")) if study.experiment.simulated is not None else None,
        forecast=read_forecast(run.path("design")) if study.experiment.simulated is not None else None,
        limit_use=read_peaks(run.path("design")) if study.experiment.simulated is not None else None,
        nearest_run=read_rehearsal(run.path("design")) if study.experiment.simulated is not None else None,
        robot=study.robot,
        comparison=read_comparison(run.folder / "compare.json", run.stamps["estimate"]),
        model_std=fitted.response_std,
    )
    shutil.rmtree(run.folder / "figures", ignore_errors=True)
    page = write_report(content, run.folder, study.report.formats)
    run.console.say(f"report: {page}")


WORK = {
    "design": design,
    "measure": measure,
    "estimate": estimate,
    "fit": fit,
    "validate": validate,
    "report": report,
}


def _conclude(run: Run) -> None:
    """Show what was found; FitError where it cannot be trusted."""
    result = read_fit(run.path("fit"))
    run.console.table(parameter_table(parameter_rows(result, truth(run.study))))
    for path in (run.path("report"), run.folder / "figures", run.summary("fit")):
        if path.exists():
            run.console.say(str(path))
    if result.status not in TRUSTED:
        raise FitError(f"the fit cannot be trusted ({result.status.replace('_', ' ')}): {result.message}")


def _estimated(
    path: Path, configuration: str, spec: EstimatorSpec, lines: IntArray | None
) -> tuple[FrequencyResponse, set[Note]]:
    """Response of one configuration and the notes of its records, which are gone before the next are read."""
    records = tuple(read_records(path, configuration))
    response = replace(estimate_response(records, spec, lines), repairs=_all_repairs(records))
    return response, {note for record in records for note in record.notes}


def _all_repairs(records: Iterable[Record]) -> dict[str, int]:
    total: dict[str, int] = {}
    for record in records:
        for what, count in record.repairs.items():
            total[what] = total.get(what, 0) + count
    return total


def _rig(run: Run) -> Rig:
    study = run.study
    if study.experiment.recorded is not None:
        return RecordedRig(study.robot, study.experiment, run.loaded.base)
    return SimulatedRig(study.robot, study.experiment, read_plan(run.path("design")), study.seed)


def _partial_path(folder: Path, experiment: Experiment) -> Path:
    return folder / f"{experiment.name}.h5"


def _is_measured(folder: Path, experiment: Experiment, stamp: Stamp) -> bool:
    found = read_stamp(_partial_path(folder, experiment))
    return found is not None and (found.inputs, found.code) == (stamp.inputs, stamp.code)


def _measure(rig: Rig, folder: Path, stamp: Stamp, experiment: Experiment) -> None:
    """Run in a worker, which writes the record itself: no record travels between processes."""
    write_records(_partial_path(folder, experiment), [rig.measure(experiment)], replace(stamp, study=""))


def _measured(rig: Rig, folder: Path, notes: dict[Note, None]) -> Iterator[Record]:
    """The records in the order of the plan, one at a time; their notes are gathered on the way."""
    for experiment in rig.experiments:
        for record in read_records(_partial_path(folder, experiment)):
            notes |= dict.fromkeys(record.notes)
            yield record


def _summary(run: Run, result: FitResult, responses: tuple[FrequencyResponse, ...]) -> dict[str, Any]:
    fitted = FittedModel.of(result, run.study.robot, responses, run.study.model)
    left_out = run.study.validation.left_out
    agreements = [
        agreement(m, G, m.configuration.name in left_out) for m, G in zip(responses, fitted.responses, strict=True)
    ]
    notes = [note for response in responses for note in response.notes]
    return summary(run.study, result, modes_of(fitted), agreements, notes)


def _taken_up(run: Run, stage: str) -> Checkpoint:
    """What the stage had finished when it was stopped, with a word where there is anything."""
    finished = run.finished(stage)
    if finished:
        run.console.say(f"{stage}: going on from {finished.words}")
    return finished


def _write_summary(run: Run, stage: str, content: dict[str, Any]) -> None:
    with text_file(run.summary(stage)) as file:
        json.dump(content, file, indent=1, allow_nan=False)
        file.write("\n")


def _pass_on(run: Run, notes: Iterable[Note]) -> None:
    for group in grouped(notes):
        run.console.warn(str(group))
