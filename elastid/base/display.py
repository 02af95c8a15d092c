"""Display of values as text and HTML: tables with titles, answers of commands, and numbers with their digits."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape as escape_html
from itertools import zip_longest
from typing import Any, TypeAlias

from elastid.base.escape import one_line, printable

MAX_ROWS = 20  # a longer table shows its first rows and the number of the others


@dataclass(frozen=True)
class Display:
    """Table of text cells with headings and a title of one sentence."""

    title: str
    headings: tuple[str, ...] = ()
    rows: Sequence[tuple[str, ...]] = ()

    @property
    def text(self) -> str:
        """Title, headings and rows in columns, plain text.

        >>> print(Display("a fit", ("name", "value"), [("k_1", "20"), ("d_1", "3")]).text)
        a fit
          name  value
          k_1   20
          d_1   3
        """
        lines = columns([tuple(map(one_line, row)) for row in (self.headings, *self.rows[:MAX_ROWS])])
        return "\n".join(
            [printable(self.title), *(f"  {line}".rstrip() for line in lines if self.rows), *self._hidden_rows()]
        )

    @property
    def html(self) -> str:
        """Table in HTML with the title as its caption."""
        head = "".join(f"<th>{_html(cell)}</th>" for cell in self.headings)
        body = "".join(f"<tr>{''.join(f'<td>{_html(cell)}</td>' for cell in row)}</tr>" for row in self.rows[:MAX_ROWS])
        caption = f'<caption style="text-align: left">{_html(self.title)}</caption>'
        more_rows = "".join(f"<p>{_html(line.strip())}</p>" for line in self._hidden_rows())
        return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more_rows}"

    def _hidden_rows(self) -> Iterator[str]:
        if len(self.rows) > MAX_ROWS:
            yield f"  ... and {len(self.rows) - MAX_ROWS} more rows"


Questions: TypeAlias = tuple[tuple[str, tuple[str, ...]], ...]  # each question with its sentences


@dataclass(frozen=True)
class Answer:
    """Answer of a command on its page and on the terminal: questions with sentences, and tables.

    notes: printed on the page only, below the tables.  text: to copy.
    """

    title: str
    questions: Questions
    tables: tuple[Display, ...] = ()
    notes: tuple[str, ...] = ()
    text: str = ""

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences of all questions."""
        return tuple(sentence for _, sentences in self.questions for sentence in sentences)


def _html(text: str) -> str:
    return escape_html(printable(text))


def columns(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Format the rows of a table as lines of plain text with left-aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


def as_text(value: Any) -> str:
    """Return `__repr__` of a value with a `display`, for an interactive prompt."""
    return str(value.display.text)


def as_html(value: Any) -> str:
    """Return a value as HTML for a notebook."""
    return str(value.display.html)


def degrees(posture: Sequence[float], sliding: Sequence[bool] = ()) -> str:
    """Format angles of a posture in degrees, positions of sliding joints in m.

    >>> degrees([0.5235987755982988, -3.141592653589793]), degrees([0.25, 0.1], [True, False])
    ('30°, -180°', '0.25 m, 5.73°')
    """
    angles = zip_longest(posture, sliding, fillvalue=False)
    return ", ".join(f"{angle:.4g} m" if slides else f"{57.29577951308232 * angle:.4g}°" for angle, slides in angles)


def number(value: float | None, digits: int = 4) -> str:
    """Format a number with so many significant digits, without an exponent from 1e-4 to 1e8; a dash for None and NaN.

    >>> number(301234.5), number(0.00012345, 2), number(float("nan")), number(3e-9)
    ('301200', '0.00012', '–', '3.000e-09')
    """
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if value == 0:
        return "0"
    decimals = digits - 1 - _exponent(value)
    if not -4 <= _exponent(value) < 8:
        return f"{value:.{digits - 1}e}"
    return f"{round(value, decimals):.{max(decimals, 0)}f}"


def digits(value: float, std: float) -> int:
    """Return the number of significant digits of a value with a std: to the second digit of std, but two to eight.

    >>> digits(301234.5, 1234.0), digits(0.8, 0.1), digits(5.0, 80.0), digits(5.0, float("inf"))
    (4, 2, 2, 4)
    """
    if not (math.isfinite(std) and std > 0 and math.isfinite(value) and value != 0):
        return 4
    return min(max(_exponent(value) - _exponent(std) + 2, 2), 8)


def format_interval(ends: tuple[float, float], digits: int = 4) -> tuple[str, str]:
    """Format both ends of an interval; zero and infinity for an unidentifiable positive number.

    >>> format_interval((0.8, 1.2), 2), format_interval((1e-128, 1e142)), format_interval((-3.0, 2e9), 2)
    (('0.80', '1.2'), ('0', '∞'), ('-3.0', '2.0e+09'))
    """
    low, high = ends
    if low > 0 and high > 1e12 * low:
        return "0", "∞"
    return number(low, digits), number(high, digits)


def percent(value: float | None, digits: int = 2) -> str:
    """Format a fraction in percent, above 200 % as a factor.

    >>> percent(0.9312, 3), percent(4.03), percent(None)
    ('93.1 %', '4.0 times', '–')
    """
    if value is None or math.isnan(value):
        return "–"
    return f"{number(value, digits)} times" if abs(value) > 2 else f"{number(100 * value, digits)} %"


def relative_std(value: float, std: float) -> str:
    """Format a standard deviation in percent of the value; without a relative value as it is."""
    relative = 100 * std / abs(value) if value else math.inf
    return f"{number(relative, 2)} %" if math.isfinite(relative) else number(std, 2)


def capitalise(text: str) -> str:
    """Capitalise the first letter of a sentence that does not begin with a name such as k_1."""
    return text if "_" in text.partition(" ")[0] else text[:1].upper() + text[1:]


def _exponent(value: float) -> int:
    return math.floor(math.log10(abs(value)))
