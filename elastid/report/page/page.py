"""One self-contained HTML page of a study or of responses, for mail, phone or paper, without a network."""

from __future__ import annotations

import base64
import io
import warnings
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib import rc_context
from matplotlib.figure import Figure
from PIL import Image

from elastid.base.arrays import FloatArray
from elastid.base.display import digits, interval_of, number, percent
from elastid.base.execution import Execution
from elastid.base.files import clear_folder, write_whole
from elastid.base.note import grouped
from elastid.nonlinear.result import friction_rows
from elastid.report import overview
from elastid.report.content import ReportContent, ResponsesContent, gear_line, gear_table, parameter_rows, seen_words
from elastid.report.figures import style
from elastid.report.figures.drawings import Drawing, drawings, drawings_of_responses
from elastid.report.figures.style import own_style
from elastid.report.page.explorer import asset, curve_scripts, explorer, mode_viewer, script_policy
from elastid.report.page.first_screen import first_screen, row_axis
from elastid.response import Response

DPI = 110


@dataclass(frozen=True)
class EmbeddedFigure:
    """A figure of the page: PNG in base64, empty where it is only in a file, or in none."""

    name: str
    section: str
    caption: str
    png: str
    file: str = ""


def write_report(
    content: ReportContent, folder: Path, formats: Collection[str], execution: Execution | None = None
) -> Path:
    """Write folder/report.html, and folder/figures/* in the given formats; returns the path of the page.

    Every file appears whole or not at all, the page last. The same content gives the same bytes, whatever `execution`.
    """
    return write_page(partial(html, content), drawings(content), folder, formats, execution)


@own_style()
def write_page(
    page: Callable[[list[EmbeddedFigure]], str],
    drawn: Iterable[Drawing],
    folder: Path,
    formats: Collection[str],
    execution: Execution | None = None,
    name: str = "report.html",
) -> Path:
    """The page of one content as folder/`name`; page(figures): its HTML.  folder/figures/* are replaced."""
    figures = clear_folder(folder, "figures")
    figures.mkdir(parents=True)
    todo = [drawing for drawing in drawn if drawing.on_page or formats]
    write = partial(_written, figures if formats else None)
    embedded = (execution or Execution()).ordered(write, todo)
    write_whole(folder / name, page(embedded).encode("utf-8"))
    return folder / name


@own_style()
def _written(figures: Path | None, drawing: Drawing) -> EmbeddedFigure:
    with rc_context({"axes.titley": 1.0}):  # where matplotlib seeks room for titles, it places all ticks twice
        figure = drawing.draw()
    png, name = rendered(figure), f"{drawing.name}.png"
    if figures is not None:
        write_whole(figures / name, png)
    text = base64.b64encode(png).decode("ascii") if drawing.on_page else ""
    file = "" if figures is None else f"figures/{name}"
    return EmbeddedFigure(drawing.name, drawing.section, drawing.caption, text, file)


def html(content: ReportContent, figures: Collection[EmbeddedFigure]) -> str:
    """The page; every text from a study or a file is escaped."""
    free = set(content.result.parameters.free_names)
    rate_is_known = all(measured.rate_is_known for measured, _ in content.frf)
    left_out = [agreement.configuration for agreement in content.validation.left_out]
    responses = explorer(content.frf, left_out, _models(content)) if content.frf else ""
    modes = mode_viewer(content.modes, rate_is_known)
    scripts = curve_scripts() if responses else (asset("first_screen.js"),)
    scripts = (*scripts, asset("mode_viewer.js")) if modes else scripts
    rows = parameter_rows(content.result, content.truth, content.contents)
    given = [(p, content.result.values[p.name]) for p in content.result.parameters if p.name not in free]
    values = {"result": content.result, "rows": rows, "given": given, "axis": row_axis(rows), "mode_viewer": modes}
    values |= {"agreements": content.validation.configurations, **first_screen(content, rows)}
    values["hz"] = "Hz" if rate_is_known else "units of the sampling rate"
    return render("template.html.j2", content, figures, responses, scripts, **values)


def _models(content: ReportContent) -> tuple[tuple[Response, FloatArray | None], ...]:
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
    names = {"content": content, "figures": figures, "explorer": curves, "scripts": scripts} | values
    names = {"mode_viewer": ""} | names
    return _environment().get_template(template).render(names, asset=asset, policy=script_policy(scripts))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("elastid.report", "page"), autoescape=True, undefined=StrictUndefined
    )
    environment.trim_blocks = environment.lstrip_blocks = True
    environment.filters |= {"number": number, "digits": digits, "percent": percent, "interval_of": interval_of}
    environment.filters |= {"grouped": grouped, "friction_rows": friction_rows}
    environment.filters["coded"] = _coded
    environment.filters |= {"gear_table": gear_table, "gear_line": gear_line, "seen_words": seen_words}
    return environment


def _coded(sentence: str) -> Markup:
    """A sentence with the words between backticks as code."""
    parts = [escape(part) for part in sentence.split("`")]
    return Markup("").join(Markup("<code>{}</code>").format(part) if i % 2 else part for i, part in enumerate(parts))


def rendered(figure: Figure) -> bytes:
    """The figure as the bytes of a PNG file; a letter that the font lacks is a box, without a warning."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(buffer, format="rgba", dpi=DPI)
    width, height = (int(inches * DPI) for inches in figure.get_size_inches())
    image = Image.frombytes("RGBA", (width, height), buffer.getvalue())
    # 256 colors take less than half of the bytes, without a visible difference.
    few = image.convert("RGB").quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    file = io.BytesIO()
    few.save(file, "png", dpi=(DPI, DPI))  # the highest compression takes seven times as long and saves a tenth
    return file.getvalue()


def write_page_of_responses(
    content: ResponsesContent, folder: Path, formats: Collection[str], execution: Execution | None = None
) -> Path:
    """folder/report.html and folder/figures/*; the path of the page."""
    page = partial(html_of_responses, content)
    return write_page(page, drawings_of_responses(content), folder, formats, execution)


def html_of_responses(content: ResponsesContent, figures: Collection[EmbeddedFigure]) -> str:
    """The page; every text from a study or a file is escaped."""
    responses = explorer(list(zip(content.responses, content.synthesised, strict=True)))
    viewer = mode_viewer(content.mode_rows, content.rate_is_known)
    scripts = (*curve_scripts(), asset("mode_viewer.js")) if viewer else curve_scripts()
    names: dict[str, Any] = {"frequency_unit": style.frequency_unit(content.rate_is_known), "mode_viewer": viewer}
    names["questions"] = overview.questions_of_responses(content)
    return render("responses.html.j2", content, figures, responses, scripts, **names)
