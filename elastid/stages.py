"""design, measure, estimate, fit, validate, report: file -> value -> file, each in the run folder of a study.

Each takes a Run whose earlier results are there and leaves its own; `run_all` works on those that are not current.
"""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from elastid.errors import FitError, StudyError
from elastid.experiment.designing import designed
from elastid.experiment.plan import Experiment, Plan
from elastid.experiment.recorded import RecordedRig
from elastid.experiment.rig import Rig
from elastid.experiment.simulated import SimulatedRig
from elastid.fit.identify import identify, predict
from elastid.fit.result import FitResult
from elastid.frf.estimators import estimate as estimate_response
from elastid.outcome import failure, modes_of, summary, truth
from elastid.parallel import unordered
from elastid.planning import brief_of
from elastid.record import Record
from elastid.report.parameter_rows import parameter_rows
from elastid.response import FrequencyResponse
from elastid.run import SUMMARY, Run
from elastid.store import (
    Stamp,
    read_configurations,
    read_fit,
    read_forecast,
    read_plan,
    read_records,
    read_responses,
    read_stamp,
    read_validation,
    remove_leftovers,
    text_file,
    write_fit,
    write_plan,
    write_records,
    write_responses,
    write_validation,
)
from elastid.tables import forecast_table, parameter_table
from elastid.validation.frequency import agreement
from elastid.validation.frequency import validate as validate_responses

# Finished experiments of a measurement that was stopped; the next one goes on from here.
PARTIAL = "records.partial"
TRUSTED = ("converged", "at_bound")


def run_all(run: Run) -> None:
    """All stages in order, but for those whose result is current; FitError where the fit cannot be trusted."""
    with run.logged():
        for stage in run.stages:
            if run.is_current(stage):
                run.console.say(f"{stage}: nothing has changed, {run.path(stage).name} is kept")
            else:
                WORK[stage](run)
        _conclude(run)


def only(run: Run, stage: str) -> None:
    """One stage, whatever it left before; StudyError where a result that it reads is missing or out of date."""
    run.require(stage)
    if stage not in run.stages:
        raise StudyError(
            f"{run.loaded.path}: the experiment is recorded, there is nothing to design; the first stage is `measure`"
        )
    with run.logged():
        WORK[stage](run)
        if stage == "fit":
            _conclude(run)


def design(run: Run) -> None:
    """plan.h5 with its forecast, and references/*.csv, one period of each experiment's torques for a controller."""
    study = run.study
    assert study.excitation is not None  # the study's checks ask for it
    with run.console.progress("design") as progress:
        design = designed(brief_of(run.loaded), run.jobs, progress)
    plan, forecast = design.plan, design.forecast
    references = run.folder / "references"
    shutil.rmtree(references, ignore_errors=True)
    for experiment in plan.experiments:
        _write_reference(references / f"{experiment.name}.csv", plan, experiment)
    write_plan(run.path("design"), plan, run.stamps["design"], forecast)
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
    folder = run.folder / PARTIAL
    folder.mkdir(parents=True, exist_ok=True)
    remove_leftovers(folder)
    todo = [experiment for experiment in rig.experiments if not _is_measured(folder, experiment, stamp)]
    if len(todo) < len(rig.experiments):
        run.console.say(f"measure: going on, {len(rig.experiments) - len(todo)} of {len(rig.experiments)} are there")
    with run.console.progress("measure") as progress:
        for _ in unordered(partial(_measure, rig, folder, stamp), todo, run.jobs, progress):
            pass
    notes: dict[str, None] = {}
    write_records(run.path("measure"), _measured(rig, folder, notes), stamp)
    shutil.rmtree(folder)
    _pass_on(run, notes)
    run.console.say(f"measure: {len(rig.experiments)} records")


def estimate(run: Run) -> None:
    """frf.h5: one response for each configuration, one configuration in memory at a time."""
    study, path = run.study, run.path("measure")
    lines = read_plan(run.path("design")).lines if study.experiment.simulated is not None else None
    responses: list[FrequencyResponse] = []
    said: set[str] = set()  # when the records were measured
    names = read_configurations(path)
    with run.console.progress("estimate") as progress:
        for done, name in enumerate(names):
            progress(done, len(names))
            records = tuple(read_records(path, name))
            responses.append(estimate_response(records, study.estimator, lines))
            said |= {note for record in records for note in record.notes}
    write_responses(run.path("estimate"), responses, run.stamps["estimate"])
    _pass_on(run, (note for response in responses for note in response.notes if note not in said))
    counts = ", ".join(f"{r.configuration.name} {r.n_lines}" for r in responses)
    run.console.say(f"estimate: {len(responses)} responses (lines: {counts})")


