"""The content of a report: its notes in order and each once; rows and questions of friction."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.friction_study import friction_content
from plants.report_values import fit_result, pair, report_content

from elastid.base.errors import Note
from elastid.friction_study.result import FrictionResult
from elastid.nonlinear.gear_result import ARCMIN, ARCSEC, GearNumber, GearResult, GearSheet
from elastid.report.gear_table import gear_table
from elastid.report.page.page import html
from elastid.report.parameter_row import parameter_rows
from elastid.validation.log_comparison import TORQUE, ComparedSignal, LogComparison, LogSimulation

LOGS = tuple(Note("late-log", f"{20 + i} samples late", f"log {i}") for i in range(108))
REMARK = Note("fit/profile", "k_1 has an interval by profile", severity="information")


def test_the_page_shows_it_in_one_line_with_a_count():
    """The same note of 108 logs in two responses; warnings are counted apart from remarks, in the content's order."""
    responses = tuple((replace(pair(1, name=name)[0], notes=LOGS), pair(1)[1]) for name in "ab")
    result = fit_result()
    content = report_content(frf=responses, result=replace(result, notes=(*result.notes, REMARK)))
    page = html(content, [])
    line = "log 0 and 107 more: 20 samples late"
    assert page.count(line) == page.count("samples late") == 1
    assert page.index(str(content.notes[0])) < page.index(REMARK.text) < page.index(line)
    assert "<strong>2 warnings, 1 remark</strong>" in page
    assert f'<li class="information">{REMARK}</li>' in page


def test_rows_give_error_in_standard_deviations():
    """In the solver's variable: ln p for a logarithmic parameter, p for a linear one; none without a truth."""
    rows = parameter_rows(fit_result(), {"k_1": 3e5, "x_c": -0.02})
    assert rows[0].deviation == pytest.approx(math.log(3.02 / 3) / 0.01)
    assert rows[1].deviation is None
    assert rows[3].deviation == pytest.approx(0.005 / 0.004)


def sheets() -> GearResult:
    """A gear with a stiffness, an error, and a hysteresis that was not seen."""
    numbers = (
        GearNumber("k_1", "stiffness at zero torque", "stiffness", "N*m/rad", 2e5, 200.0, linear=2.1e5),
        GearNumber("e1_1", "transmission error, once a motor turn", "error", "rad", 2e-5, 1e-6, order=1.0, phase=0.5),
        GearNumber("H_1", "hysteresis, torque to either side", "torque", "N*m", bound=0.3, rated_fraction=0.001),
        GearNumber("Fc_m1", "running torque before the gear", "torque", "N*m", 0.1, 0.1, rated_fraction=0.0003),
    )
    torque = 300 * np.concatenate([np.linspace(-1, 1, 100), np.linspace(1, -1, 100)])
    sheet = GearSheet("1", numbers, 300.0, torque, torque / 2e5, np.full(200, 1e-7))
    return GearResult(np.zeros(0), np.zeros((0, 0)), sheets=(sheet,), before=0.1, after=0.01)


def test_numbers_are_in_makers_units_with_intervals_or_bounds() -> None:
    """Nm/arcmin, arcsec with the phase in degrees, and < before what was not seen; no torque below 0."""
    _, stiffness, error, unseen, friction = gear_table(sheets())
    assert stiffness[2] == "N*m/arcmin"
    assert float(stiffness[3]) == pytest.approx(2e5 / ARCMIN, rel=1e-3)
    assert float(stiffness[-1]) == pytest.approx(2.1e5 / ARCMIN, rel=1e-3)
    assert error[1].endswith(" 29 deg")
    assert error[2] == "arcsec"
    assert float(error[3]) == pytest.approx(2e-5 * ARCSEC, abs=0.05)
    assert unseen[3:6] == ["< 0.30", "–", "not significant"]
    assert unseen[6] == "0.10 %"
    assert float(friction[5].split(" to ")[0]) == 0.0


def test_numbers_are_good_where_the_least_known_of_them_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coulomb friction to 5 % is; to 28 %, as where logs of several temperatures are taken for one, it is named."""
    content = friction_content()
    number = next(each for each in content.result.numbers if each.symbol == "F_c")
    said = []
    for width in (0.05, 0.28):
        ends = {"low": number.value * (1 - width), "high": number.value * (1 + width)}
        monkeypatch.setattr(FrictionResult, "numbers", (replace(number, **ends),))
        said.append(replace(content, result=replace(content.result, status="identified")).questions[0][1][0])
    assert [said[0], number.name in said[1], "±28 %" in said[1]] == ["Yes.", True, True]


@pytest.mark.parametrize("error", [0.02, 0.15])
def test_numbers_are_good_as_far_as_simulation_follows(error: float) -> None:
    """One whose torque is 15 % off, or that is lost, is said in the first sentence."""
    t = np.arange(500) / 100
    torque = np.sin(2 * np.pi * t)
    signal = ComparedSignal(TORQUE, "motor 1", "N*m", torque, torque + error * np.cos(2 * np.pi * t))
    run = LogSimulation("log a", "torque", 0.5, 5.0, 100.0, (signal,))
    content = replace(friction_content(), log_comparison=LogComparison((), (run,)))
    said = content.questions[0][1][0]
    assert ("15 %" in said and "motor 1" in said) == (error > 0.1)
    lost = replace(content, log_comparison=LogComparison((), (replace(run, signals=(), lost="it falls"),)))
    assert lost.questions[0][1][0].startswith("Yes, but")
