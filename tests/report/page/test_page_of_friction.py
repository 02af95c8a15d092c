"""The page of a friction study."""

from __future__ import annotations

import re

import pytest
from plants import friction_study as study

from elastid.report.page.page_of_friction import html_of_friction


@pytest.fixture(scope="module")
def page() -> str:
    return html_of_friction(study.friction_content(), [])


def test_the_table_has_value_interval_and_origin_and_marks_what_misses_the_truth(page: str) -> None:
    rows = re.findall(r"<tr( class=\"marked\")?>(<td>F.*?|<td>f_.*?)</tr>", page)
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for _, row in rows]
    assert cells[0] == [
        "Fc_melbow",
        "a meaning",
        "F_c",
        "9.0000",
        "9.020",
        "0.030",
        "8.960 … 9.080",
        "N*m",
        "10 levels",
    ]
    assert [bool(marked) for marked, _ in rows] == [False, True, False]
    assert "no speed below nu_s / 3" in page
