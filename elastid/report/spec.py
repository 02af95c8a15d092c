"""The `report` section of a study."""

from __future__ import annotations

from typing import Literal

from elastid.base.section import section


@section
class ReportSpec:
    """The figures of the report.

    formats: of the files beside the page; pdf comes with report.pdf: tables and all figures on paper (`elastid report
    --pdf` for once). -- add pdf for print and for LaTeX; it takes longer, and page and PNG are enough on a screen.
    """

    formats: tuple[Literal["png", "pdf"], ...] = ("png",)
