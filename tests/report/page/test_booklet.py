"""The front pages of the booklet."""

from __future__ import annotations

from dataclasses import replace

from plants.arm_modes import mode_row
from plants.report_values import report_content

from elastid.report.page.booklet import front_pages


def test_the_front_pages_hold_the_mode_table() -> None:
    """No line is longer than the paper is wide."""
    long = replace(mode_row(), stores=("gear of the very first axis of the robot", "shaft of the motor of that axis"))
    pages = [page.texts[0].get_text() for page in front_pages(report_content(modes=(long,)))]
    assert "92 % gear of the very first axis" in " ".join(" ".join(pages).split())
    assert max(len(line) for page in pages for line in page.splitlines()) <= 96
