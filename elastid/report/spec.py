"""The `report` section of a study."""

from __future__ import annotations

from typing import Annotated, Literal

from elastid.base.section import Key, section


@section
class ReportSpec:
    """The figures of the report."""

    # fmt: off
    formats: Annotated[tuple[Literal["png", "pdf"], ...], Key("Formats of the figures' files, in addition to the page; "
        "pdf comes with report.pdf: tables and all figures on paper (`elastid report --pdf` for once).", "add pdf for "
        "print and for LaTeX; it takes longer, and page and PNG are enough on a screen.")] = ("png",)
    # fmt: on
