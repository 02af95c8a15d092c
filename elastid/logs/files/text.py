"""Text logs: CSV and its relatives, with or without headings, decimal points or commas, units rows and comments."""

import csv
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.base.units import TABLE, usual_spelling
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.encodings import decoded, encoding_of, packing, raw_bytes, wide_encoding
from elastid.logs.files.lines import LARGE_BYTES, FileLines
from elastid.logs.files.log import Log, missing_channel
from elastid.logs.repair import MAX_WRONG_FRACTION

# The usual delimiters and decimals of numbers in columns, the most usual first.
_DECIMALS: tuple[Literal[".", ","], ...] = (".", ",")
_FORMATS = [(sign, mark) for sign in (",", ";", "tab", "whitespace", "|") for mark in _DECIMALS if mark != sign]


_HEAD_LINES, _LEAST_PROPERTIES = 100, 3  # lines in which data start, and those with a property and its numbers
_SAMPLE_TIME = "SampleTime[ms]"  # property of TwinCAT Scope, below its column of times in ms
_TIMES = re.compile(r"time \d+ \[ms\]")  # headings of these columns
_MARK = re.compile(r"^\s*(%+|//+)\s*")  # of a comment, as MATLAB and C have it
_HEAD_BYTES = 1 << 16  # of a large text, which show its code
BLOCK_LINES = 1 << 16  # of a large text that are in memory at a time
WRITTEN_OTHERWISE = "; it seems to be written with "


