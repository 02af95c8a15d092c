"""The page of a friction study: the answer first, the table of numbers, then the figures of each joint."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from elastid.base.execution import Execution
from elastid.base.numbers import number
from elastid.friction_study.result import JointFriction
from elastid.report.figures.friction_drawings import JOINT, friction_study_drawings
from elastid.report.figures.style import own_style
from elastid.report.friction_content import FrictionContent, refusals
from elastid.report.friction_rows import NUMBER_HEADINGS, number_cells
from elastid.report.page.booklet import columns, heading, text_pages, title_page, twin_text, wrapped
from elastid.report.page.embedding import script_policy
from elastid.report.page.friction_explorer import friction_explorer
from elastid.report.page.page import EmbeddedFigure, FigureFormat, template, write_figures, write_whole

# Numbers that all passes of a joint share, as people call them.
SHARED = {
    "inertia": "inertia",
    "slope": "slope of friction within a pass",
    "gravity.cos": "gravity, part of cos q",
    "gravity.sin": "gravity, part of sin q",
    "offset": "offset of the torque",
}


@own_style()
def write_page_of_friction(
    content: FrictionContent, folder: Path, formats: Collection[FigureFormat], execution: Execution | None = None
) -> Path:
    """folder/report.html and folder/figures/* anew, with pdf among the formats folder/report.pdf; the page's path."""
    front = [title_page(content.title, content.answers, content.provenance), *text_pages(list(_text(content)))]
    drawings = friction_study_drawings(content.result, content.filters, content.twin)
    figures = write_figures(content.title, drawings, front, folder, formats, execution)
    page = folder / "report.html"
    write_whole(page, html_of_friction(content, figures).encode("utf-8"))
    return page


def html_of_friction(content: FrictionContent, figures: Collection[EmbeddedFigure]) -> str:
    """The page; every text from a study or a file is escaped."""
    shown = friction_explorer(content.result.joints)
    scripts = shown.scripts if shown else ()
    return template("friction.html.j2").render(
        content=content,
        result=content.result,
        headings=NUMBER_HEADINGS,
        rows=[(each, number_cells(each)) for each in content.result.numbers],
        shared=shared_numbers,
        refusals=refusals(content.result),
        section=JOINT,
        figures=figures,
        explorer=shown,
        scripts=scripts,
        policy=script_policy(scripts),
    )


def shared_numbers(joint: JointFriction) -> tuple[tuple[str, str, str, str], ...]:
    """What all passes of a joint share, beside friction: name, value, std and unit."""
    if joint.levels is None:
        return ()
    torque = "N" if joint.slides else "N*m"
    units = {"inertia": "kg" if joint.slides else "kg*m^2", "slope": "N*s/m" if joint.slides else "N*m*s/rad"}
    return tuple(
        (SHARED[kind] + (f" ({load})" if load else ""), number(value), number(std, 2), units.get(name, torque))
        for name, (value, std) in joint.levels.shared.items()
        for kind, load in (_of_load(name),)
        if kind in SHARED
    )


def _of_load(name: str) -> tuple[str, str]:
    """gravity.cos.full -> gravity.cos, full."""
    kind = ".".join(name.split(".")[:2])
    return kind, name[len(kind) + 1 :]


def _text(content: FrictionContent) -> Iterator[str]:
    """The page without its figures, on paper."""
    yield from heading(content.title, content.notes)
    for sentence in content.answers:
        yield from wrapped(sentence)
    yield ""
    if content.result.numbers:
        yield from columns([NUMBER_HEADINGS, *map(number_cells, content.result.numbers)])
    yield from twin_text(content.twin)
    for refusal in refusals(content.result):
        yield from wrapped(f"- joint {', '.join(refusal.joints)}, no {refusal.part}: {refusal.reason}", "  ")
