"""Docstrings of the code as reStructuredText: equations and doctests stay, all other words are text and not markup."""

import re
from collections.abc import Iterable, Sequence
from textwrap import dedent, indent

_KEY = re.compile(r"(?:^|  )(?=(?:[a-z]\w*, )*[A-Za-z_]\w*(?: \([^()]*\))?: )")
_CODE = re.compile(r"``?([^`]+?)``?")
_MARKUP = re.compile(r"([\\*_|])")
_ROLE = re.compile(r":math:`[^`]*`")


def escape(text: str) -> str:
    """Return text in which only `code` and :math: mean something.

    >>> escape("`k_*` and d_1*")
    '``k_*`` and d\\\\_1\\\\*'
    """
    pieces, end = [], 0
    for match in re.finditer(rf"{_ROLE.pattern}|{_CODE.pattern}", text):
        pieces.append(_MARKUP.sub(r"\\\1", text[end : match.start()]).replace("`", r"\`"))
        glued = r"\ " if text[match.end() : match.end() + 1].isalnum() else ""
        gap = r"\ " if text[match.start() - 1 : match.start()].isalnum() else ""
        pieces.append(gap + (match[0] if match[0].startswith(":math:") else f"``{match[1].strip()}``") + glued)
        end = match.end()
    return "".join(pieces) + _MARKUP.sub(r"\\\1", text[end:]).replace("`", r"\`")


def list_table(rows: Iterable[Sequence[object]], option: str = ":header-rows: 1") -> str:
    """Return a table of rows of cells as reStructuredText.

    >>> print(list_table([("name", "unit"), ("k_1", "N m/rad")]))
    .. list-table::
       :header-rows: 1
    <BLANKLINE>
       * - name
         - unit
       * - k_1
         - N m/rad
    <BLANKLINE>
    """
    cells = ["   * - " + "\n     - ".join(map(str, row)) + "\n" for row in rows]
    return f".. list-table::\n   {option}\n\n{''.join(cells)}"


def to_rst(doc: str) -> str:
    """Return a docstring as reStructuredText.

    Paragraphs that begin with `.. math::` or `>>>` are kept; indented ones are shown as they are; bullets are lists;
    `name: text` at the start of a line, or two spaces behind a sentence, becomes a line of its own.
    """
    return "\n\n".join(_paragraph(each) for each in re.split(r"\n\s*\n", doc.strip("\n")) if each.strip()) + "\n"


def _paragraph(text: str) -> str:
    if text.lstrip().startswith((".. math::", ">>>")):
        return dedent(text)
    if text.startswith((" ", "\t")):
        return "::\n\n" + indent(dedent(text), "    ")
    if text.startswith("- "):
        return "\n".join("- " + escape(" ".join(item.split())) for item in re.split(r"\n?^- ", text, flags=re.M)[1:])
    head, equation, tail = text.partition("\n.. math::")
    if equation:
        return f"{_paragraph(head)}\n\n{equation.strip()}{tail}"
    return "\n\n".join(_line(each) for line in _join(text) for each in _KEY.split(line) if each.strip())


def _join(text: str) -> list[str]:
    """Join the lines of a paragraph, but for those that begin with `name: `."""
    lines: list[str] = []
    for line in text.splitlines():
        if lines and not re.match(r"(?:[A-Za-z]\w*, )*[A-Za-z_]\w*(?: \([^()]*\))?: ", line):
            lines[-1] += " " + line.strip() if not line.startswith("  ") else line
        else:
            lines.append(line)
    return lines


def _line(text: str) -> str:
    match = re.match(r"((?:[A-Za-z]\w*, )*[A-Za-z_]\w*(?: \([^()]*\))?): (.*)", text, re.DOTALL)
    return f"- **{escape(match[1])}**: {escape(match[2].strip())}" if match else escape(" ".join(text.split()))
