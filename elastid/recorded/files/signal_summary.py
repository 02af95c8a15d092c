"""A signal of a log in a few numbers, for those who look into a file: unit, rate, first and extreme values."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.value_range import ValueRange, value_range
from elastid.recorded.files.log import StoredArray
from elastid.recorded.files.text import TextLog

# Samples that tell whether a signal rises evenly, as a time does.
_MAX_TIMES = 10_000
# Steps of a time differ from their median by this part of it.
_MAX_UNEVENNESS = 0.5
_MIN_TIMES = 3


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
        of = self.values
        numbers = ("", "", "") if of is None else (f"{of.first:.6g}", f"{of.low:.6g}", f"{of.high:.6g}")
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
    elif (step := _even_step(start)) is not None:
        remarks.append(f"rises evenly: {1 / step:.6g} Hz if it is the time in s")
    return "; ".join(remarks)


def _even_step(start: NDArray[Any]) -> float | None:
    """The median step of a signal that rises evenly, as a time or a counter does; None of any other."""
    t = np.squeeze(start)[:_MAX_TIMES] if start.size > 1 else start
    if t.ndim != 1 or len(t) < _MIN_TIMES or t.dtype.kind == "b" or not np.isfinite(t).all():
        return None
    steps = np.diff(np.asarray(t, dtype=np.float64))
    usual = float(np.median(steps))
    return usual if usual > 0 and np.all(np.abs(steps - usual) <= _MAX_UNEVENNESS * usual) else None
