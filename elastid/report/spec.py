"""The `report` section of a study."""

from __future__ import annotations

from typing import Literal

from elastid.base.section import section


@section
class ReportSpec:
    """The figures of the report.

    formats: of the files beside the page; pdf, for print, takes longer, and comes with report.pdf: tables and all
    figures on paper (`elastid report --pdf` for once).
    """

    formats: tuple[Literal["png", "pdf"], ...] = ("png",)
