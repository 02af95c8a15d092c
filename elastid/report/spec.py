"""The `report` section of a study."""

from __future__ import annotations

from typing import Annotated, Literal

from elastid.base.section import Key, section


@section
class ReportSpec:
    """The figures of the report."""

    # fmt: off
    formats: Annotated[tuple[Literal["png", "pdf"], ...], Key("Formats of the figures' files, in addition to the page, "
        "which draws its own; pdf comes with report.pdf: tables and all figures on paper.", "where every run is to "
        "leave figures for documents, which takes longer; `elastid report --png` or `--pdf` draws them for once.")] = ()
    # fmt: on
