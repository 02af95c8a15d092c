"""The report on paper: a PDF of a title page, notes, verdict, whole tables and all figures, on numbered A4 pages."""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain, groupby

import numpy as np
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from elastid.base.display import digits, number, percent, value_cells
from elastid.base.note import NoteGroup
from elastid.nonlinear.result import FrictionTakenOut, friction_rows
from elastid.report import overview
from elastid.report.content import ParameterRow, ReportContent, ResponsesContent, parameter_rows
from elastid.report.figures import style
from elastid.report.figures.drawings import Drawing
from elastid.report.modes import ModeRow
from elastid.validation.twin import describe_balance
from elastid.validation.twin_run import TwinFindings

# A4 in inches; letters in a line and lines on a page, in a fixed-width font of style.NORMAL points.
PAPER = (8.27, 11.69)
MAX_LETTERS, MAX_LINES = 96, 68
# Of provenance and page numbers.
INK = "#555555"
# Without names and dates of the writing program the same pages give the same bytes.
PDF_METADATA = {"Creator": None, "Producer": None, "CreationDate": None}


@contextmanager
def missing_glyphs_allowed() -> Iterator[None]:
    """Inside, a letter that the font lacks is drawn as a box, without a warning."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def front_pages(content: ReportContent) -> Iterator[Figure]:
    """The title page, then notes, verdict and the tables of parameters, friction and modes."""
    result, agreements = content.result, content.validation.configurations
    rows = parameter_rows(result, content.truth, content.contents)
    status = result.status.replace("_", " ").upper()
    sentences = [
        overview.summary_line(content),
        f"{status}: {overview.verdict_sentence(result, rows, agreements)}.",
        f"Are the numbers good? {overview.numbers_answer(result, rows)}",
        f"Where does the model fail? {overview.residual_sentence(result, agreements)}",
    ]
    yield from pages_of(content.title, sentences, content.provenance, _text(content))


def front_pages_of_responses(content: ResponsesContent) -> Iterator[Figure]:
    """The title page, then notes and the tables of modes and friction."""
    count = len(content.responses), sum(own.n_modes for own in content.modes)
    sentences = ["Frequency responses of {} configurations, {} modes.".format(*count)]
    text = (*heading(content.title, content.notes), *columns(list(_measured_modes(content))))
    yield from pages_of(content.title, sentences, content.provenance, (*text, *friction_text(content.friction)))


def pages_of(
    title: str, sentences: Sequence[str], provenance: Mapping[str, str], text: Iterable[str]
) -> Iterator[Figure]:
    """Title, answers in sentences and provenance on a page; lines of text on those after it."""
    figure = Figure(figsize=PAPER)
    large = "\n".join(textwrap.wrap(title, 30))
    figure.text(0.1, 0.7, style.plain(large), va="bottom", fontsize=26, weight="bold")
    answers = "\n\n".join("\n".join(textwrap.wrap(sentence, 74)) for sentence in sentences)
    figure.text(0.1, 0.66, style.plain(answers), va="top", fontsize=11, linespacing=1.35)
    origin = "\n".join("\n".join(wrapped(f"{name}: {words}")) for name, words in provenance.items())
    figure.text(0.1, 0.08, style.plain(origin), va="bottom", fontsize=style.NORMAL, color=INK, linespacing=1.35)
    yield figure
    for page in paged(list(text), MAX_LINES):
        figure = Figure(figsize=PAPER)
        lines = style.plain("\n".join(page))
        figure.text(0.08, 0.95, lines, va="top", family="monospace", fontsize=style.NORMAL, linespacing=1.25)
        yield figure


def paged(lines: Sequence[str], most: int) -> list[list[str]]:
    """Lines on pages of at most so many; lines without an empty one between them, as of a table, stay on one page.

    A table longer than a page has its head again on the next.
    """
    pages: list[list[str]] = [[]]
    for table in (list(group) for empty, group in groupby(lines, key=lambda line: not line) if not empty):
        if pages[-1] and len(pages[-1]) + 1 + len(table) > most:
            pages.append([])
        pages[-1] += ["", *table] if pages[-1] else table
        while len(pages[-1]) > most:
            pages.append([table[0], *pages[-1][most:]])
            del pages[-2][most:]
    return pages


def bound(title: str, front: Iterable[Figure], drawn: Sequence[Drawing]) -> bytes:
    """A PDF of the front pages and the figures, each drawn when its turn comes, so that no figure need be kept."""
    from matplotlib.backends.backend_pdf import PdfPages  # brings the subsetting of fonts, for few reports

    file, pages = io.BytesIO(), list(front)
    known = PDF_METADATA | {"Title": title, "Subject": "Elasticity and friction of a robot, identified by elastid"}
    with PdfPages(file, metadata=known) as pdf, missing_glyphs_allowed():
        for number, figure in enumerate(chain(pages, (drawing.draw() for drawing in drawn)), start=1):
            pdf.savefig(figure, bbox_inches=_numbered(figure, f"{number} / {len(pages) + len(drawn)}"))
    return file.getvalue()


def _numbered(figure: Figure, text: str) -> Bbox:
    """The sheet about a figure, in its inches: A4, upright or lying, larger where the figure is; its number is set."""
    size = figure.get_size_inches()
    sheets = [np.array(paper) * max(1.0, *(size / paper)) for paper in (PAPER, PAPER[::-1])]
    sheet = min(sheets, key=lambda size: float(size.prod()))
    low = (size - sheet) / 2
    right, bottom = (low + sheet * (1, 0) + 0.45 * np.array([-1, 1])) / size
    figure.text(right, bottom, text, ha="right", va="bottom", fontsize=style.SMALL, color=INK)
    return Bbox([low, low + sheet])


def _text(content: ReportContent) -> Iterator[str]:
    yield from heading(content.title, content.notes)
    yield from wrapped(content.verdict)
    if content.result.message != content.verdict:
        yield from wrapped(content.result.message)
    predicted = [f"Predicted: {each.words}." for each in content.validation.predictions]
    for words in (content.validation.folded, content.validation.cost, content.validation.replayed, *predicted):
        yield from wrapped(words) if words else ()
    yield ""
    rows = parameter_rows(content.result, content.truth, content.contents)
    yield from columns([("parameter", "unit", "estimate", "std", "95 % interval", ""), *map(_row, rows)])
    yield from friction_text(content.friction)
    unit = style.frequency_unit(all(measured.rate_is_known for measured, _ in content.frf))
    for row in content.modes:
        yield ""
        yield from columns([("configuration", "mode", unit, "damping", "energy in"), *_modes(row)])


def friction_text(friction: FrictionTakenOut | None) -> Iterator[str]:
    """The table of friction that was taken out, and why some was not; nothing where none was searched for."""
    if friction is None:
        return
    yield ""
    table = [("friction taken out at", "unit", "F_c", "std", "95 % interval", "power left")]
    for row in friction_rows(friction):
        if row.level is not None and row.std is not None and row.interval is not None:
            cells = value_cells(row.level, row.std, row.interval)
            table.append((row.place, row.unit, *cells, percent(row.kept_share)))
    if len(table) > 1:
        yield from columns(table)
    for note in friction.notes:
        if note.code != "nonlinear/friction-taken-out":
            yield from wrapped(str(note), "  ")


def twin_text(twin: TwinFindings) -> Iterator[str]:
    """Shares of the model's parts in the torque of each log, and errors of the model in simulation, in words."""
    for words in (*map(describe_balance, twin.balances), *twin.run_words):
        yield ""
        yield from wrapped(words)


