"""One self-contained HTML page per study, for a mail attachment, a phone or paper; no network needed."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib import rc_context
from matplotlib.figure import Figure
from PIL import Image

from elastid.base.arrays import FloatArray
from elastid.base.display import digits, interval_of, number, percent
from elastid.base.escape import file_names
from elastid.base.execution import Execution
from elastid.base.files import clear_folder
from elastid.base.note import grouped
from elastid.nonlinear.result import friction_rows
from elastid.report.content import ReportContent, ResponsesContent, parameter_rows
from elastid.report.figures import style
from elastid.report.figures.drawings import (
    CONFIGURATION,
    Drawing,
    drawings,
    friction_drawings,
    quality_drawings,
    response_drawings,
)
from elastid.report.figures.responses import configuration_title
from elastid.report.figures.style import own_style
from elastid.report.page import booklet
from elastid.report.page.explorer import asset, curve_scripts, explorer, mode_viewer, script_policy
from elastid.report.page.first_screen import first_screen, row_axis
from elastid.response import FrequencyResponse

FigureFormat: TypeAlias = Literal["png", "pdf"]

DPI = 110
# Beyond this, the largest figures are links to files. With the data of 20 configurations of a six-axis robot the page
# then stays below 10 MB.
MAX_FIGURE_BYTES = 1_200_000


@dataclass(frozen=True)
class EmbeddedFigure:
    """A figure of the page: PNG in base64, empty where it is only in a file, or in none."""

    name: str
    section: str
    caption: str
    png: str
    file: str = ""


def write_report(
    content: ReportContent, folder: Path, formats: Collection[FigureFormat], execution: Execution | None = None
) -> Path:
    """Write folder/report.html, and folder/figures/* in the given formats; returns the path of the page.

    With pdf among the formats also folder/report.pdf: verdict, notes, parameters and modes, and all figures.
    Every file appears whole or not at all, the page last. The same content gives the same bytes, whatever `execution`.
    """
    page, front = partial(html, content), booklet.front_pages(content)
    return write_page(content.title, page, drawings(content), front, folder, formats, execution)


@own_style()
def write_page(
    title: str,
    page: Callable[[list[EmbeddedFigure]], str],
    drawn: Iterable[Drawing],
    front: Iterable[Figure],
    folder: Path,
    formats: Collection[FigureFormat],
    execution: Execution | None = None,
    name: str = "report.html",
) -> Path:
    """The figures and the front pages of one content as folder/`name` and, with pdf, as folder/report.pdf.

    page(figures): its HTML.  folder/figures/* are replaced.
    """
    figures, paper = clear_folder(folder, "figures"), folder / "report.pdf"
    paper.unlink(missing_ok=True)
    figures.mkdir(parents=True)
    todo = [drawing for drawing in drawn if drawing.on_page or formats]
    write = partial(_written, figures, tuple(formats))
    embedded = (execution or Execution()).ordered(write, todo)
    if "pdf" in formats:
        write_whole(paper, booklet.bound(title, front, todo))
    write_whole(folder / name, page(within(embedded, MAX_FIGURE_BYTES)).encode("utf-8"))
    return folder / name


@own_style()
def _written(figures: Path, formats: Sequence[FigureFormat], drawing: Drawing) -> EmbeddedFigure:
    with rc_context({"axes.titley": 1.0}):  # where matplotlib seeks room for titles, it places all ticks twice
        figure = drawing.draw()
    png = rendered(figure, "png") if drawing.on_page or "png" in formats else b""
    for kind in formats:
        write_whole(figures / f"{drawing.name}.{kind}", png if kind == "png" else rendered(figure, kind))
    text = base64.b64encode(png).decode("ascii") if drawing.on_page else ""
    file = f"figures/{drawing.name}.{'png' if 'png' in formats else 'pdf'}" if formats else ""
    return EmbeddedFigure(drawing.name, drawing.section, drawing.caption, text, file)


def within(figures: Sequence[EmbeddedFigure], room: int) -> list[EmbeddedFigure]:
    """The figures, without the largest of single configurations as far as all take more than `room` bytes."""
    excess = sum(len(figure.png) for figure in figures) - room
    dropped = set()
    for figure in sorted(figures, key=lambda figure: -len(figure.png)):
        if excess > 0 and figure.section.startswith(CONFIGURATION):
            dropped.add(figure.name)
            excess -= len(figure.png)
    return [replace(figure, png="") if figure.name in dropped else figure for figure in figures]


def html(content: ReportContent, figures: Collection[EmbeddedFigure]) -> str:
    """The page; every text from a study or a file is escaped."""
    free = set(content.result.parameters.free_names)
    rate_is_known = all(measured.rate_is_known for measured, _ in content.frf)
    left_out = [agreement.configuration for agreement in content.validation.left_out]
    responses = explorer(content.frf, left_out, _models(content)) if content.frf else ""
    modes = mode_viewer(content.modes, rate_is_known)
    scripts = curve_scripts() if responses else (asset("first_screen.js"),)
    rows = parameter_rows(content.result, content.truth, content.contents)
    return render(
        "template.html.j2",
        content,
        figures,
        responses,
        (*scripts, asset("mode_viewer.js")) if modes else scripts,
        result=content.result,
        rows=rows,
        given=[(p, content.result.values[p.name]) for p in content.result.parameters if p.name not in free],
        agreements=content.validation.configurations,
        mode_viewer=modes,
        hz="Hz" if rate_is_known else "units of the sampling rate",
        axis=row_axis(rows),
        **first_screen(content, rows),
    )


def _models(content: ReportContent) -> tuple[tuple[FrequencyResponse, FloatArray | None], ...]:
    """The model of each configuration to draw: on lines of its own, else on the measured ones with its std."""
    if content.dense:
        return content.dense
    std = content.model_std or (None,) * len(content.frf)
    return tuple((modelled, each) for (_, modelled), each in zip(content.frf, std, strict=True))


def render(
    template: str,
    content: Any,
    figures: Collection[EmbeddedFigure],
    curves: str = "",
    scripts: Sequence[str] = (),
    **values: Any,
) -> str:
    """A page of a template of this package; curves: data of the explorer, values: further names."""
    environment = Environment(
        loader=PackageLoader("elastid.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "digits": digits, "percent": percent, "interval_of": interval_of}
    environment.filters |= {"grouped": grouped, "friction_rows": friction_rows}
    return environment.get_template(template).render(
        {"mode_viewer": ""} | values,
        asset=asset,
        content=content,
        figures=figures,
        explorer=curves,
        scripts=scripts,
        policy=script_policy(scripts),
    )


def rendered(figure: Figure, kind: FigureFormat) -> bytes:
    """The figure as the bytes of a file."""
    buffer = io.BytesIO()
    with booklet.missing_glyphs_allowed():
        if kind == "pdf":
            figure.savefig(buffer, format=kind, metadata=booklet.PDF_METADATA)
            return buffer.getvalue()
        figure.savefig(buffer, format="rgba", dpi=DPI)
    width, height = (int(inches * DPI) for inches in figure.get_size_inches())
    image = Image.frombytes("RGBA", (width, height), buffer.getvalue())
    # 256 colors take less than half of the bytes, without a visible difference.
    few = image.convert("RGB").quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    file = io.BytesIO()
    few.save(file, "png", dpi=(DPI, DPI))  # the highest compression takes seven times as long and saves a tenth
    return file.getvalue()


def write_whole(path: Path, data: bytes) -> None:
    """Under a temporary name first, so that a killed run leaves no half file; OSError names the file."""
    temporary = path.with_name(f".{path.name}.part")
    try:
        temporary.unlink(missing_ok=True)  # a link would be followed
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_page_of_responses(
    content: ResponsesContent, folder: Path, formats: Collection[FigureFormat], execution: Execution | None = None
) -> Path:
    """folder/report.html and folder/figures/*, with pdf among the formats folder/report.pdf; the path of the page."""
    page, front = partial(html_of_responses, content), booklet.front_pages_of_responses(content)
    return write_page(content.title, page, _response_drawings(content), front, folder, formats, execution)


def html_of_responses(content: ResponsesContent, figures: Collection[EmbeddedFigure]) -> str:
    """The page; every text from a study or a file is escaped."""
    responses = explorer([(response, None) for response in content.responses])
    unit = style.frequency_unit(content.rate_is_known)
    return render("responses.html.j2", content, figures, responses, curve_scripts(), frequency_unit=unit)


def _response_drawings(content: ResponsesContent) -> Iterator[Drawing]:
    yield from friction_drawings(content.friction)
    files = file_names([response.configuration.name for response in content.responses], "frf")
    for file, response in zip(files, content.responses, strict=True):
        title = configuration_title(response, left_out=False)
        yield from response_drawings(file, response, None, title)
        yield from quality_drawings(file, response, title)
