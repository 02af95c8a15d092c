"""One self-contained HTML page per study: it opens from a mail attachment, offline, on a phone and on paper."""

from __future__ import annotations

import base64
import io
import os
import warnings
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from elastid.report.booklet import booklet
from elastid.report.content import ReportContent
from elastid.report.explorer import explorer
from elastid.report.figures import drawings
from elastid.report.numbers import digits, number, percent
from elastid.report.parameter_rows import parameter_rows

Format: TypeAlias = Literal["png", "pdf"]

DPI = 110
# Without names and dates of the writing program the same content gives the same bytes.
_METADATA: dict[Format, dict[str, None]] = {
    "png": {"Software": None},
    "pdf": {"Creator": None, "Producer": None, "CreationDate": None},
}


@dataclass(frozen=True)
class EmbeddedFigure:
    """A figure as the page holds it: PNG in base64."""

    name: str
    section: str
    caption: str
    png: str


def write_report(content: ReportContent, folder: Path, formats: Collection[Format]) -> Path:
    """folder/report.html, and folder/figures/*.png and *.pdf as formats say; returns the page's path.

    With pdf among the formats also folder/report.pdf, for paper: verdict, warnings, parameters, and all figures.

    Every file appears whole or not at all, the page last. The same content gives the same bytes.
    """
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    embedded, paper = [], io.BytesIO()
    with booklet(paper, content) as add:
        for drawing in drawings(content):
            png = rendered(drawing.figure, "png")
            for kind in formats:
                _write(figures / f"{drawing.name}.{kind}", png if kind == "png" else rendered(drawing.figure, kind))
            if "pdf" in formats:
                add(drawing.figure)
            text = base64.b64encode(png).decode("ascii")
            embedded.append(EmbeddedFigure(drawing.name, drawing.section, drawing.caption, text))
    if "pdf" in formats:
        _write(folder / "report.pdf", paper.getvalue())
    page = folder / "report.html"
    _write(page, html(content, embedded).encode("utf-8"))
    return page


def html(content: ReportContent, figures: Collection[EmbeddedFigure]) -> str:
    """The page; everything that a study or a file could have named is escaped."""
    environment = Environment(
        loader=PackageLoader("elastid", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "digits": digits, "percent": percent}
    free = set(content.result.parameters.free_names)
    return environment.get_template("template.html.j2").render(
        content=content,
        result=content.result,
        rows=parameter_rows(content.result, content.truth),
        given=[(p, content.result.values[p.name]) for p in content.result.parameters if p.name not in free],
        agreements=content.validation.configurations,
        figures=figures,
        explorer=explorer(content.frf, [a.configuration for a in content.validation.left_out]) if content.frf else None,
        rate_is_known=all(measured.rate_is_known for measured, _ in content.frf),
    )


def rendered(figure: Figure, kind: Format) -> bytes:
    """The figure as a file; a letter that the font lacks is drawn as a box without a word."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(buffer, format=kind, dpi=DPI, metadata=_METADATA[kind])
    return buffer.getvalue()


def _write(path: Path, data: bytes) -> None:
    """Under a temporary name first, so that a killed run leaves no half file."""
    temporary = path.with_name(f".{path.name}.part")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