@dataclass(frozen=True)
class TextLog(Log):
    """The lines of a text log, decimals as points, its headings or none; first: line (from 0) where the data start.

    units: of the columns, where a line below the headings states them; of those it does not state, empty texts.
    sample_ms: sample time of each column, if these differ (TwinCAT Scope); a slower column ends in empty cells.
    """

    path: Path
    format: TextFormatSpec
    number_lines: Sequence[str]
    headings: tuple[str, ...]
    first: int
    n_columns: int
    units: tuple[str, ...] = ()
    sample_ms: tuple[float, ...] = ()

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return every column with its length, by heading or else by number."""
        return dict(self.named_columns())

    def named_columns(self) -> list[tuple[str, tuple[int, ...]]]:
        """Return columns by heading, which may occur twice."""
        names = self.headings or tuple(f"column {i + 1}" for i in range(self.n_columns))
        return [(name, (self._length(i),)) for i, name in enumerate(names)]

    def numbers_of(self, heading: str) -> list[int]:
        """Return numbers from 1 of the columns with a heading."""
        return [i for i, (name, _) in enumerate(self.named_columns(), start=1) if name == heading]

    def _length(self, column: int) -> int:
        """Return samples of a column, all columns starting at the same time."""
        n = len(self.number_lines) - self.first
        return int((n - 1) * min(self.sample_ms) / self.sample_ms[column] + 1e-6) + 1 if self.sample_ms and n else n

    def _start_ms(self, column: int) -> float:
        """Return first stamp of the times that belong to a column."""
        times = [i for i in range(column + 1) if _TIMES.fullmatch(self.headings[i])]
        return float(_fields(self.number_lines[self.first], self.format)[times[-1]]) if times else 0.0

    def values(self, channels: Sequence[ChannelSpec], part: slice = slice(None)) -> FloatArray:
        """Return values (n_samples, n_c) of channels; DataError for one that is missing, or of another rate."""
        columns = [self._column(channel) for channel in channels]
        if len({self._length(column) for column in columns}) > 1:
            sample_times = ", ".join(f"{self.headings[i]} {self.sample_ms[i]:g} ms" for i in columns)
            problem = f"the sample times differ: {sample_times}. Give each channel its rate_hz"
            raise DataError("records/clock", problem, self.path)
        if self.sample_ms and columns and (lead := self._start_ms(columns[0]) - self._start_ms(0)):
            order = f"{abs(lead):g} ms {'after' if lead > 0 else 'before'}"
            problem = f"{self.headings[columns[0]]} starts {order} {self.headings[0]}"
            raise DataError("records/clock", f"{problem}. Export both with one sample time", self.path)
        return self.columns(columns, part)

    @property
    def is_large(self) -> bool:
        """True if its lines remain in the file, so that a part of them counts as so many samples."""
        return isinstance(self.number_lines, FileLines)

    def columns(self, columns: Sequence[int], part: slice = slice(None)) -> FloatArray:
        """Return columns (n_samples, len(wanted)), counted from 0.

        A cell that is no number is missing; DataError with the row of the first one if more than 1 % of the rows have
        such cells.
        """
        needed, end = sorted(set(columns)), self.first + max(map(self._length, columns))
        if self.is_large:
            rows = range(self.first, end)[part]
            parts = [rows[i : i + BLOCK_LINES] for i in range(0, len(rows), BLOCK_LINES)]
            data = np.concatenate([self._read(needed, rows.start, rows.stop) for rows in parts or [range(0)]])
        else:
            data = self._read(needed, self.first, end, part.stop if (part.stop or 0) > 0 else None)[part]
        return data[:, [needed.index(column) for column in columns]]

    def _read(self, needed: Sequence[int], first: int, end: int, most: int | None = None) -> FloatArray:
        """Return columns (n_samples, len(needed)) of some lines, at most so many samples."""
        lines = self.number_lines[first:end]
        if not lines:
            return np.zeros((0, len(needed)))
        data, error = self._numbers(needed, lines, most)
        if data is not None:
            return data
        filled = _with_nan(lines, _delimiter(self.format))
        data, wrong = self._with_missing_cells(needed, filled[:most])
        if wrong > max(1.0, MAX_WRONG_FRACTION * len(data)) or 2 * wrong >= len(data):
            complaint = self._complaint(needed, filled, first)
            raise DataError("records/text", complaint or f"{self.path}: {error}")
        return data

    def _numbers(
        self, needed: Sequence[int], lines: Sequence[str], most: int | None = None
    ) -> tuple[FloatArray | None, str]:
        """Return columns (n_samples, len(needed)) of lines of numbers, else None and the reason."""
        delimiter = _delimiter(self.format)
        load = partial(
            np.loadtxt, delimiter=delimiter, comments=self.format.comment or None, usecols=needed, quotechar='"',
            ndmin=2, max_rows=most
        )  # fmt: skip
        try:
            return load(lines), ""
        except ValueError:
            try:
                return load(_with_nan(lines, delimiter)), ""
            except ValueError as error:
                return None, str(error)

    def _with_missing_cells(self, needed: Sequence[int], lines: Sequence[str]) -> tuple[FloatArray, int]:
        """Return columns (n_samples, len(needed)), NaN for cells that are no numbers; number of rows that lack numbers.

        Dates and times of day are s.  Rows of words, such as headings, are no samples.
        """
        nonempty = [fields for line in lines if (fields := _fields(line, self.format))]
        rows = [fields for fields in nonempty if any(_is_number(field) or _STAMP.fullmatch(field) for field in fields)]
        columns = [_values([row[i] if i < len(row) else "" for row in rows]) for i in needed]
        is_wrong = np.any([is_missing for _, is_missing in columns], axis=0)
        return np.stack([x for x, _ in columns], axis=1), int(is_wrong.sum()) + len(nonempty) - len(rows)

    def wrong_cell(self, columns: Sequence[int], part: slice) -> str:
        """Return message on the first cell without a number in a range of rows; empty without such a cell."""
        rows = range(self.first, len(self.number_lines))[part]
        lines = self.number_lines[rows.start : rows.stop]
        if not lines or not columns or self._numbers(columns, lines)[0] is not None:
            return ""
        return self._complaint(columns, _with_nan(lines, _delimiter(self.format)), rows.start)

    def _complaint(self, columns: Sequence[int], lines: Sequence[str], first: int) -> str:
        for number, line in enumerate(lines, start=first + 1):
            fields = _fields(line, self.format)
            for column in columns if fields else ():
                title = f" ('{self.headings[column]}')" if column < len(self.headings) else ""
                if column >= len(fields):
                    return (
                        f"{self.path}, row {number}: {len(fields)} columns; column {column + 1}{title} is needed. "
                        "Correct the row, or exclude it by samples"
                    )
                if _values(fields[column : column + 1])[1].any():
                    return (
                        f"{self.path}, row {number}, column {column + 1}{title}: '{fields[column]}' is not a number. "
                        "Check delimiter and decimal under text, or correct the "
                        f"row{otherwise_written(self.path, self.format)}"
                    )
        return ""

    def _column(self, channel: ChannelSpec) -> int:
        column = channel.column
        numbered = None if self.headings else re.fullmatch(r"column ([1-9]\d{0,5})", channel.channel)
        if numbered and column in (None, int(numbered[1])):
            column = int(numbered[1])
        elif channel.channel and (self.headings or column is None or numbered):
            headed = [i for i, heading in enumerate(self.headings, start=1) if heading == channel.channel]
            if not headed:
                start = f"; the data are assumed to start in row {self.first + 1} (set text.header_lines otherwise)"
                missing = missing_channel(self.path, channel, self.shapes())
                raise DataError("records/channels", missing + start + otherwise_written(self.path, self.format))
            if column not in (headed if len(headed) > 1 else (None, *headed)):
                places = ", ".join(map(str, headed))
                raise DataError(
                    "records/channels",
                    f"{self.path}: several columns have the heading '{channel.channel}', {places}. Give column, too"
                    if column is None
                    else (
                        f"{self.path}: the heading '{channel.channel}' is not in column {column} but in column {places}"
                    ),
                )
            return (column or headed[0]) - 1
        column = column or 1
        if column > self.n_columns:
            raise DataError(
                "records/channels",
                f"column {column} does not exist; the file has {self.n_columns}, counted from 1. Correct column",
                self.path,
            )
        return column - 1


@contextmanager
def opened(path: Path, text: TextFormatSpec) -> Iterator[TextLog]:
    """Open a text log; DataError where there are no numbers, StudyError for a format that contradicts itself."""
    delimiter = _delimiter(text)
    problem = ""
    if delimiter == text.decimal:
        problem = f"delimiter and decimal are both '{text.decimal}'. With decimal commas set delimiter to ';'"
    elif delimiter is not None and (len(delimiter) != 1 or delimiter in '"\r\n'):
        problem = f"delimiter is '{text.delimiter}'. Give a single character, tab or whitespace"
    if problem:
        raise StudyError("study/recorded", problem, "text")
    lines, numbers = _lines(path, text)
    numbers = _without_end(numbers, text)
    first = _data_start(numbers, text.header_lines, text)
    if first >= len(numbers) and not any(line.strip() for line in lines):
        raise DataError("records/text", "the file is empty. Export it again, or name another file", path)
    if first >= len(numbers):
        raise DataError(
            "records/text",
            f"no numbers in its {len(lines)} lines after header_lines: {text.header_lines} with delimiter "
            f"'{text.delimiter}'. Set delimiter, decimal and header_lines under text{otherwise_written(path, text)}",
            path,
        )
    n_columns = len(_fields(numbers[first], text))
    headings = _headings(lines[:first], text, n_columns)
    units, sample_ms = _units(lines[:first], text, headings), _sample_times(lines[:first], text, n_columns)
    if sample_ms and delimiter is None:  # an empty cell moves those behind it
        problem = "channels have different sample times, and blanks do not show empty cells. Export the log with tabs"
        raise DataError("records/text", problem, path)
    yield TextLog(path, text, numbers, headings, first, n_columns, units, sample_ms)


def _without_end(numbers: Sequence[str], text: TextFormatSpec) -> Sequence[str]:
    """Return lines up to the last one with a number: EOF or a remark may follow it."""
    last = numbers[-_HEAD_LINES:]
    filled = [i for i, line in enumerate(last, start=1) if any(map(_is_number, _fields(line, text)))]
    n = len(numbers) - len(last) + filled[-1] if filled else len(numbers)
    return replace(numbers, n=n) if isinstance(numbers, FileLines) else numbers[:n]


_ARCHIVES = {b"PK\3\4": "a zip archive", b"\x28\xb5\x2f\xfd": "a file compressed by zstd", b"7z": "a 7z archive"}


def _lines(path: Path, text: TextFormatSpec) -> tuple[Sequence[str], Sequence[str]]:
    """Return lines of a text, and these with points as decimals, of a large one those that are asked for.

    DataError for a file that is no text.
    """
    is_large = path.stat().st_size > LARGE_BYTES
    raw = raw_bytes(path, _HEAD_BYTES if is_large else -1)
    if archive := next((name for mark, name in _ARCHIVES.items() if raw.startswith(mark)), ""):
        raise DataError("files/damaged", f"{archive} is not read. Unpack it, and give the path of the log", path)
    if b"\0" in raw[:4096] and not wide_encoding(raw):
        raise DataError(
            "files/damaged", "neither text nor a format that elastid reads. Export it as CSV, MATLAB or HDF5", path
        )
    if is_large and b"\n" in raw and not wide_encoding(raw) and packing(path) is None:
        encoding = encoding_of(raw[: raw.rindex(b"\n")])
        return FileLines.of(path, encoding, str), FileLines.of(path, encoding, partial(plain_numbers, text=text))
    content = decoded(raw_bytes(path) if is_large else raw)
    lines, plain = content.splitlines(), plain_numbers(content, text)
    return lines, lines if plain is content else plain.splitlines()


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


def guess_format(path: Path) -> TextFormatSpec:
    """Guess the format of a text log: the delimiter and decimal with which most of its fields are numbers."""
    return TextFormatSpec() if path.is_dir() else _best_format(path)[1]


def _best_format(path: Path) -> tuple[int, TextFormatSpec]:
    raw = raw_bytes(path, _HEAD_BYTES)
    lines = decoded(raw).splitlines()
    lines = lines[-21:-1] if len(raw) == _HEAD_BYTES else lines[-20:]  # the last of 64 KiB may be cut

    def numeric_score(text: TextFormatSpec) -> int:
        plain = plain_numbers("\n".join(lines), text).splitlines()
        fields = [field for line in plain for field in _fields(line, text) if field]
        return sum(1 if _is_number(field) else -1 for field in fields)

    scored = [(numeric_score(text), text) for text in (TextFormatSpec(*spec) for spec in _FORMATS)]
    return max(scored, key=lambda pair: pair[0])


def otherwise_written(path: Path, text: TextFormatSpec) -> str:
    """Return the end of a message on an unreadable log: the format that it seems to have, if another."""
    surplus, seems = _best_format(path)
    if surplus <= 0 or (seems.delimiter, seems.decimal) == (text.delimiter, text.decimal):
        return ""
    return f"{WRITTEN_OTHERWISE}{described_format(seems)}"


def described_format(text: TextFormatSpec) -> str:
    """Return a format as a study states it."""
    return f"text: {{delimiter: '{text.delimiter}', decimal: '{text.decimal}'}}"


def _data_start(numbers: Sequence[str], first: int, text: TextFormatSpec) -> int:
    """Find the first line from `first` on with a number, after any rows of properties such as `SampleTime[ms]  1`.

    These begin with a word, where the rows of data begin with a number.
    """
    rows = [_fields(line, text) for line in numbers[first : first + _HEAD_LINES]]
    starts = [i for i, fields in enumerate(rows) if any(map(_is_number, fields))]
    words = [i for i in starts if not _is_number(rows[i][0])]
    numbers_first = [i for i in starts if rows[i][0] and i not in words]
    if _LEAST_PROPERTIES <= len(words) < len(starts) / 2:
        starts = [i for i in starts if i > words[-1]]
    elif 2 * len(numbers_first) > len(starts) and all(rows[i][0] for i in starts if i < numbers_first[0]):
        starts = [i for i in starts if i >= numbers_first[0]]
    while not starts and first + len(rows) < len(numbers):
        fields = _fields(numbers[first + len(rows)], text)
        starts = [len(rows)] if any(map(_is_number, fields)) else []
        rows.append(fields)
    return first + (starts[0] if starts else len(rows))


def _headings(head: Sequence[str], text: TextFormatSpec, n_columns: int) -> tuple[str, ...]:
    """Return the first line without numbers after header_lines; else the last header line; else the last comment."""
    after = head[text.header_lines :]
    plain = [_fields(_MARK.sub("", line), text) for line in [*after, *reversed(head[: text.header_lines])]]
    comments = [line.lstrip(f" {text.comment}") for line in reversed(head) if text.comment and text.comment in line]
    whole = [_fields(line, replace(text, comment="")) for line in comments]  # a number sign within a heading
    rows = plain + [_fields(line, text) for line in comments] + whole
    last = next((fields for fields in reversed(plain[: len(after)]) if fields), [])
    # A last column of remarks has a heading, and no numbers.
    rows = [*([last[:n_columns]] if len(last) == n_columns + 1 else []), *rows]
    rows = [fields for fields in rows if len(fields) == n_columns]
    times = next((fields for fields in rows if fields[0] == _SAMPLE_TIME), [""] * n_columns)
    names = next((fields for fields in rows if not any(map(_is_number, fields))), next(iter(rows), []))
    pairs = enumerate(zip(names, times, strict=False), start=1)
    return tuple(f"time {i} [ms]" if time == _SAMPLE_TIME else name or f"column {i}" for i, (name, time) in pairs)


def _sample_times(head: Sequence[str], text: TextFormatSpec, n_columns: int) -> tuple[float, ...]:
    """Return sample times in ms of the columns of a TwinCAT Scope export, times before their channels; else none."""
    rows = (fields for line in head if (fields := _fields(line, text)) and fields[0] == _SAMPLE_TIME)
    fields = next((fields for fields in rows if len(fields) == n_columns), [])
    following = [fields[i + 1] if field == _SAMPLE_TIME else field for i, field in enumerate(fields)]
    times = tuple(float(number) if _is_number(number := field.replace(",", ".")) else 0.0 for field in following)
    return times if len(set(times)) > 1 and min(times) > 0 else ()


def _units(head: Sequence[str], text: TextFormatSpec, headings: Sequence[str]) -> tuple[str, ...]:
    """Find the header row other than the headings with units of columns, in brackets or not; None without one."""
    rows = [fields for line in head if len(fields := _fields(line, text)) == len(headings)]
    if is_scope := any(fields[0] == _SAMPLE_TIME for fields in rows):
        rows = [fields for fields in rows if fields[0] == "Unit"]
    for fields in rows:
        units = tuple((field.partition(" (")[0] if is_scope else field).strip("[]()") for field in fields)
        if fields != list(headings) and any(usual_spelling(unit) in TABLE for unit in units):
            return tuple("" if unit in ("None", "Unit") else unit for unit in units) if is_scope else units
    return ()


def _delimiter(text: TextFormatSpec) -> str | None:
    names = {"whitespace": None, " ": None, "tab": "\t", "\\t": "\t"}
    return names.get(text.delimiter, text.delimiter)


def _with_nan(lines: Sequence[str], delimiter: str | None) -> Sequence[str]:
    if delimiter is None:
        return lines
    other = f"[^{re.escape(delimiter)}]"
    empty = re.compile(f"(?<!{other}) *(?!{other})")
    return [empty.sub("nan", line) if line.strip() else line for line in lines]


def _fields(line: str, text: TextFormatSpec) -> list[str]:
    """Split a line into fields, quoted ones whole; none of a comment or an empty line."""
    # The sign of an inch is a lone quotation mark, and quotes nothing.
    is_quoted = line.count('"') > 0 and line.count('"') % 2 == 0
    content = _without_comment(line, text.comment, is_quoted)
    if not content.strip():
        return []
    delimiter = _delimiter(text)
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


_STAMP = re.compile(r"(?:(\d{4}-\d\d-\d\d)[T ])?(\d\d?:\d\d:\d\d(?:\.\d+)?)(?:Z|[+-]\d\d:?\d\d)?")
_GERMAN_DATE = re.compile(r"(\d\d)\.(\d\d)\.(\d{4})(?= )")


def _values(cells: Sequence[str]) -> tuple[FloatArray, BoolArray]:
    """Convert cells to numbers (n,), NaN for texts, and flag these; dates and times in s since 1970 or midnight."""
    first = next(filter(None, cells), "")
    if _is_number(first) or not _STAMP.fullmatch(_GERMAN_DATE.sub(r"\3-\2-\1", first)):
        x = np.array([float(cell) if _is_number(cell) else np.nan for cell in cells])
        return x, np.array([not _is_number(cell) for cell in cells], dtype=np.bool_)
    stamps = [_STAMP.fullmatch(_GERMAN_DATE.sub(r"\3-\2-\1", cell)) for cell in cells]
    texts = [f"{stamp[1] or '1970-01-01'}T{stamp[2]:0>8}" if stamp else "NaT" for stamp in stamps]
    us = np.array(texts, dtype="datetime64[us]").astype(np.int64)
    is_missing = np.array([stamp is None for stamp in stamps], dtype=np.bool_)
    return np.where(is_missing, np.nan, us * 1e-6), is_missing


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True
