"""The front pages of the booklet."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import partial

import pytest
from matplotlib.figure import Figure
from plants.arm_modes import mode_row
from plants.report_values import report_content

from elastid.report.figures.drawings import Drawing
from elastid.report.page.booklet import bound, front_pages, paged


def test_the_front_pages_hold_the_mode_table() -> None:
    """No line is longer than the paper is wide."""
    long = replace(mode_row(), stores=("gear of the very first axis of the robot", "shaft of the motor of that axis"))
    pages = [page.texts[0].get_text() for page in front_pages(report_content(modes=(long,)))]
    assert "92 % gear of the very first axis" in " ".join(" ".join(pages).split())
    assert max(len(line) for page in pages for line in page.splitlines()) <= 96


def test_a_table_is_whole_or_has_its_head_again() -> None:
    """What fits on a page is on one; a longer table goes on under its head."""
    short, long = [f"a{i}" for i in range(6)], [f"b{i}" for i in range(23)]
    assert paged([*short, "", *short], 10) == [short, short]
    assert paged([*short, "", *short], 13) == [[*short, "", *short]]
    pages = paged([*short, "", *long], 10)
    assert pages[0] == short
    assert all(len(page) <= 10 and page[0] == "b0" for page in pages[1:])
    assert [line for page in pages[1:] for line in page if line != "b0"] == long[1:]


def test_the_booklet_has_a_title_numbers_and_metadata() -> None:
    """All sheets are A4 or larger in its proportion, upright or lying."""
    content = report_content()
    drawn = [Drawing(f"{size}", "fit", "", partial(Figure, figsize=size)) for size in ((9.5, 5.0), (4.0, 3.0), (9, 30))]
    paper = bound("A study", front_pages(content), drawn)
    sizes = re.findall(rb"/MediaBox \[ ?0 0 ([0-9.]+) ([0-9.]+) ?\]", paper)
    assert len(sizes) == len(list(front_pages(content))) + len(drawn)
    for wide, high in sizes:
        low, long = sorted((float(wide), float(high)))
        assert low >= 594
        assert long / low == pytest.approx(math.sqrt(2), rel=1e-3)
    assert b"/Title (A study)" in paper
    title = next(iter(front_pages(content)))
    assert title.texts[0].get_text() == "A study"
    assert "17" in title.texts[2].get_text()
