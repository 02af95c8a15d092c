"""Numbers in a table: digits, exponents, and values that are not finite."""

import math

import pytest

from elastid.base.display import Display, capitalise, digits, format_interval, number, percent


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (None, "–"), (math.nan, "–"), (math.inf, "∞"), (-math.inf, "-∞"), (-0.5, "-0.5000"),
        (12345678.0, "12350000"), (1.5e8, "1.500e+08"), (1.234e-4, "0.0001234"), (1.234e-5, "1.234e-05"),
    ],
)  # fmt: skip
def test_number_has_four_digits_and_exponent_only_if_needed(value, text):
    """From 1e-4 to 1e8 there is none."""
    assert number(value) == text


def test_a_standard_deviation_leaves_two_to_eight_digits():
    assert [digits(1.0, std) for std in (1.0, 1e-3, 1e-20)] == [2, 5, 8]
    assert digits(0.0, 1.0) == digits(1.0, 0.0) == 4


def test_an_interval_over_twelve_decades_is_unbounded():
    assert format_interval((1.0, 0.9e12)) == ("1.000", "9.000e+11")
    assert format_interval((1.0, 1.1e12)) == ("0", "∞")


def test_long_tables_are_cut_and_sentences_capitalised():
    """Twenty rows, then a row with the number of further rows; a name such as k_1 is not capitalised."""
    assert [Display("", ("n",), [("1",)] * n).text.count("\n") for n in (20, 21, 30)] == [21, 22, 22]
    assert (capitalise("motor k_1"), capitalise("k_1 is")) == ("Motor k_1", "k_1 is")
    assert (percent(2.0), percent(-2.5), percent(math.nan)) == ("200 %", "-2.5 times", "–")
