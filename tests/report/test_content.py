"""The content of a report: its notes in order and each once."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from plants.report_values import fit_result, pair, report_content

from elastid.base.note import Note
from elastid.parameters import Parameter, ParameterSet
from elastid.report.content import parameter_rows
from elastid.report.page.booklet import front_pages
from elastid.report.page.page import html

LOGS = tuple(Note("late-log", f"{20 + i} samples late", f"log {i}") for i in range(108))
REMARK = Note("profiled-interval", "k_1 has an interval by profile", severity="information")


def many_notes():
    """The same note of 108 logs in two responses, and two notes of the fit."""
    first, second = ((replace(pair(1, name=n)[0], notes=notes), pair(1)[1]) for n, notes in (("a", LOGS), ("b", LOGS)))
    result = fit_result()
    return report_content(frf=(first, second), result=replace(result, notes=(*result.notes, REMARK)))


def test_findings_of_the_fit_come_first_and_the_same_note_of_108_logs_is_one():
    """Whatever its numbers, and although two responses have it."""
    content = many_notes()
    assert [group.first.code for group in content.notes] == [
        *(note.code for note in content.result.notes),
        "late-log",
    ]
    assert len(content.notes[-1].places) == 108


def test_page_and_booklet_show_it_in_one_line_with_a_count():
    """Warnings are counted apart from remarks; both keep the order of the content."""
    content = many_notes()
    page, paper = html(content, []), "\n".join(figure.texts[0].get_text() for figure in front_pages(content))
    line = "log 0 and 107 more: 20 samples late"
    for text in (page, paper):
        assert text.count(line) == text.count("samples late") == 1
        assert text.index(str(content.notes[0])) < text.index(REMARK.text) < text.index(line)
    assert "<strong>2 warnings, 1 remark</strong>" in page
    assert f'<li class="information">{REMARK}</li>' in page
    assert f"! {line}" in paper
    assert f"- {REMARK}" in paper


def test_remarks_alone_are_no_warning():
    """The box keeps its quiet colour."""
    frf = tuple((replace(measured, notes=(REMARK,)), modelled) for measured, modelled in report_content().frf)
    page = html(report_content(frf=frf, result=replace(fit_result(), notes=())), [])
    assert "<strong>1 remark</strong>" in page
    assert 'class="notes"' in page
    assert 'class="notes warnings"' in html(report_content(), [])


def test_repairs_are_those_of_the_configurations_that_have_any():
    (one, model), (two, other) = report_content().frf
    content = report_content(frf=((replace(one, repairs={"spikes replaced": 3}), model), (two, other)))
    assert content.repairs == {"c1": {"spikes replaced": 3}}


def test_rows_say_how_many_standard_deviations_the_estimate_is_from_the_truth():
    """In the solver's variable: ln p for a logarithmic parameter, p for a linear one; none without a truth."""
    rows = parameter_rows(fit_result(), {"k_1": 3e5, "x_c": -0.02})
    assert rows[0].deviation == pytest.approx(math.log(3.02 / 3) / 0.01)
    assert rows[1].deviation is None
    assert rows[3].deviation == pytest.approx(0.005 / 0.004)


def test_a_parameter_of_one_configuration_has_the_truth_of_the_one_it_stands_for():
    """Unless it has a truth of its own."""
    warm = Parameter("k_1@warm", 2e5, log=True, only=("warm",))
    parameters = ParameterSet((Parameter("k_1", 2e5, free=False), warm))
    result = fit_result(parameters)
    assert parameter_rows(result, {"k_1": 3e5})[0].truth == 3e5
    assert parameter_rows(result, {"k_1": 3e5, "k_1@warm": 2e5})[0].truth == 2e5
