"""The first screen and the table of numbers in a browser."""

from __future__ import annotations

import pytest


@pytest.fixture
def opened(visit, report_folder):
    """The page of two configurations of a two-axis robot, as wide as a laptop."""
    page = visit(report_folder / "report.html")
    page.set_viewport_size({"width": 1280, "height": 800})
    return page


def test_the_three_questions_stand_above_the_fold(opened):
    assert opened.evaluate("document.querySelector('.columns').getBoundingClientRect().bottom") <= 800
    assert opened.locator(".columns h2").count() == 3
    assert 1 <= opened.locator(".actions li").count() <= 3


def test_numbers_are_sorted_and_filtered(opened):
    def names():
        return list(opened.locator("#numbers-table tbody tr:visible td:first-child b").all_inner_texts())

    opened.locator("#numbers-table th button", has_text="±").click()
    by_width = names()
    assert by_width.index("k_1") < by_width.index("k_2") < by_width.index("d_1")
    opened.locator("#numbers-controls input").fill("k_")
    assert names() == ["k_1", "k_2"]
