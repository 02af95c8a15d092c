"""report of a friction study: all results of a run -> report.html and figures/."""

from __future__ import annotations

from elastid.app.run import Run
from elastid.report.friction_content import FrictionContent
from elastid.report.page.page_of_friction import write_page_of_friction
from elastid.store.friction_study import FRICTION, read_filter, read_friction_plan, read_friction_result
from elastid.store.results import read_twin


def report(run: Run) -> None:
    """report.html and figures/."""
    stamp = run.stamps["report"]
    content = FrictionContent(
        title=run.study.name,
        result=read_friction_result(run.path("friction")),
        study_text=run.loaded.text,
        provenance=stamp.shown,
        plan=read_friction_plan(run.path("design")) if "design" in run.stages else None,
        twin=read_twin(run.path("friction"), FRICTION),
        filters=read_filter(run.path("follow")) if "follow" in run.stages else (),
    )
    with run.execution("report") as execution:
        page = write_page_of_friction(content, run.folder, run.study.report.formats, execution)
    run.console.say(f"report: {page}")
