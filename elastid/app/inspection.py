"""Content of a log or a result file for `elastid inspect`: names, shapes, units, rates, first and extreme values."""

import json
import math
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.base.arrays import FloatArray
from elastid.base.display import columns
from elastid.base.errors import DataError, StudyError
from elastid.base.value_range import format_values, value_range
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.clocks import is_clock
from elastid.logs.files.formats import is_log, naming_file, open_log
from elastid.logs.files.log import StoredArray
from elastid.logs.files.text import BLOCK_LINES, TextLog
from elastid.logs.files.text_format import describe_format, guess_format
from elastid.logs.files.universal import is_universal_file
from elastid.logs.repair.time_stamps import describe_steps, even_grid
from elastid.logs.responses.reading import describe_responses
from elastid.logs.responses.table import HOW_TO_SAVE
from elastid.store.artefacts import kind_of
from elastid.store.description import describe_artefact
from elastid.store.files import is_as_written, is_intact
from elastid.study.robots import yaml_text

_BLOCKS = 16  # blocks of a large text file that are read


def _signal_row(
    name: str, shape: tuple[int, ...], unit: str, blocks: Iterator[NDArray[Any]], rate_hz: float | None = None
) -> tuple[str, ...]:
    """Return name, shape, unit, first, lowest and highest value, and remarks on rate, values or a read error."""
    cells = (name, " x ".join(map(str, shape)), unit)
    try:
        first_block = next(blocks, np.zeros(0))
        values = value_range(chain([first_block], blocks))
    except DataError as error:
        return (*cells, "", "", "", f"cannot be read: {error}")
    remarks = [f"{values.missing} values are not finite"] if values.missing else []
    if rate_hz is not None:
        remarks.append(f"{rate_hz:.6g} Hz")
    elif rate := _describe_rate(first_block):
        remarks.append(rate)
    return (*cells, f"{values.first:.6g}", f"{values.low:.6g}", f"{values.high:.6g}", "; ".join(remarks))


def _text_rows(log: TextLog) -> list[tuple[str, ...]]:
    columns = log.named_columns()
    signals: list[Iterator[FloatArray]] = [(log.columns([k])[:, 0] for k in (i,)) for i in range(len(columns))]
    if log.is_large:
        signals = [iter(x) for x in _blocks(log, len(columns))]
    else:
        with suppress(DataError):  # which the row of the column then shows
            signals = [iter([column]) for column in log.columns(range(len(columns))).T]
    units = log.units or [""] * len(columns)
    return [_signal_row(*row, unit, x) for row, unit, x in zip(columns, units, signals, strict=True)]


def _blocks(log: TextLog, n_columns: int) -> list[list[FloatArray]]:
    """Return the values of each column of a large text file in blocks of rows, evenly spread over the file."""
    n = len(log.number_lines) - log.first
    starts = np.unique(np.linspace(0, max(0, n - BLOCK_LINES), _BLOCKS).astype(int)).tolist()
    columns: list[list[FloatArray]] = [[] for _ in range(n_columns)]
    for start in starts:
        for column, x in zip(columns, log.columns(range(n_columns), slice(start, start + BLOCK_LINES)).T, strict=True):
            column.append(np.array([x[0], np.nanmin(x), np.nanmax(x)]) if start else x)
    return columns


def _describe_rate(values: NDArray[Any]) -> str:
    """Describe the rate of a signal that rises like a time or a counter; empty for other signals."""
    t = np.squeeze(values)
    if t.ndim != 1 or t.dtype.kind == "b" or not is_clock(time_s := np.asarray(t - t[:1], dtype=np.float64)):
        return ""
    grid = even_grid(time_s)
    if grid is not None and len(grid[0]) == grid[0][-1] + 1:
        return f"rises evenly: {grid[1]:.6g} Hz if it is the time in s"
    return f"rises unevenly: {describe_steps(time_s)}, if it is the time in s; a study resamples where `time` names it"


_COLUMNS = ("signal", "shape", "unit", "first", "lowest", "highest", "")
_OBJECTS = (
    "timetables, timeseries and Simulink outputs are objects, which cannot be read outside MATLAB; save their "
    "arrays: t = seconds(T.Time); x = T.Variables; save('log.mat', 't', 'x', '-v7')"
)


def describe_file(path: Path) -> str:
    """Describe a file in plain text; StudyError for a missing file, DataError for an unreadable one."""
    if not path.exists():
        raise StudyError("files/missing", "no such file", path)
    if not is_log(path):
        raise StudyError("files/kind", "a folder, but no ROS bag; name a file in it", path)
    if path.is_file() and (not is_intact(path) or is_as_written(path) is False):
        raise DataError("files/damaged", "its content has changed since it was written; run its stage again", path)
    with naming_file(path, "damaged, or no file that elastid reads; copy or export it again"):
        return "\n".join(_lines(path))


def _lines(path: Path) -> list[str]:
    if path.is_dir():
        return _log_lines(path)
    if kind_of(path) is not None:
        return [describe_artefact(path)]
    if path.suffix.lower() == ".json":
        try:
            return [f"{path}:", *yaml_text(json.loads(path.read_bytes())).splitlines()]
        except ValueError as error:
            text = f"damaged, cut short or no JSON file ({error}); run its stage again"
            raise DataError("files/damaged", text, path) from None
    responses, lines = describe_responses(path), []
    if responses:
        lines = [f"{path}: {len(responses)} frequency responses; list the file under experiment.responses.files"]
        lines += [f"  {response}" for response in responses]
    if not (responses and is_universal_file(path)):
        lines += _log_lines(path)
    return lines


def _log_lines(path: Path) -> list[str]:
    """Return lines on all signals and other contents of a log."""
    text = guess_format(path)
    with open_log(path, text) as log:
        signals = _text_rows(log) if isinstance(log, TextLog) else []
        signals += [
            _signal_row(name, array.shape, array.units, array.blocks(), array.rate_hz)
            for name, array in log.arrays.items()
            if array.is_signal
        ]
        contents = [f"  {name}: {_describe_array(array)}" for name, array in log.arrays.items() if not array.is_signal]
        lines = [f"{path}: {len(signals)} signals; name them as `channel` in experiment.recorded.channels"]
        if isinstance(log, TextLog) and text != TextFormatSpec():
            lines.append(f"  its numbers are written with {describe_format(text)}")
        if isinstance(log, TextLog) and log.is_large:
            lines.append(f"  lowest and highest of {_BLOCKS} blocks of {BLOCK_LINES} lines; the file is large")
        lines += [f"  {line}" for line in columns([_COLUMNS, *signals])]
        lines += ["other contents, which cannot be channels:", *contents] if contents else []
    if not signals and path.suffix.lower() == ".mat":
        lines.append(f"  {_OBJECTS}; {HOW_TO_SAVE}")
    return lines


def _describe_array(array: StoredArray) -> str:
    if array.dtype.kind not in "fiubcU" or math.prod(array.shape) > 1:
        return f"{array.dtype} ({' x '.join(map(str, array.shape)) or 'one'})"
    try:
        return format_values(np.asarray(array.read()))
    except DataError as error:
        return str(error)
