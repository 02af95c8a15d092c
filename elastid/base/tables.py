"""CSV tables with headings: cells as text, units of the columns from their headings."""

import csv
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterator
from pathlib import Path

from elastid.base.errors import StudyError


def read_table(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the number, from 1, and the cells by column name of each row; StudyError for a file that is no table.

    Empty rows, rows that begin with #, a first row `sep=;` and an empty last column are skipped. Cells may be separated
    by semicolons or tabs; their numbers then may have a decimal comma. UTF-16 files need a byte order mark.
    """
    try:
        raw = path.read_bytes()
        lines = raw.decode("utf-16" if raw.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "utf-8-sig").splitlines()
        lines[:1] = [line for line in lines[:1] if not re.fullmatch(r'"?sep=."?', line)] or [""]
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError("files/table", f"it cannot be read as a table ({error})", f"{path}:1:1") from None
    head = next((line for line in lines if line.strip(" ,;\t") and not line.startswith("#")), "")
    separator = next((character for character in ";\t" if character in head and "," not in head), ",")
    cells = (next(csv.reader([line], delimiter=separator), []) for line in lines)
    rows = [(n, [_with_point(cell.strip(), separator) for cell in row]) for n, row in enumerate(cells, start=1)]
    rows = [(n, row) for n, row in rows if any(row) and not row[0].startswith("#")]
    if rows and not any(row[-1] for _, row in rows):  # every row ends with a separator
        rows = [(n, row[:-1]) for n, row in rows]
    if len(rows) < 2:
        raise StudyError("files/table", "a table has a row of names and at least one below it", f"{path}:1:1")
    (head_row, headings), *rows_below = rows
    names = [name_and_unit(head)[0] for head in headings]
    if repeated_names := [name for name in names if names.count(name) > 1]:
        raise StudyError(
            "files/table", f"{len(repeated_names)} columns have the name {repeated_names[0]}", f"{path}:{head_row}:1"
        )
    for number, row in rows_below:
        if len(row) != len(headings):
            text = f"{len(row)} cells separated by {separator!r}, but row {head_row} has {len(headings)} headings"
            raise StudyError("files/table", text, f"{path}:{number}:1")
        yield number, dict(zip(headings, row, strict=True))


def _with_point(cell: str, separator: str) -> str:
    """Replace the decimal comma of a number, which may have a unit, if cells are not separated by commas."""
    number = r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?(?:\s*[^\d\s,.][^,]*)?)$"
    return cell if separator == "," else re.sub(number, r"\1.\2", cell)


def name_and_unit(heading: str) -> tuple[str, str]:
    """Split a column heading into name and unit: `1 deg`, `1 (deg)` and `joint 1 [deg]` are 1 and deg."""
    pattern = r"(?:joint\s+)?(.*?)(?:\s*[\[(]\s*([^\])]*?)\s*[\])]|\s*(°)|\s+(deg|degrees?|rad|m|s))?"
    match = re.fullmatch(pattern, heading)
    name, *units = match.groups() if match else (heading,)
    return name, next(filter(None, units), "")
