"""report of a study without a robot: responses -> report.html, figures/ and peaks.csv."""

from __future__ import annotations

from pathlib import Path

from elastid.app.stages.report import page_artefacts
from elastid.app.work import Artefacts, Work
from elastid.export.csv import write_peaks
from elastid.frf.peaks import peaks
from elastid.frf.spec import EstimatorSpec
from elastid.report.content import ResponsesContent
from elastid.report.page.page import write_page_of_responses
from elastid.report.spec import ReportSpec
from elastid.store import Stamp, read_friction, read_responses


def report_responses(
    *, name: str, estimator: EstimatorSpec, text: str, report: ReportSpec, estimate_file: Path, work: Work
) -> Artefacts:
    """The page, figures and peaks.csv of responses without a robot."""
    responses, friction = read_responses(estimate_file), read_friction(estimate_file)
    resonances = tuple(peaks(response) for response in responses)
    # Friction that was taken out, or asked for by name; `auto` finds none in most structures, which is no news.
    if friction is not None and estimator.friction == "auto" and not friction.shapes:
        friction = None
    content = ResponsesContent(
        title=name,
        responses=responses,
        peaks=resonances,
        study_text=text,
        provenance=work.stamp.shown,
        friction=friction,
    )
    lines = []
    for response, own in zip(responses, resonances, strict=True):
        frequencies = ", ".join(f"{peak.freq_hz:.4g}" for peak in own)
        unit = "Hz" if response.rate_is_known else "of the sampling rate"
        words = f"peaks at {frequencies} {unit}" if frequencies else "no peak"
        lines.append(f"report: {response.configuration.name}: {words}")

    def table(path: Path, stamp: Stamp) -> None:
        write_peaks(path, responses, resonances)

    return page_artefacts(write_page_of_responses, content, report, work, {"peaks.csv": table}, lines)
