"""Units that a heading states, with their prefixes; texts in their place that are no unit."""

import itertools

import pytest

from elastid.base.units import TABLE
from elastid.logs.channel_names import guess_by_name
from elastid.logs.headings import unit_of_heading

# Unit as headings have it, and its size in SI.
SIZES = {
    "mNm": 1e-3, "kNm": 1e3, "daNm": 10.0, "Ncm": 1e-2, "N·m": 1.0, "Nm": 1.0, "N m": 1.0, "kN": 1e3, "daN": 10.0,
    "mA": 1e-3, "A": 1.0, "mV": 1e-3, "mrad": 1e-3, "mdeg": 0.017453292519943295e-3, "deg": 0.017453292519943295,
    "°": 0.017453292519943295, "rev": 6.283185307179586, "U/min": 0.10471975511965977, "rpm": 0.10471975511965977,
    "rad/s": 1.0, "deg/s": 0.017453292519943295, "mm/s": 1e-3, "m/s²": 1.0, "µm": 1e-6, "mm": 1e-3, "m": 1.0,
}  # fmt: skip
WORDS = [unit for unit in SIZES if unit.isascii() and unit not in ("A", "kN", "daN", "m", "rev", "N m", "U/min")]


@pytest.mark.parametrize(("unit", "form"), list(itertools.product(SIZES, ("x[{}]", "x 1 ({})", "actualX [{}] "))))
def test_a_unit_in_brackets_has_its_size(unit: str, form: str) -> None:
    assert TABLE[unit_of_heading(form.format(unit)).unit][1] == pytest.approx(SIZES[unit])


@pytest.mark.parametrize("unit", WORDS)
def test_a_unit_as_a_word_has_its_size(unit: str) -> None:
    word = unit.replace("/", "_")
    for name in (f"joint_{word}", f"signal_{word}_3"):
        assert TABLE[unit_of_heading(name).unit][1] == pytest.approx(SIZES[unit])


def test_a_known_unit_in_brackets_is_preferred_to_another_statement() -> None:
    assert [unit_of_heading("pos_1 [mm]", stated).unit for stated in ("deg", "xyz", "", "mm")] == ["mm"] * 4
    assert [unit_of_heading(f"pos_1 [{unit}]", "deg").unit for unit in ("xyz", "-")] == ["deg"] * 2


def test_a_unit_in_a_name_is_no_joint() -> None:
    assert {guess_by_name(name, None).joint_label for name in ("position_base_inc", "cmd_base_inc")} == {"base"}


@pytest.mark.parametrize("unit", ["inc", "counts", "ticks", "%", "0.1% rated torque", "Arms", "LSB", "xyz"])
def test_unknown_text_in_brackets_is_unknown_unit(unit: str) -> None:
    heading = unit_of_heading(f"Torque actual value [{unit}]")
    assert (heading.unit, heading.unknown) == ("", unit)
    guess = guess_by_name(f"Torque actual value [{unit}]", None)
    assert (guess.quantity, guess.unit) == ("torque", "")


@pytest.mark.parametrize("name", ["tau(1)", "q [2]", "pos (motor 1)", "torque", "omega"])
def test_headings_without_a_unit_have_none(name: str) -> None:
    assert unit_of_heading(name).unit == unit_of_heading(name).unknown == ""


@pytest.mark.parametrize(
    ("column", "is_question"), [("rad", True), ("deg", False), ("°", False), ("xyz", False), ("", False)]
)
def test_a_unit_row_that_contradicts_the_heading_is_a_question(column: str, is_question: bool) -> None:
    guess = guess_by_name("position [deg]", None, column)
    assert (guess.unit, guess.why.startswith("?")) == ("deg", is_question)