def fit(run: Run) -> None:
    """fit.h5 and summary.json; a fit that found nothing leaves a summary that says why, and raises FitError."""
    study, left_out = run.study, run.study.validation.left_out
    responses = read_responses(run.path("estimate"))
    fitted = [response for response in responses if response.configuration.name not in left_out]
    try:
        with run.console.progress("fit") as progress:
            result = identify(fitted, study.robot, study.fit, seed=study.seed, jobs=run.jobs, progress=progress)
    except FitError as error:
        _write_summary(run, failure(study, str(error)))
        raise
    _write_summary(run, _summary(run, result, responses))
    write_fit(run.path("fit"), result, run.stamps["fit"])
    _pass_on(run, result.warnings)
    run.console.say(f"fit: {result.message}")


def validate(run: Run) -> None:
    """validation.h5: how far the fitted model carries, on left-out configurations if there are any."""
    responses, result = read_responses(run.path("estimate")), read_fit(run.path("fit"))
    validation = validate_responses(
        responses, predict(result, run.study.robot, responses), run.study.validation.left_out
    )
    write_validation(run.path("validate"), validation, run.stamps["validate"])
    run.console.say(f"validate: {validation.verdict}")


def report(run: Run) -> None:
    """report.html and figures/."""
    from elastid.report.content import ReportContent  # matplotlib: half a second that no other stage needs
    from elastid.report.page import write_report

    study, stamp = run.study, run.stamps["report"]
    responses, result = read_responses(run.path("estimate")), read_fit(run.path("fit"))
    validation = read_validation(run.path("validate"))
    content = ReportContent(
        title=study.name,
        verdict=validation.verdict,
        warnings=tuple(note for response in responses for note in response.notes),
        result=result,
        frf=tuple(zip(responses, predict(result, study.robot, responses), strict=True)),
        validation=validation,
        modes=modes_of(study, result, responses),
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
        robot=study.robot,
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
    for path in (run.path("report"), run.folder / "figures", run.folder / SUMMARY):
        if path.exists():
            run.console.say(str(path))
    if result.status not in TRUSTED:
        raise FitError(f"the fit cannot be trusted ({result.status.replace('_', ' ')}): {result.message}")


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


def _measured(rig: Rig, folder: Path, notes: dict[str, None]) -> Iterator[Record]:
    """The records in the order of the plan, one at a time; their notes are gathered on the way."""
    for experiment in rig.experiments:
        for record in read_records(_partial_path(folder, experiment)):
            notes |= dict.fromkeys(record.notes)
            yield record


def _write_reference(path: Path, plan: Plan, experiment: Experiment) -> None:
    """One period of the torques to inject, link side."""
    time_s = (i / plan.rate_hz for i in range(plan.period_samples))
    with text_file(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time_s", *(f"{place} (N*m, link side)" for place in plan.inputs)])
        for t, torques in zip(time_s, plan.torque(experiment).tolist(), strict=True):
            writer.writerow([f"{t:.9g}", *(f"{torque:.9g}" for torque in torques)])


def _summary(run: Run, result: FitResult, responses: tuple[FrequencyResponse, ...]) -> dict[str, Any]:
    model = predict(result, run.study.robot, responses)
    left_out = run.study.validation.left_out
    agreements = [agreement(m, G, m.configuration.name in left_out) for m, G in zip(responses, model, strict=True)]
    notes = [note for response in responses for note in response.notes]
    return summary(run.study, result, modes_of(run.study, result, responses), agreements, notes)


def _write_summary(run: Run, content: dict[str, Any]) -> None:
    with text_file(run.folder / SUMMARY) as file:
        json.dump(content, file, indent=1, allow_nan=False)
        file.write("\n")


def _pass_on(run: Run, notes: Any) -> None:
    for note in dict.fromkeys(notes):
        run.console.warn(note)
