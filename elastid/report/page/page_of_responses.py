"""The page of a study without a robot: responses with coherence and singular values, and the table of their peaks."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from elastid.base.display import digits, interval_of, number, percent
from elastid.base.escape import file_names
from elastid.base.execution import Execution
from elastid.base.note import NoteGroup, grouped
from elastid.frf.peaks import Peak
from elastid.nonlinear.result import FrictionTakenOut
from elastid.report.figures import style
from elastid.report.figures.drawings import Drawing, friction_drawings, quality_drawings, response_drawings
from elastid.report.figures.responses import configuration_title
from elastid.report.page.booklet import columns, friction_text, heading, text_pages, title_page
from elastid.report.page.explorer import explorer, script_policy
from elastid.report.page.page import EmbeddedFigure, FigureFormat, template, write_figures, write_whole
from elastid.response import FrequencyResponse


@dataclass(frozen=True)
class ResponsesContent:
    """Measured responses and the peaks of each, with the text of the study and the provenance that the page shows.

    friction: what was taken out of the responses.
    """

    title: str
    responses: tuple[FrequencyResponse, ...]
    peaks: tuple[tuple[Peak, ...], ...]
    study_text: str
    provenance: Mapping[str, str]
    friction: FrictionTakenOut | None = None

    @property
    def notes(self) -> tuple[NoteGroup, ...]:
        """Those of the responses; the same from many places once, with a count."""
        return grouped(note for response in self.responses for note in response.notes)

    @property
    def repairs(self) -> dict[str, dict[str, int]]:
        """Configuration to repairs of its records and findings in them, with their counts; those that have any."""
        return {r.configuration.name: dict(r.repairs) for r in self.responses if r.repairs}

    @property
    def rate_is_known(self) -> bool:
        """Whether frequencies are in Hz, not in units of the sampling rate."""
        return all(response.rate_is_known for response in self.responses)


@style.own_style()
def write_page_of_responses(
    content: ResponsesContent, folder: Path, formats: Collection[FigureFormat], execution: Execution | None = None
) -> Path:
    """folder/report.html and folder/figures/*, with pdf among the formats folder/report.pdf; the path of the page."""
    count = len(content.responses), sum(map(len, content.peaks))
    said = ["Frequency responses of {} configurations, {} resonances.".format(*count)]
    text = [*heading(content.title, content.notes), *columns(list(_peak_table(content)))]
    front = [
        title_page(content.title, said, content.provenance),
        *text_pages([*text, *friction_text(content.friction)]),
    ]
    figures = write_figures(content.title, _drawings(content), front, folder, formats, execution)
    page = folder / "report.html"
    write_whole(page, html_of_responses(content, figures).encode("utf-8"))
    return page


def html_of_responses(content: ResponsesContent, figures: Collection[EmbeddedFigure]) -> str:
    """The page; every text from a study or a file is escaped."""
    shown = explorer([(response, None) for response in content.responses])
    return template("responses.html.j2").render(
        content=content,
        figures=figures,
        explorer=shown,
        scripts=shown.scripts,
        policy=script_policy(shown.scripts),
        frequency_unit=style.frequency_unit(content.rate_is_known),
    )


def _drawings(content: ResponsesContent) -> Iterator[Drawing]:
    yield from friction_drawings(content.friction)
    for file, response in zip(
        file_names([response.configuration.name for response in content.responses], "frf"),
        content.responses,
        strict=True,
    ):
        title = configuration_title(response, left_out=False)
        yield from response_drawings(file, response, None, title)
        yield from quality_drawings(file, response, title)


def _peak_table(content: ResponsesContent) -> Iterator[tuple[str, ...]]:
    yield "configuration", style.frequency_unit(content.rate_is_known), "95 % interval", "damping", "largest from, to"
    for response, found in zip(content.responses, content.peaks, strict=True):
        for peak in found:
            places = digits(peak.freq_hz, peak.freq_std)
            yield (
                response.configuration.name,
                number(peak.freq_hz, places),
                " … ".join(interval_of(peak.freq95, places)),
                percent(peak.damping, digits(peak.damping, peak.damping_std)),
                f"{peak.input}, {peak.output}",
            )
