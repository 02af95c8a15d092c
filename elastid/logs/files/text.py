"""Text logs: CSV and its relatives, with or without headings, decimal points or commas, units rows and comments."""

import re
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.cells import (
    TIME_STAMP,
    cell_values,
    delimiter_of,
    fill_empty_cells,
    is_number,
    plain_numbers,
    split_line,
)
from elastid.logs.files.encodings import decode_text, decompressor, encoding_of, read_bytes, wide_encoding
from elastid.logs.files.lines import LARGE_BYTES, FileLines
from elastid.logs.files.log import ArrayLog, Log, StoredArray, missing_channel_text
from elastid.logs.files.text_format import HEAD_BYTES, format_hint
from elastid.logs.files.text_head import HEAD_LINES, find_data_start, find_headings, find_units, is_scope
from elastid.logs.headings import is_time
from elastid.logs.repair import MAX_WRONG_FRACTION

BLOCK_LINES = 1 << 16  # of a large text that are in memory at a time


@dataclass(frozen=True)
class TextLog(Log):
    """The lines of a text log, decimals as points, its headings or none; first: line (from 0) where the data start.

    units: of the columns, from a row below the headings; an empty text for a column without a unit.
    """

    path: Path
    format: TextFormatSpec
    number_lines: Sequence[str]
    headings: tuple[str, ...]
    first: int
    n_columns: int
    units: tuple[str, ...] = ()

    def by_times(self) -> Log:
        """Return columns of several times, of which shorter ones end in empty cells, as arrays."""
        n, times = len(self.number_lines) - self.first, [i for i, name in enumerate(self.headings) if is_time(name)]

        def is_empty(row: int, column: int) -> bool:
            return not "".join(split_line(self.number_lines[self.first + row], self.format)[column : column + 1])

        if len(times) < 2 or not any(is_empty(n - 1, i) for i in times):
            return self
        lengths = [bisect_left(range(n), True, key=partial(is_empty, column=i)) for i in range(self.n_columns)]
        column_of = {name: (m, i) for i, (name, m) in enumerate(zip(self.headings, lengths, strict=True))}
        units = self.units or ("",) * self.n_columns

        def read(m: int, i: int) -> FloatArray:
            return replace(self, number_lines=_first_lines(self.number_lines, self.first + m)).columns([i])[:, 0]

        dtype = np.dtype(np.float64)
        arrays = {name: StoredArray((m,), dtype, partial(read, m, i), units[i]) for name, (m, i) in column_of.items()}
        return ArrayLog(self.path, arrays)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return every column with its length, by heading or else by number."""
        return dict(self.named_columns())

    def named_columns(self) -> list[tuple[str, tuple[int, ...]]]:
        """Return columns by heading, which may occur twice."""
        names = self.headings or tuple(f"column {i + 1}" for i in range(self.n_columns))
        return [(name, (len(self.number_lines) - self.first,)) for name in names]

    def column_numbers(self, heading: str) -> list[int]:
        """Return numbers from 1 of the columns with a heading."""
        return [i for i, (name, _) in enumerate(self.named_columns(), start=1) if name == heading]

    def values(self, channels: Sequence[ChannelSpec], span: slice = slice(None)) -> FloatArray:
        """Return values (n_samples, n_c) of channels; DataError for one that is missing."""
        return self.columns([self._column(channel) for channel in channels], span)

    @property
    def is_large(self) -> bool:
        """True if its lines remain in the file, so that a part of them counts as so many samples."""
        return isinstance(self.number_lines, FileLines)

    def columns(self, columns: Sequence[int], span: slice = slice(None)) -> FloatArray:
        """Return columns (n_samples, len(columns)), counted from 0.

        A cell that is no number is missing; DataError with the row of the first one if more than 1 % of the rows have
        such cells.
        """
        selection, end = sorted(set(columns)), len(self.number_lines)
        if self.is_large:
            rows = range(self.first, end)[span]
            blocks = [rows[i : i + BLOCK_LINES] for i in range(0, len(rows), BLOCK_LINES)]
            data = np.concatenate([self._read(selection, rows.start, rows.stop) for rows in blocks or [range(0)]])
        else:
            data = self._read(selection, self.first, end, span.stop if (span.stop or 0) > 0 else None)[span]
        return data[:, [selection.index(column) for column in columns]]

    def _read(self, selection: Sequence[int], first: int, end: int, max_rows: int | None = None) -> FloatArray:
        """Return columns (n_samples, len(selection)) of some lines, at most so many samples."""
        lines = self.number_lines[first:end]
        if not lines:
            return np.zeros((0, len(selection)))
        data, error = self._numbers(selection, lines, max_rows)
        if data is not None:
            return data
        cells = fill_empty_cells(lines, delimiter_of(self.format))
        data, wrong = self._with_missing_cells(selection, cells[:max_rows])
        if wrong > max(1.0, MAX_WRONG_FRACTION * len(data)) or 2 * wrong >= len(data):
            raise DataError("records/text", self._first_cell_error(selection, cells, first) or f"{self.path}: {error}")
        return data

    def _numbers(
        self, selection: Sequence[int], lines: Sequence[str], max_rows: int | None = None
    ) -> tuple[FloatArray | None, str]:
        """Return columns (n_samples, len(selection)) of lines of numbers, else None and the reason."""
        delimiter = delimiter_of(self.format)
        load = partial(
            np.loadtxt, delimiter=delimiter, comments=self.format.comment or None, usecols=selection, quotechar='"',
            ndmin=2, max_rows=max_rows
        )  # fmt: skip
        try:
            return load(lines), ""
        except ValueError:
            try:
                return load(fill_empty_cells(lines, delimiter)), ""
            except ValueError as error:
                return None, str(error)

    def _with_missing_cells(self, selection: Sequence[int], lines: Sequence[str]) -> tuple[FloatArray, int]:
        """Return columns (n_samples, len(selection)), NaN for cells without numbers; number of rows that lack numbers.

        Dates and times of day are s.  Rows of words, such as headings, are no samples.
        """
        nonempty = [fields for line in lines if (fields := split_line(line, self.format))]
        rows = [fields for fields in nonempty if any(is_number(cell) or TIME_STAMP.fullmatch(cell) for cell in fields)]
        columns = [cell_values([row[i] if i < len(row) else "" for row in rows]) for i in selection]
        is_wrong = np.any([is_missing for _, is_missing in columns], axis=0)
        return np.stack([x for x, _ in columns], axis=1), int(is_wrong.sum()) + len(nonempty) - len(rows)

    def cell_error(self, columns: Sequence[int], span: slice) -> str:
        """Return message on the first cell without a number in a range of rows; empty without such a cell."""
        rows = range(self.first, len(self.number_lines))[span]
        lines = self.number_lines[rows.start : rows.stop]
        if not lines or not columns or self._numbers(columns, lines)[0] is not None:
            return ""
        return self._first_cell_error(columns, fill_empty_cells(lines, delimiter_of(self.format)), rows.start)

    def _first_cell_error(self, columns: Sequence[int], lines: Sequence[str], first: int) -> str:
        for number, line in enumerate(lines, start=first + 1):
            fields, row = split_line(line, self.format), f"{self.path}, row {number}"
            for column in columns if fields else ():
                title = f" ('{self.headings[column]}')" if column < len(self.headings) else ""
                if column >= len(fields):
                    text = f"{row}: {len(fields)} columns; column {column + 1}{title} is needed"
                    return text + ". Correct the row, or exclude it by samples"
                if cell_values(fields[column : column + 1])[1].any():
                    text = f"{row}, column {column + 1}{title}: '{fields[column]}' is not a number"
                    advice = "Check delimiter and decimal under text, or correct the row"
                    return f"{text}. {advice}{format_hint(self.path, self.format)}"
        return ""

    def _column(self, channel: ChannelSpec) -> int:
        column = channel.column
        number_match = None if self.headings else re.fullmatch(r"column ([1-9]\d{0,5})", channel.channel)
        if number_match and column in (None, int(number_match[1])):
            column = int(number_match[1])
        elif channel.channel and (self.headings or column is None or number_match):
            column_of = [i for i, heading in enumerate(self.headings, start=1) if heading == channel.channel]
            if not column_of:
                start = f"; the data are assumed to start in row {self.first + 1} (set text.header_lines otherwise)"
                message = missing_channel_text(self.path, channel, self.shapes())
                raise DataError("records/channels", message + start + format_hint(self.path, self.format))
            if column not in (column_of if len(column_of) > 1 else (None, *column_of)):
                numbers = ", ".join(map(str, column_of))
                text = f"several columns have the heading '{channel.channel}', {numbers}. Give column, too"
                if column is not None:
                    text = f"the heading '{channel.channel}' is not in column {column} but in column {numbers}"
                raise DataError("records/channels", text, self.path)
            return (column or column_of[0]) - 1
        column = column or 1
        if column > self.n_columns:
            text = f"column {column} does not exist; the file has {self.n_columns}, counted from 1. Correct column"
            raise DataError("records/channels", text, self.path)
        return column - 1


@contextmanager
def open_text(path: Path, text: TextFormatSpec) -> Iterator[TextLog]:
    """Open a text log; DataError where there are no numbers, StudyError for a format that contradicts itself."""
    delimiter = delimiter_of(text)
    problem = ""
    if delimiter == text.decimal:
        problem = f"delimiter and decimal are both '{text.decimal}'. With decimal commas set delimiter to ';'"
    elif delimiter is not None and (len(delimiter) != 1 or delimiter in '"\r\n'):
        problem = f"delimiter is '{text.delimiter}'. Give a single character, tab or whitespace"
    if problem:
        raise StudyError("study/recorded", problem, "text")
    lines, numbers = _lines(path, text)
    last = numbers[-HEAD_LINES:]
    ends = [i for i, line in enumerate(last, start=1) if any(map(is_number, split_line(line, text)))]
    # EOF or a remark may follow the last row with a number.
    numbers = _first_lines(numbers, len(numbers) - len(last) + ends[-1]) if ends else numbers
    first = find_data_start(numbers, text.header_lines, text)
    if first >= len(numbers) and not any(line.strip() for line in lines):
        raise DataError("records/text", "the file is empty. Export it again, or name another file", path)
    if first >= len(numbers):
        problem = f"no numbers in its {len(lines)} lines after header_lines: {text.header_lines} with delimiter"
        advice = "Set delimiter, decimal and header_lines under text"
        raise DataError("records/text", f"{problem} '{text.delimiter}'. {advice}{format_hint(path, text)}", path)
    n_columns = len(split_line(numbers[first], text))
    headings = find_headings(lines[:first], text, n_columns)
    if delimiter is None and is_scope(headings) and len(split_line(numbers[-1], text)) < n_columns:
        problem = "channels have different sample times, and blanks do not show empty cells. Export the log with tabs"
        raise DataError("records/text", problem, path)
    yield TextLog(path, text, numbers, headings, first, n_columns, find_units(lines[:first], text, headings))


def _first_lines(lines: Sequence[str], n: int) -> Sequence[str]:
    return replace(lines, n=n) if isinstance(lines, FileLines) else lines[:n]


_ARCHIVES = {b"PK\3\4": "a zip archive", b"\x28\xb5\x2f\xfd": "a file compressed by zstd", b"7z": "a 7z archive"}


def _lines(path: Path, text: TextFormatSpec) -> tuple[Sequence[str], Sequence[str]]:
    """Return lines of a text, and these with points as decimals, of a large one those that are asked for.

    DataError for a file that is no text.
    """
    is_large = path.stat().st_size > LARGE_BYTES
    raw = read_bytes(path, HEAD_BYTES if is_large else -1)
    if archive := next((name for mark, name in _ARCHIVES.items() if raw.startswith(mark)), ""):
        raise DataError("files/damaged", f"{archive} is not read. Unpack it, and give the path of the log", path)
    if b"\0" in raw[:4096] and not wide_encoding(raw):
        problem = "neither text nor a format that elastid reads. Export it as CSV, MATLAB or HDF5"
        raise DataError("files/damaged", problem, path)
    if is_large and b"\n" in raw and not wide_encoding(raw) and decompressor(path) is None:
        encoding = encoding_of(raw[: raw.rindex(b"\n")])
        return FileLines.of(path, encoding, str), FileLines.of(path, encoding, partial(plain_numbers, text=text))
    content = decode_text(read_bytes(path) if is_large else raw)
    lines, plain = content.splitlines(), plain_numbers(content, text)
    return lines, lines if plain is content else plain.splitlines()
