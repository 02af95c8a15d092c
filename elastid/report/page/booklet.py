"""The report on paper: one PDF with notes, verdict, parameters and modes in front of all figures."""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

from matplotlib.figure import Figure

from elastid.base.note import NoteGroup
from elastid.base.numbers import digits, interval_of, number, percent
from elastid.frf.friction.result import FrictionTakenOut
from elastid.report.content import ReportContent
from elastid.report.figures import style
from elastid.report.figures.drawings import Drawing
from elastid.report.friction_rows import FrictionRow, friction_rows
from elastid.report.modes.mode_row import ModeRow
from elastid.report.parameter_rows import ParameterRow, parameter_rows
from elastid.validation.twin import describe_balance
from elastid.validation.twin_run import TwinFindings

# A4 in inches; letters in a line and lines on a page, in a fixed-width font of style.NORMAL points.
PAPER = (8.27, 11.69)
MAX_LETTERS, MAX_LINES = 96, 68
# Without names and dates of the writing program the same pages give the same bytes.
PDF_METADATA = {"Creator": None, "Producer": None, "CreationDate": None}


@contextmanager
def missing_glyphs_allowed() -> Iterator[None]:
    """Inside, a letter that the font lacks is drawn as a box, without a warning."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def front_pages(content: ReportContent) -> Iterator[Figure]:
    """Title, notes, verdict and the tables of parameters, friction and modes, on as many pages as they take."""
    return text_pages(list(_text(content)))


def text_pages(lines: Sequence[str]) -> Iterator[Figure]:
    """Lines of text on as many pages as they take."""
    for start in range(0, len(lines), MAX_LINES):
        figure = Figure(figsize=PAPER)
        text = style.plain("\n".join(lines[start : start + MAX_LINES]))
        figure.text(0.08, 0.95, text, va="top", family="monospace", fontsize=style.NORMAL, linespacing=1.25)
        yield figure


def bound(front: Iterable[Figure], drawn: Iterable[Drawing]) -> bytes:
    """A PDF of the front pages and the figures, each drawn when its turn comes, so that no figure need be kept."""
    from matplotlib.backends.backend_pdf import PdfPages  # brings the subsetting of fonts, for few reports

    file = io.BytesIO()
    with PdfPages(file, metadata=PDF_METADATA) as pdf, missing_glyphs_allowed():
        for page in front:
            pdf.savefig(page)
        for drawing in drawn:
            pdf.savefig(drawing.draw())
    return file.getvalue()


def _text(content: ReportContent) -> Iterator[str]:
    yield from heading(content.title, content.notes)
    yield from wrapped(content.verdict)
    if content.result.message != content.verdict:
        yield from wrapped(content.result.message)
    for words in (content.validation.folded, content.validation.cost, content.validation.replayed):
        yield from wrapped(words) if words else ()
    yield ""
    rows = parameter_rows(content.result, content.truth, content.contents)
    yield from columns([("parameter", "unit", "estimate", "std", "95 % interval", ""), *map(_row, rows)])
    yield from friction_text(content.friction)
    rate_is_known = all(measured.rate_is_known for measured, _ in content.frf)
    modes = [line for row in content.modes for line in _modes(row)]
    if modes:
        yield ""
        unit = style.frequency_unit(rate_is_known)
        yield from columns([("configuration", "mode", unit, "damping", "energy in"), *modes])


def friction_text(friction: FrictionTakenOut | None) -> Iterator[str]:
    """The table of friction that was taken out, and why some was not; nothing where none was looked for."""
    if friction is None:
        return
    yield ""
    taken = [row for row in friction_rows(friction) if row.level is not None]
    if taken:
        table = [("friction taken out at", "unit", "F_c", "std", "95 % interval", "power left")]
        yield from columns([*table, *map(_friction_row, taken)])
    for note in friction.notes:
        if note.code != "friction-taken-out":
            yield from wrapped(str(note), "  ")


def twin_text(found: TwinFindings) -> Iterator[str]:
    """What the parts of the model explain of each log, and how far it is off when it is simulated, in words."""
    for words in (*map(describe_balance, found.balances), *found.run_words):
        yield ""
        yield from wrapped(words)


def _friction_row(row: FrictionRow) -> tuple[str, ...]:
    assert row.level is not None
    assert row.std is not None
    assert row.interval is not None
    places = digits(row.level, row.std)
    interval = " … ".join(interval_of(row.interval, places))
    return row.place, row.unit, number(row.level, places), number(row.std, 2), interval, percent(row.kept_share)


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
    places = digits(row.estimate, row.std)
    interval = " … ".join(interval_of(row.interval, places))
    remark = "; ".join(filter(None, (row.contains, "at its bound" if row.at_bound else "")))
    return row.name, row.unit, number(row.estimate, places), number(row.std, 2), interval, remark


def columns(table: Sequence[Sequence[str]]) -> Iterator[str]:
    """A table, its columns aligned."""
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    last = " " * min(sum(widths[:-1]) + 2 * len(widths[:-1]), MAX_LETTERS // 2)
    for row in table:
        yield from wrapped("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)), last)


def wrapped(text: str, indent: str = "") -> list[str]:
    """Text in lines of a page; indent: of all but the first."""
    return textwrap.wrap(text, MAX_LETTERS, subsequent_indent=indent) or [""]
