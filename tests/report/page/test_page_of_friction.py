"""The page of a friction study."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from plants import friction_study as study

from elastid.report.page.page_of_friction import friction_explorer, html_of_friction


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


def test_the_explorer_has_the_levels_and_the_law_of_both_directions() -> None:
    shown = friction_explorer(study.friction_result().joints)
    assert shown is not None
    (curve,) = json.loads(shown)["responses"]
    law = study.law()
    for key, sign in (("_ahead", 1.0), ("_back", -1.0)):
        own = law.levels.direction == sign
        points = {v: y for v, y in zip(curve["freq"], curve["curves"][f"level{key}"], strict=True) if y is not None}
        assert list(points) == pytest.approx(sorted(law.levels.speed[own]), rel=1e-4)
        assert list(points.values()) == pytest.approx(law.levels.torque[own].tolist(), rel=1e-4)
        low, line, high = (curve["curves"][f"{what}{key}"] for what in ("low", "law", "high"))
        assert all(a < b < c for a, b, c in zip(low, line, high, strict=True))
    assert (curve["unit"], curve["x_unit"]) == ("N·m", "rad/s")


def test_the_browser_reads_a_level_under_the_pointer(visit: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(html_of_friction(study.friction_content(), []), "utf-8")
    shown = visit(path)
    over = shown.locator("#explorer .u-over").first
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    shown.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    text = shown.locator("#explorer output").inner_text()
    assert re.match(r"speed → torque, [\d.]+ rad/s: level, positive direction", text)
    assert text.endswith("N·m")
    assert shown.locator("#explorer label:visible").count() == 0  # one curve of one kind: nothing to choose