def heading(title: str, notes: Sequence[NoteGroup]) -> Iterator[str]:
    """Title and notes."""
    yield from wrapped(title)
    yield ""
    for note in notes:
        yield from wrapped(f"{'!' if note.first.severity == 'warning' else '-'} {note}", "  ")
    if notes:
        yield ""


def _modes(row: ModeRow) -> Iterator[tuple[str, ...]]:
    for i, (f, f_std, zeta, zeta_std, energy, _) in enumerate(row.modes):
        name = row.configuration if i == 0 else ""
        yield name, str(i + 1), number(f, digits(f, f_std)), percent(zeta, digits(zeta, zeta_std)), energy


def _row(row: ParameterRow) -> tuple[str, ...]:
    remark = "; ".join(filter(None, (row.contains, "at its bound" if row.at_bound else "")))
    return row.name, row.unit, *value_cells(row.estimate, row.std, row.interval), remark


def _measured_modes(content: ResponsesContent) -> Iterator[tuple[str, ...]]:
    yield "configuration", style.frequency_unit(content.rate_is_known), "95 % interval", "damping", "95 % interval"
    for own in content.modes:
        for r in range(own.n_modes):
            frequency, _, interval = value_cells(own.freq_hz[r], own.freq_std[r], tuple(own.freq95[r]))
            places = digits(own.zeta[r], own.zeta_std[r])
            low, high = (percent(end, places) for end in own.zeta95[r])
            yield own.configuration, frequency, interval, percent(own.zeta[r], places), f"{low} ... {high}"


def columns(table: Sequence[Sequence[str]]) -> Iterator[str]:
    """A table, its columns aligned."""
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    last = " " * min(sum(widths[:-1]) + 2 * len(widths[:-1]), MAX_LETTERS // 2)
    for row in table:
        yield from wrapped("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)), last)


def wrapped(text: str, indent: str = "") -> list[str]:
    """Text in lines of a page; indent: of all but the first."""
    return textwrap.wrap(text, MAX_LETTERS, subsequent_indent=indent) or [""]
