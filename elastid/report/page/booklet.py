"""The report on paper: one PDF with verdict, warnings, parameters and modes in front of all figures."""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from elastid.report.content import ReportContent
from elastid.report.figures import style
from elastid.report.modes.mode_row import ModeRow
from elastid.report.numbers import digits, interval_of, number, percent
from elastid.report.parameter_rows import ParameterRow, parameter_rows

# A4 in inches; letters a line and lines a page of a fixed-width font of style.NORMAL points.
PAPER = (8.27, 11.69)
LETTERS, LINES = 96, 68


def front_pages(content: ReportContent) -> Iterator[Figure]:
    """Title, verdict, warnings and the tables of parameters and modes, as many pages as they take."""
    lines = list(_text(content))
    for start in range(0, len(lines), LINES):
        figure = Figure(figsize=PAPER)
        text = style.plain("\n".join(lines[start : start + LINES]))
        figure.text(0.08, 0.95, text, va="top", family="monospace", fontsize=style.NORMAL, linespacing=1.25)
        yield figure


@contextmanager
def booklet(file: io.BytesIO, content: ReportContent) -> Iterator[Callable[[Figure], None]]:
    """A PDF that begins with the front pages; what is yielded adds a page to it, so that no figure need be kept.

    Without names and dates of the writing program the same pages give the same bytes.
    """
    with PdfPages(file, metadata={"Creator": None, "Producer": None, "CreationDate": None}) as pdf:

        def add(page: Figure) -> None:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message="Glyph .* missing from")
                pdf.savefig(page)

        for page in front_pages(content):
            add(page)
        yield add


def _text(content: ReportContent) -> Iterator[str]:
    yield from _wrapped(content.title)
    yield ""
    for warning in content.all_warnings:
        yield from _wrapped(f"! {warning}", "  ")
    if content.all_warnings:
        yield ""
    yield from _wrapped(content.verdict)
    if content.result.message != content.verdict:
        yield from _wrapped(content.result.message)
    for words in (content.validation.folded, content.validation.cost, content.validation.replayed):
        yield from _wrapped(words) if words else ()
    yield ""
    rows = parameter_rows(content.result, content.truth)
    yield from _columns([("parameter", "unit", "estimate", "std", "95 % interval", ""), *map(_row, rows)])
    rate_is_known = all(measured.rate_is_known for measured, _ in content.frf)
    modes = [line for row in content.modes for line in _modes(row)]
    if modes:
        yield ""
        unit = "Hz" if rate_is_known else "× the rate"
        yield from _columns([("configuration", "mode", unit, "damping", "energy in"), *modes])


def _modes(row: ModeRow) -> Iterator[tuple[str, ...]]:
    for i, (f, f_std, zeta, zeta_std, carried, _) in enumerate(row.modes):
        name = row.configuration if i == 0 else ""
        yield name, str(i + 1), number(f, digits(f, f_std)), percent(zeta, digits(zeta, zeta_std)), carried


def _row(row: ParameterRow) -> tuple[str, ...]:
    places = digits(row.estimate, row.std)
    interval = " … ".join(interval_of(row.interval, places))
    bound_hit = "at its bound" if row.at_bound else ""
    return row.name, row.unit, number(row.estimate, places), number(row.std, 2), interval, bound_hit


def _columns(table: list[tuple[str, ...]]) -> Iterator[str]:
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    last = " " * min(sum(widths[:-1]) + 2 * len(widths[:-1]), LETTERS // 2)
    for row in table:
        yield from _wrapped("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)), last)


def _wrapped(text: str, indent: str = "") -> list[str]:
    return textwrap.wrap(text, LETTERS, subsequent_indent=indent) or [""]
