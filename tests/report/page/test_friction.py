"""The section Friction, on the page of an identification and on that of responses alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import pytest
from plants.report_values import pair, report_content
from plants.taken_friction import LEFT, taken_friction

from elastid.base.errors import Note
from elastid.modal.modes import without_modes
from elastid.nonlinear.result import FrictionTakenOut
from elastid.report.content import ResponsesContent
from elastid.report.figures.drawings import drawings
from elastid.report.page.page import html, html_of_responses


def page(friction: FrictionTakenOut | None) -> str:
    return html(report_content(friction=friction), [])


def page_of_responses(friction: FrictionTakenOut | None) -> str:
    modes = (without_modes(pair(2)[0], Note("modal/lines", "none")),)
    return html_of_responses(ResponsesContent("a", (pair(2)[0],), modes, "", {}, friction), [])


@pytest.mark.parametrize("written", [page, page_of_responses])
def test_the_section_has_the_numbers_of_the_file(written: Callable[[FrictionTakenOut | None], str]) -> None:
    """Level and interval, power left, torque before and after; why friction was left stands there once."""
    text = written(taken_friction())
    section = text[text.index('<h2 id="friction">') :]
    section = section[: section.index("<h2", 10)]
    cells = re.findall(r"<td[^>]*>(.*?)</td>", section)
    assert cells[:7] == ["motor 1", "4.50", "0.22", "4.06 … 4.94", "N*m", "3.2 %", "taken out"]
    assert cells[7:14] == ["motor 2", "–", "–", "–", "N", "98 %", "not taken out"]
    assert cells[14:19] == ["c1", "0.410", "0.110", "0.620", "0.620"]
    assert text.count(LEFT) == 1
    assert "friction was taken out<" not in text
    assert '<a href="#friction">' in text


def test_where_nothing_could_be_found_the_reason_stands_alone() -> None:
    """Neither tables nor a figure of nothing."""
    friction = taken_friction()
    refused = replace(
        friction, shapes=(), levels=friction.levels[:0], covariance=friction.covariance[:0, :0], configurations=(),
        before=friction.before[:0], after=friction.after[:0], highest_hz=friction.highest_hz[:0],
        notes=friction.notes[1:],
    )  # fmt: skip
    text = page(refused)
    assert text.count(LEFT) == 1
    assert "F_c" not in text
    assert "friction" not in {drawing.name for drawing in drawings(report_content(friction=refused))}
    assert "friction" in {drawing.name for drawing in drawings(report_content(friction=friction))}
