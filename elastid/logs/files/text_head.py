"""The head of a text log: the line in which data start, headings, units and sample times of the columns."""

import re
from collections.abc import Sequence
from dataclasses import replace

from elastid.base.units import TABLE, table_unit
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.cells import is_number, split_line

HEAD_LINES, _LEAST_PROPERTIES = 100, 3  # lines in which data start, and those with a property and its numbers
_SAMPLE_TIME = "SampleTime[ms]"  # property of TwinCAT Scope, below its column of times in ms
_MARK = re.compile(r"^\s*(%+|//+)\s*")  # of a comment, as MATLAB and C have it


def find_data_start(numbers: Sequence[str], first: int, text: TextFormatSpec) -> int:
    """Find the first line from `first` on with a number, after any rows of properties such as `SampleTime[ms]  1`.

    These begin with a word, where the rows of data begin with a number.
    """
    rows = [split_line(line, text) for line in numbers[first : first + HEAD_LINES]]
    starts = [i for i, fields in enumerate(rows) if any(map(is_number, fields))]
    heads = [i for i in starts if not is_number(rows[i][0])]
    numbers_first = [i for i in starts if rows[i][0] and i not in heads]
    if _LEAST_PROPERTIES <= len(heads) < len(starts) / 2:
        starts = [i for i in starts if i > heads[-1]]
    elif 2 * len(numbers_first) > len(starts) and all(rows[i][0] for i in starts if i < numbers_first[0]):
        starts = [i for i in starts if i >= numbers_first[0]]
    while not starts and first + len(rows) < len(numbers):
        fields = split_line(numbers[first + len(rows)], text)
        starts = [len(rows)] if any(map(is_number, fields)) else []
        rows.append(fields)
    return first + (starts[0] if starts else len(rows))


def find_headings(head: Sequence[str], text: TextFormatSpec, n_columns: int) -> tuple[str, ...]:
    """Return the first line without numbers after header_lines; else the last header line; else the last comment."""
    below = head[text.header_lines :]
    plain = [split_line(_MARK.sub("", line), text) for line in [*below, *reversed(head[: text.header_lines])]]
    comments = [line.lstrip(f" {text.comment}") for line in reversed(head) if text.comment and text.comment in line]
    comment_rows = [split_line(line, replace(text, comment="")) for line in comments]  # a number sign within a heading
    rows = plain + [split_line(line, text) for line in comments] + comment_rows
    last = next((fields for fields in reversed(plain[: len(below)]) if fields), [])
    # A last column of remarks has a heading, and no numbers.
    rows = [*([last[:n_columns]] if len(last) == n_columns + 1 else []), *rows]
    rows = [fields for fields in rows if len(fields) == n_columns]
    times = next((fields for fields in rows if fields[0] == _SAMPLE_TIME), [""] * n_columns)
    names = next((fields for fields in rows if not any(map(is_number, fields))), next(iter(rows), []))
    pairs = enumerate(zip(names, times, strict=False), start=1)
    return tuple(f"time {i} [ms]" if time == _SAMPLE_TIME else name or f"column {i}" for i, (name, time) in pairs)


def is_scope(headings: Sequence[str]) -> bool:
    """Return True for the headings of a TwinCAT Scope export, a column of times before each channel."""
    return "time 1 [ms]" in headings


def find_units(head: Sequence[str], text: TextFormatSpec, headings: Sequence[str]) -> tuple[str, ...]:
    """Find the header row other than the headings with units of columns, in brackets or not; None without one."""
    rows = [fields for line in head if len(fields := split_line(line, text)) == len(headings)]
    if is_scope := any(fields[0] == _SAMPLE_TIME for fields in rows):
        rows = [fields for fields in rows if fields[0] == "Unit"]
    for fields in rows:
        units = tuple((field.partition(" (")[0] if is_scope else field).strip("[]()") for field in fields)
        if fields != list(headings) and any(table_unit(unit) in TABLE for unit in units):
            return tuple("" if unit in ("None", "Unit") else unit for unit in units) if is_scope else units
    return ()
