"""Numbers as people read them in a table."""

from __future__ import annotations

import math

# Ratio of the ends of an interval that is written as 0 to infinity.
MAX_INTERVAL_RATIO = 1e12


def number(value: float | None, digits: int = 4) -> str:
    """So many significant digits, without an exponent from 1e-4 to 1e8; a dash for None and NaN.

    >>> number(301234.5), number(0.00012345, 2), number(float("nan")), number(3e-9)
    ('301200', '0.00012', '–', '3.000e-09')
    """
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if value == 0:
        return "0"
    place = digits - 1 - _exponent(value)
    if not -4 <= _exponent(value) < 8:
        return f"{value:.{digits - 1}e}"
    return f"{round(value, place):.{max(place, 0)}f}"


def digits(value: float, std: float) -> int:
    """Significant digits of a value with a standard deviation: down to the second digit of std, but two to eight.

    >>> digits(301234.5, 1234.0), digits(0.8, 0.1), digits(5.0, 80.0), digits(5.0, float("inf"))
    (4, 2, 2, 4)
    """
    if not (math.isfinite(std) and std > 0 and math.isfinite(value) and value != 0):
        return 4
    return min(max(_exponent(value) - _exponent(std) + 2, 2), 8)


def interval_of(ends: tuple[float, float], digits: int = 4) -> tuple[str, str]:
    """Both ends of an interval; zero and infinity for a positive number that the data do not constrain.

    >>> interval_of((0.8, 1.2), 2), interval_of((1e-128, 1e142)), interval_of((-3.0, 2e9), 2)
    (('0.80', '1.2'), ('0', '∞'), ('-3.0', '2.0e+09'))
    """
    low, high = ends
    if low > 0 and high > MAX_INTERVAL_RATIO * low:
        return "0", "∞"
    return number(low, digits), number(high, digits)


def percent(value: float | None, digits: int = 2) -> str:
    """A share in percent.

    >>> percent(0.9312, 3)
    '93.1 %'
    """
    return "–" if value is None or math.isnan(value) else f"{number(100 * value, digits)} %"


def _exponent(value: float) -> int:
    return math.floor(math.log10(abs(value)))
