"""The content of a log of another program or of a result: names, shapes, units, rates, first and extreme values."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.base.arrays import FloatArray, ValueRange, shown_values, value_range
from elastid.base.errors import DataError, StudyError
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.friction_study.laws import NOT_ASKED
from elastid.nonlinear.result import friction_rows
from elastid.recorded.files.formats import is_log, naming, opened_log
from elastid.recorded.files.log import ArrayLog, StoredArray
from elastid.recorded.files.text import TextLog, described_format, guess_format
from elastid.recorded.repair.time_stamps import TimeSteps, even_grid
from elastid.recorded.responses.reading import contents_of
from elastid.recorded.responses.table import HOW_TO_SAVE, is_universal_file
from elastid.report.friction_content import refusals
from elastid.store.artefacts import kind_of
from elastid.store.files import is_as_written, is_intact
from elastid.store.friction_study import FRICTION, read_friction_result
from elastid.store.kinds import SCHEMA
from elastid.store.measured import read_friction
from elastid.store.reading import described as described_artefact
from elastid.store.results import read_fit


@dataclass(frozen=True)
class SignalSummary:
    """remark: rate, missing values, or why it cannot be read.  values: None where it cannot."""

    name: str
    shape: tuple[int, ...]
    unit: str
    values: ValueRange | None
    remark: str = ""

    @property
    def cells(self) -> tuple[str, ...]:
        """Name, shape, unit, first, lowest and highest value as texts."""
        ends = self.values
        numbers = ("", "", "") if ends is None else (f"{ends.first:.6g}", f"{ends.low:.6g}", f"{ends.high:.6g}")
        return (self.name, " x ".join(map(str, self.shape)), self.unit, *numbers)


def signal_summary(name: str, array: StoredArray) -> SignalSummary:
    """Of an array, read in pieces where its format can."""
    try:
        blocks = array.blocks()
        start = next(blocks, np.zeros(0))
        values = value_range(chain([start], blocks))
    except DataError as error:
        return SignalSummary(name, array.shape, array.units, None, f"cannot be read: {error}")
    return SignalSummary(name, array.shape, array.units, values, _remark(start, values, array.rate_hz))


def text_summaries(log: TextLog) -> list[SignalSummary]:
    """Of every column of a text log, those with words among them as well."""
    named = log.named_columns()
    try:
        columns: Iterable[FloatArray | DataError] = log.columns(range(len(named))).T
    except DataError:
        columns = [_column(log, i) for i in range(len(named))]
    return [_of_column(name, shape, x) for (name, shape), x in zip(named, columns, strict=True)]


def _column(log: TextLog, i: int) -> FloatArray | DataError:
    try:
        return log.columns([i])[:, 0]
    except DataError as error:
        return error


def _of_column(name: str, shape: tuple[int, ...], x: FloatArray | DataError) -> SignalSummary:
    if isinstance(x, DataError):
        return SignalSummary(name, shape, "", None, f"cannot be read: {x}")
    values = value_range([x])
    return SignalSummary(name, shape, "", values, _remark(x, values, None))


def _remark(start: NDArray[Any], values: ValueRange, rate_hz: float | None) -> str:
    remarks = [f"{values.missing} values are not finite"] if values.missing else []
    if rate_hz is not None:
        remarks.append(f"{rate_hz:.6g} Hz")
    elif rise := _rise(start):
        remarks.append(rise)
    return "; ".join(remarks)


def _rise(start: NDArray[Any]) -> str:
    """The rate of a signal that rises by regular steps, as a time or a counter does; empty for any other."""
    t = np.squeeze(start) if start.size > 1 else start
    if t.ndim != 1 or len(t) < 3 or t.dtype.kind == "b" or not np.isfinite(t).all():
        return ""
    time_s = np.asarray(t, dtype=np.float64) - float(t[0])
    steps = np.diff(time_s)
    usual = float(np.median(steps))
    if steps.min() < 0 or time_s[-1] == 0 or np.mean(np.abs(steps - usual) <= 0.5 * usual) < _REGULAR:
        return ""
    grid, described = even_grid(time_s), TimeSteps.of(time_s)
    if grid is not None and len(grid[0]) == grid[0][-1] + 1:
        return f"rises evenly: {grid[2]:.6g} Hz if it is the time in s"
    return f"rises unevenly: {described}, if it is the time in s; a study resamples on it where `time` names it"


# Share of the steps of a time that are near their median; other signals that rise have fewer.
_REGULAR = 0.9
_COLUMNS = ("signal", "shape", "unit", "first", "lowest", "highest")
# Files of a run folder that hold no signals.
_WITHOUT_SIGNALS = (".html", ".pdf", ".png", ".svg", ".yml")
_OBJECTS = (
    "timetables, timeseries and Simulink outputs are objects, which cannot be read outside MATLAB; save their "
    "arrays: t = seconds(T.Time); x = T.Variables; save('log.mat', 't', 'x', '-v7')"
)


def described(path: Path) -> str:
    """A page of plain text; StudyError where the file is not there, DataError where it cannot be read."""
    if not path.exists():
        raise StudyError(f"{path}: no such file")
    if not is_log(path):
        raise StudyError(f"{path}: a folder, but no ROS bag; name a file in it")
    if path.is_file() and (not is_intact(path) or is_as_written(path) is False):
        raise DataError(f"{path}: its content has changed since it was written; run its stage again")
    with naming(path, "damaged, or no file that elastid reads; copy or export it again"):
        return "\n".join(_lines(path))


def _lines(path: Path) -> list[str]:
    if path.is_dir():
        return _log_lines(path)
    if kind_of(path) is not None:
        numbers = {"fit": _parameters, "frf": _friction, FRICTION: _friction_numbers}.get(
            kind_of(path) or "", lambda _: iter(())
        )
        return [described_artefact(path), *numbers(path)]
    if path.suffix.lower() == ".json":
        return [f"{path}:", *_json_lines(path)]
    if path.suffix.lower() in _WITHOUT_SIGNALS and is_as_written(path):
        return [f"{path}: written by elastid, and unchanged since"]
    responses, lines = contents_of(path), []
    if responses:
        lines = [f"{path}: {len(responses)} frequency responses; list the file under experiment.responses.files"]
        lines += [f"  {response}" for response in responses]
    if not is_universal_file(path):
        lines += _log_lines(path)
    return lines


def _log_lines(path: Path) -> list[str]:
    """The signals of a log, and whatever else is in it."""
    text = TextFormatSpec() if path.is_dir() else guess_format(path)
    with opened_log(path, text) as log:
        if isinstance(log, TextLog):
            signals, contents = text_summaries(log), []
        else:
            arrays = log.arrays if isinstance(log, ArrayLog) else {}
            signals = [signal_summary(name, array) for name, array in arrays.items() if array.is_signal]
            contents = [f"  {name}: {_other(array)}" for name, array in arrays.items() if not array.is_signal]
        lines = [f"{path}: {len(signals)} signals; name them as `channel` in experiment.recorded.channels"]
        if isinstance(log, TextLog) and text != TextFormatSpec():
            lines.append(f"  its numbers are written with {described_format(text)}")
        lines += _table(signals)
        lines += ["other contents, which cannot be channels:", *contents] if contents else []
    if not signals and path.suffix.lower() == ".mat":
        lines.append(f"  {_OBJECTS}; {HOW_TO_SAVE}")
    return lines


def _table(signals: Sequence[SignalSummary]) -> Iterator[str]:
    rows = [_COLUMNS, *(signal.cells for signal in signals)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_COLUMNS))]
    for row, remark in zip(rows, ("", *(signal.remark for signal in signals)), strict=True):
        cells = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        yield f"  {cells}  {remark}".rstrip()


def _other(array: Any) -> str:
    """A number or text with its value, anything else by its type."""
    shape = " x ".join(map(str, array.shape)) or "one"
    if array.dtype.kind not in "fiubcU" or np.prod(array.shape, dtype=int) > 1:
        return f"{array.dtype} ({shape})"
    try:
        return shown_values(np.asarray(array.read()))
    except DataError as error:
        return str(error)


def _parameters(path: Path) -> Iterator[str]:
    """The identified parameters of a fit, with standard deviation and 95 % interval."""
    result = read_fit(path)
    yield f"  {result.status}; parameters (standard deviation; 95 % interval):"
    for parameter in result.parameters:
        value = f"    {parameter.name} = {result.values[parameter.name]:.6g} {parameter.unit}"
        if parameter.name in result.std:
            low, high = result.interval(parameter.name)
            value += f" ({result.std[parameter.name]:.2g}; {low:.6g} to {high:.6g})"
        yield value.rstrip()


def _friction(path: Path) -> Iterator[str]:
    """The friction that was taken out of the responses, where the study asked for it."""
    friction = read_friction(path)
    if friction is None:
        return
    if friction.shapes:
        yield "  friction taken out of the torque, link side (standard deviation; 95 % interval):"
    for row in friction_rows(friction):
        if row.level is not None and row.std is not None and row.interval is not None:
            low, high = row.interval
            yield f"    {row.place}: F_c = {row.level:.6g} {row.unit} ({row.std:.2g}; {low:.6g} to {high:.6g})"
    yield from (f"  {note}" for note in friction.notes if note.code != "friction-taken-out")


def _friction_numbers(path: Path) -> Iterator[str]:
    """The numbers of friction that were identified, with standard deviation and 95 % interval; and what was not."""
    result = read_friction_result(path)
    yield f"  {result.status}; friction, link side (standard deviation; 95 % interval):"
    for each in result.numbers:
        value = f"    {each.name} = {each.value:.6g} {each.unit}".rstrip()
        yield f"{value} ({each.std:.2g}; {each.low:.6g} to {each.high:.6g})"
    for refusal in refusals(result):
        if refusal.reason != NOT_ASKED:
            yield f"  no {refusal.part} (joint {', '.join(refusal.joints)}): {refusal.reason}"


def _json_lines(path: Path) -> Iterator[str]:
    """The numbers and texts of summary.json and the like; DataError where it is no JSON."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DataError(f"{path}: damaged, cut short or no JSON file ({error}); run its stage again") from None
    if isinstance(content, dict) and content.get("schema", SCHEMA) > SCHEMA:
        raise DataError(f"{path}: form {content['schema']}, written by a newer elastid; this one reads up to {SCHEMA}")
    yield from _json_value("", content, 0)


def _json_value(name: str, value: Any, depth: int) -> Iterator[str]:
    indent = "  " * depth
    members: Sequence[tuple[str, Any]]
    if isinstance(value, list) and all(isinstance(each, int | float) for each in value) and value:
        yield f"{indent}{name} = {shown_values(np.array(value))}"
        return
    if isinstance(value, dict):
        members = list(value.items())
    elif isinstance(value, list):
        members = [(str(i), each) for i, each in enumerate(value, start=1)]
    else:
        yield f"{indent}{name} = {value:.6g}" if isinstance(value, float) else f"{indent}{name} = {value}"
        return
    if name:
        yield f"{indent}{name}: {'' if members else 'none'}".rstrip()
    for key, member in members:
        yield from _json_value(key, member, depth + 1)
