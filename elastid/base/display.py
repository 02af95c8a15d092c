"""Display: what a notebook or a prompt shows of a value: a title and a short table, as text and as HTML."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape as escape_html
from typing import Protocol

from elastid.base.escape import one_line, printable

# Rows of a table that are shown; of more, so many and a count of the rest.
MAX_ROWS = 20


@dataclass(frozen=True)
class Display:
    """A title of one sentence, and rows of cells below their headings."""

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
        table = [tuple(map(one_line, row)) for row in (self.headings, *self.rows[:MAX_ROWS])]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in table)
        return "\n".join([printable(self.title), *(f"  {line}".rstrip() for line in lines if self.rows), *self._rest()])

    @property
    def html(self) -> str:
        """The same as a table of HTML with the title as its caption."""
        head = "".join(f"<th>{_html(cell)}</th>" for cell in self.headings)
        body = "".join(f"<tr>{''.join(f'<td>{_html(cell)}</td>' for cell in row)}</tr>" for row in self.rows[:MAX_ROWS])
        caption = f'<caption style="text-align: left">{_html(self.title)}</caption>'
        rest = "".join(f"<p>{_html(line.strip())}</p>" for line in self._rest())
        return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{rest}"

    def _rest(self) -> Iterator[str]:
        if len(self.rows) > MAX_ROWS:
            yield f"  ... and {len(self.rows) - MAX_ROWS} more rows"


def _html(text: str) -> str:
    return escape_html(printable(text))


class Displayed(Protocol):
    """A value that a notebook shows by its title and table."""

    @property
    def display(self) -> Display:
        """Title and table."""


def as_text(value: Displayed) -> str:
    """`__repr__` of a value: what a prompt shows."""
    return value.display.text


def as_html(value: Displayed) -> str:
    """`_repr_html_` of a value: what a notebook shows."""
    return value.display.html


def degrees(radians: Sequence[float]) -> str:
    """Angles of a posture in degrees.

    >>> degrees([0.5235987755982988, -3.141592653589793])
    '30°, -180°'
    """
    return ", ".join(f"{57.29577951308232 * angle:.4g}°" for angle in radians)
