"""report of a study without a robot: responses -> report.html, figures/ and peaks.csv."""

from __future__ import annotations

from elastid.app.run import Run
from elastid.export.peaks import write_peaks
from elastid.frf.peaks import peaks
from elastid.nonlinear.result import FrictionTakenOut
from elastid.report.page.page_of_responses import ResponsesContent, write_page_of_responses
from elastid.store import read_friction, read_responses


def report(run: Run) -> None:
    """report.html, figures/ and peaks.csv."""
    stamp, responses = run.stamps["report"], read_responses(run.path("estimate"))
    found = tuple(peaks(response) for response in responses)
    write_peaks(run.folder / "peaks.csv", responses, found)
    content = ResponsesContent(
        title=run.study.name,
        responses=responses,
        peaks=found,
        study_text=run.loaded.text,
        provenance=stamp.shown,
        friction=_friction(run),
    )
    with run.execution("report") as execution:
        page = write_page_of_responses(content, run.folder, run.study.report.formats, execution)
    for response, of_it in zip(responses, found, strict=True):
        at = ", ".join(f"{peak.freq_hz:.4g}" for peak in of_it)
        unit = "Hz" if response.rate_is_known else "of the sampling rate"
        run.console.say(f"report: {response.configuration.name}: " + (f"peaks at {at} {unit}" if at else "no peak"))
    run.console.say(f"report: {page}")


def _friction(run: Run) -> FrictionTakenOut | None:
    """Friction that was taken out, or asked for by name; `auto` finds none in most structures, which says nothing."""
    friction = read_friction(run.path("estimate"))
    if friction is None or (run.study.estimator.friction == "auto" and not friction.shapes):
        return None
    return friction
