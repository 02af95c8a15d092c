"""report: all results of a run -> report.html and figures/."""

from __future__ import annotations

from elastid.app.dry_friction import contents
from elastid.app.run import Run
from elastid.app.summaries import modes_of, truth
from elastid.fit.fitted_robot import FittedRobot
from elastid.report.content import ReportContent
from elastid.report.model_lines import dense_models
from elastid.report.page.page import write_report
from elastid.store import (
    changed_texts,
    read_fit,
    read_forecast,
    read_friction,
    read_peaks,
    read_plan,
    read_rehearsal,
    read_responses,
    read_validation,
)
from elastid.store.results import read_comparison, read_twin
from elastid.validation.comparison import Comparison


def report(run: Run) -> None:
    """report.html and figures/."""
    with run.execution("report") as execution:
        page = write_report(_content(run), run.folder, run.study.report.formats, execution)
    run.console.say(f"report: {page}")


def _content(run: Run) -> ReportContent:
    study, stamp = run.study, run.stamps["report"]
    responses, result = read_responses(run.path("estimate")), read_fit(run.path("fit"))
    validation = read_validation(run.path("validate"))
    fitted = FittedRobot.of(result, study.as_robot(), responses, study.model)
    plan = run.path("design") if "design" in run.stages else None
    friction = read_friction(run.path("estimate"))
    return ReportContent(
        title=study.name,
        verdict=validation.verdict,
        result=result,
        frf=tuple(zip(responses, fitted.responses, strict=True)),
        validation=validation,
        modes=modes_of(fitted),
        study_text=run.loaded.text,
        provenance=stamp.shown,
        truth=truth(study, friction),
        plan=read_plan(plan) if plan is not None else None,
        forecast=read_forecast(plan) if plan is not None else None,
        limit_use=read_peaks(plan) if plan is not None else None,
        nearest_run=read_rehearsal(plan) if plan is not None else None,
        robot=study.as_robot(),
        comparison=_comparison(run),
        model_std=fitted.response_std,
        dense=dense_models(fitted),
        friction=friction,
        twin=read_twin(run.path("validate"), "validation"),
        contents=contents(study, friction, result.parameters.free),
    )


def _comparison(run: Run) -> Comparison | None:
    """That of compare.json, where it is of these responses and as it was written."""
    if changed_texts(run.folder, ["compare.json"]):
        path = run.folder / "compare.json"
        run.console.warn(f"{path} has changed since it was written and is left out; run `elastid compare` again")
        return None
    return read_comparison(run.folder / "compare.json", run.stamps["estimate"])
