"""Cells of a text log: lines divided at delimiters, and cells as numbers, times and missing values."""

import csv
import re
from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.experiment.specs.logs import TextFormatSpec

# Groups of three digits, and the signs that separate them: 1.512,5 and 1'512,5 with a decimal comma; 1'512.5 and,
# between other delimiters, 1,512.5.
_FIRST = r"([-+]?[1-9]\d{0,2})"
_DECIMAL_COMMA = ".'’", re.compile(rf"(?<![\w.,'’]){_FIRST}((?:[.'’]\d{{3}})+)(?![\d.'’])")
_APOSTROPHES = "'’", re.compile(rf"(?<![\w.'’]){_FIRST}((?:['’]\d{{3}})+)(?![\d'’])")
_COMMAS = ",", re.compile(rf"(?<![\w.,]){_FIRST}((?:,\d{{3}})+)(?=\.\d)")
# Error values of spreadsheets: #N/A, #NV, #VALUE!, #DIV/0!.
_ERRORS_OF_CELLS = re.compile(r"#(?:N/?[AV]|[A-Z]+[!?]|DIV/0!)")


def plain_numbers(content: str, text: TextFormatSpec) -> str:
    """Return a text with decimal points, nan for error values of cells, and without separators of thousands.

    >>> plain_numbers("1.512;-4,55043;#N/A", TextFormatSpec(";", ","))
    '1512;-4.55043;nan'
    """
    has_comma = text.decimal == ","
    content = _ERRORS_OF_CELLS.sub("nan", content) if "#" in content else content
    groups = (_DECIMAL_COMMA,) if has_comma else (_APOSTROPHES,) if text.delimiter == "," else (_APOSTROPHES, _COMMAS)
    for separators, pattern in groups:
        if any(separator in content for separator in separators):
            content = pattern.sub(lambda number: number[1] + re.sub(r"\D", "", number[2]), content)
    return content.replace(",", ".") if has_comma else content


def delimiter_of(text: TextFormatSpec) -> str | None:
    """Return the delimiter of a format; None for any white space."""
    return {"whitespace": None, " ": None, "tab": "\t", "\\t": "\t"}.get(text.delimiter, text.delimiter)


def fill_empty_cells(lines: Sequence[str], delimiter: str | None) -> Sequence[str]:
    """Write nan into the empty cells of lines."""
    if delimiter is None:
        return lines
    cell = f"[^{re.escape(delimiter)}]"
    empty = re.compile(f"(?<!{cell}) *(?!{cell})")
    return [empty.sub("nan", line) if line.strip() else line for line in lines]


def split_line(line: str, text: TextFormatSpec) -> list[str]:
    """Split a line into fields, quoted ones whole; none of a comment or an empty line."""
    # The sign of an inch is a lone quotation mark, and quotes nothing.
    is_quoted = line.count('"') > 0 and line.count('"') % 2 == 0
    content = _without_comment(line, text.comment, is_quoted)
    if not content.strip():
        return []
    delimiter = delimiter_of(text)
    if is_quoted:
        content = content if delimiter else re.sub(r"\s", " ", content).strip()
        fields = [*map(str.strip, next(csv.reader([content], delimiter=delimiter or " ", skipinitialspace=True)))]
    else:
        fields = [field.strip(' \t"').strip() for field in content.split(delimiter)]
    # Many loggers end every line of data, but not the headings, with a delimiter.
    return fields if fields[-1] else fields[:-1]


def _without_comment(line: str, comment: str, is_quoted: bool) -> str:
    start = line.find(comment) if comment else -1
    while start >= 0 and is_quoted and line.count('"', 0, start) % 2:
        start = line.find(comment, start + 1)
    return line if start < 0 else line[:start]


TIME_STAMP = re.compile(r"(?:(\d{4}-\d\d-\d\d)[T ])?(\d\d?:\d\d:\d\d(?:\.\d+)?)(?:Z|[+-]\d\d:?\d\d)?")
_GERMAN_DATE = re.compile(r"(\d\d)\.(\d\d)\.(\d{4})(?= )")


def cell_values(cells: Sequence[str]) -> tuple[FloatArray, BoolArray]:
    """Convert cells to numbers (n,), NaN for texts, and flag these; dates and times in s since 1970 or midnight."""
    first = next(filter(None, cells), "")
    if is_number(first) or not TIME_STAMP.fullmatch(_GERMAN_DATE.sub(r"\3-\2-\1", first)):
        x = np.array([float(cell) if is_number(cell) else np.nan for cell in cells])
        return x, np.array([not is_number(cell) for cell in cells], np.bool_)
    stamps = [TIME_STAMP.fullmatch(_GERMAN_DATE.sub(r"\3-\2-\1", cell)) for cell in cells]
    texts = [f"{stamp[1] or '1970-01-01'}T{stamp[2]:0>8}" if stamp else "NaT" for stamp in stamps]
    us = np.array(texts, "datetime64[us]").astype(np.int64)
    is_missing = np.array([stamp is None for stamp in stamps], np.bool_)
    return np.where(is_missing, np.nan, us * 1e-6), is_missing


def is_number(field: str) -> bool:
    """Return True if a field is a number, nan and inf included."""
    try:
        float(field)
    except ValueError:
        return False
    return True
