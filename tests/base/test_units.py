"""A study's numbers are SI or carry a unit of a closed table."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from elastid.base.units import TABLE, dimension_and_size, table_unit, to_si, units_of


@given(st.sampled_from(sorted(TABLE)), st.floats(-1e6, 1e6))
def test_a_text_with_a_unit_equals_number_times_factor(unit: str, number: float) -> None:
    """'<number> <unit>' reads as number * factor in SI for every unit of the table."""
    dimension, scale = TABLE[unit]
    assert to_si(f"{number!r} {unit}", dimension) == pytest.approx(number * scale, rel=1e-12, abs=1e-300)
    assert to_si(repr(number), dimension) == number


@pytest.mark.parametrize(
    ("value", "dimension", "says"),
    [
        ("3 kg", "N*m", "measures kg, not N*m"),
        ("3 furlong", "m", "units that fit here: m, mm"),
        ("three m", "m", "is not a number with a unit"),
        (True, "m", "expected a number"),
        (math.nan, "m", "finite"),
        ("1e999 m", "m", "finite"),
        ([1], "m", "expected a number"),
    ],
)
def test_text_without_quantity_is_refused_with_valid_units(value: object, dimension: str, says: str) -> None:
    """A wrong dimension, an unknown unit, a text, NaN: each message says what is expected."""
    with pytest.raises(ValueError, match=says.replace("*", r"\*")):
        to_si(value, dimension)


@pytest.mark.parametrize(
    ("spelt", "usual"),
    [
        ("Nm", "N*m"), ("kNm/rad", "kN*m/rad"), ("Nms/rad", "N*m*s/rad"), ("kg m²", "kg*m^2"),
        ("kgm2", "kg*m^2"), ("°", "deg"), ("°/s", "deg/s"), ("1/min", "rpm"), ("m/s²", "m/s^2"), ("rad/s2", "rad/s^2"),
        ("N·m", "N*m"), ("°C", "degC"), ("Nm/°", "N*m/deg"),
    ],
)  # fmt: skip
def test_units_are_read_as_logs_and_data_sheets_spell_them(spelt: str, usual: str) -> None:
    """With the factor of the usual spelling, the one that messages list."""
    assert dimension_and_size(spelt) == TABLE[usual]
    assert table_unit(spelt) == usual
    assert spelt not in units_of(TABLE[usual][0])
