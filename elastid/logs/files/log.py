"""An open log file of another program, and its signals by their names in the file.

Every reader gives a `Log`.  Readers of formats that hold named arrays give an `ArrayLog`: names of members of structs
are joined with dots (`rec.torque`), elements of struct arrays are `run(2).torque`, of cells `run{2}`, HDF5 paths
`axis1/torque`.
"""

import difflib
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.logs.headings import is_time

# Values that are in memory at a time.
_BLOCK_VALUES = 1 << 20


class Log(Protocol):
    """An open log file."""

    @property
    def arrays(self) -> "Mapping[str, StoredArray]":
        """Arrays by name; empty for a text file."""
        return {}

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return every numeric signal with its shape; column numbers where a text has no headings."""

    def values(self, channels: Sequence[ChannelSpec], span: slice = slice(None)) -> FloatArray:
        """Return raw values (n_samples, n_c) of the channels, or of a range of samples.

        DataError where one cannot be read; no more is read or understood than the format needs.
        """

    def time_of(self, channel: ChannelSpec) -> str:
        """Return the name of the array with a channel's time stamps, empty if the format states none."""
        return ""


@dataclass(frozen=True)
class StoredArray:
    """An array of a file, read when it is used.

    units: as the file states them, or an empty text.  rate_hz: likewise, or None.  rows: reads a part of the first
    axis, in formats that can.  time: name of the array with its stamps in s, by one clock for all, or an empty text.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    read: Callable[[], NDArray[Any]]
    units: str = ""
    rate_hz: float | None = None
    rows: Callable[[slice], NDArray[Any]] | None = None
    time: str = ""

    @property
    def is_signal(self) -> bool:
        """True if it holds several numbers."""
        return self.dtype.kind in "fiub" and len(self.shape) > 0 and max(self.shape) > 1

    @property
    def text(self) -> str:
        """Text of a cell; MATLAB 7.3 files hold characters as numbers."""
        values = np.ravel(np.asarray(self))
        return "".join(chr(v) if values.dtype.kind in "ui" else str(v) for v in values).strip()

    def blocks(self) -> Iterator[NDArray[Any]]:
        """Yield the values in pieces along the first axis, or in one where the format cannot be read in pieces."""
        if self.rows is None or len(self.shape) == 0:
            yield self.read()
            return
        n = max(1, _BLOCK_VALUES * self.shape[0] // max(1, math.prod(self.shape)))
        for start in range(0, self.shape[0], n):
            yield self.rows(slice(start, start + n))

    @property
    def has_pieces(self) -> bool:
        """True if a part of its samples, along the first axis, can be read alone."""
        return self.rows is not None and self.shape[0] == max(self.shape)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.read(), dtype)


@dataclass(frozen=True)
class ArrayLog:
    """A log of named arrays."""

    path: Path
    arrays: Mapping[str, StoredArray]

    def guarded(self, guard: Callable[[], AbstractContextManager[None]]) -> "ArrayLog":
        """Return log in which every read runs under a guard."""

        def read_guarded(read: Callable[..., NDArray[Any]], *span: slice) -> NDArray[Any]:
            with guard():
                return read(*span)

        def guarded(array: StoredArray) -> StoredArray:
            rows = None if array.rows is None else partial(read_guarded, array.rows)
            return replace(array, read=partial(read_guarded, array.read), rows=rows)

        return ArrayLog(self.path, {name: guarded(array) for name, array in self.arrays.items()})

    def with_times(self) -> "ArrayLog":
        """Return log whose signals have the time of their length, in their group or else in the file, among several."""
        lengths = {name: array.shape[0] for name, array in self.arrays.items() if array.is_signal and is_time(name)}

        def timed(name: str, array: StoredArray) -> StoredArray:
            alike = [t for t, n in lengths.items() if array.is_signal and n == array.shape[0] and name not in lengths]
            same_group = [t for t in alike if re.split(r"[/.][^/.]*$", t)[0] == re.split(r"[/.][^/.]*$", name)[0]]
            times = same_group if len(same_group) == 1 else alike
            return replace(array, time=times[0]) if len(times) == 1 and not array.time else array

        return replace(self, arrays={n: timed(n, a) for n, a in self.arrays.items()}) if len(lengths) > 1 else self

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return every numeric signal with its shape."""
        return {name: array.shape for name, array in self.arrays.items() if array.is_signal}

    def values(self, channels: Sequence[ChannelSpec], span: slice = slice(None)) -> FloatArray:
        """Return values (n_samples, n_c) of the channels, or a part of the samples.

        Raises DataError for a channel that is missing, not numeric, of another length, or without the stated column.
        """
        cache: dict[str, FloatArray] = {}  # an array that holds several channels is read once
        signals = [self._signal(channel, span, cache) for channel in channels]
        lengths = [len(signal) for signal in signals]
        if len(set(lengths)) > 1:
            table = ", ".join(f"{c.name_in_file} {n}" for c, n in zip(channels, lengths, strict=True))
            advice = "Choose channels of one recording, or state rate_hz of those at another rate"
            raise self._error(f"the channels have different lengths: {table} samples. {advice}")
        return np.stack(signals).T  # each signal in one piece, as all that follows takes them

    def time_of(self, channel: ChannelSpec) -> str:
        """Return the name of the array with a channel's time stamps, empty if the format states none."""
        return self.array_of(channel)[1].time

    def array_of(self, channel: ChannelSpec) -> tuple[str, StoredArray]:
        """Return name and array that hold a channel; DataError where it is missing or no signal."""
        name, shapes = channel.channel.strip("/"), self.shapes()
        name = next(iter(shapes)) if not name and len(shapes) == 1 else name
        if not name and 0 < (channel.column or 0) <= len(shapes):  # the number of a signal
            name = list(shapes)[(channel.column or 1) - 1]
        if name not in self.arrays:
            raise DataError("records/channels", missing_channel_text(self.path, channel, shapes))
        if name not in shapes:
            kind = f"not a signal but {self.arrays[name].dtype} of shape {self.arrays[name].shape}"
            raise self._error(f"channel {name} is {kind}; there are {', '.join(shapes) or 'none'}")
        return name, self.arrays[name]

    def _signal(self, channel: ChannelSpec, span: slice, cache: dict[str, FloatArray]) -> FloatArray:
        name, array = self.array_of(channel)
        if not channel.channel and len(self.shapes()) > 1:
            channel = replace(channel, channel=name, column=None)
        is_range = span != slice(None) and array.rows is not None and array.has_pieces
        if name not in cache:
            values = array.rows(span) if is_range and array.rows is not None else np.squeeze(np.asarray(array))
            cache[name] = np.asarray(values, np.float64)
        values = cache[name]
        if is_range:
            # A piece may hold fewer samples than signals.
            return self._column(channel, name, values.reshape(len(values), -1))
        if values.ndim > 2:
            problem = f"channel {name} has {values.ndim} axes {values.shape}; at most 2 are allowed"
            raise self._error(f"{problem}. Choose another variable")
        # Samples outnumber signals: a matrix with its samples along a row is transposed.
        matrix = np.atleast_2d(values).T if values.ndim == 1 or values.shape[0] < values.shape[1] else values
        return self._column(channel, name, matrix)[span]

    def _column(self, channel: ChannelSpec, name: str, matrix: FloatArray) -> FloatArray:
        n, columns = matrix.shape
        if 0 in matrix.shape:
            raise self._error(f"channel {name} contains no samples. Measure again")
        if channel.column is None and columns > 1:
            text = f"channel {name} contains {columns} signals of {n} samples"
            raise self._error(f"{text}. Give column: 1 to {columns}")
        column = channel.column or 1
        if column > columns:
            raise self._error(f"channel {name} has {columns} columns, counted from 1, not {column}. Correct column")
        return matrix[:, column - 1]

    def _error(self, text: str) -> DataError:
        return DataError("records/channels", text, self.path)


def missing_channel_text(path: Path, channel: ChannelSpec, shapes: Mapping[str, tuple[int, ...]]) -> str:
    """Return the message about a channel that is not in a file, with those that are."""
    names = [f"{name} ({' x '.join(str(n) for n in shape)})" for name, shape in shapes.items()]
    rest_text = f" and {len(names) - 40} more" if len(names) > 40 else ""
    close = difflib.get_close_matches(channel.channel, shapes, n=1)
    hint = f"did you mean {close[0]}? " if close else ""
    problem = f"there is no channel '{channel.channel}'" if channel.channel else "give the name of a channel"
    return f"{path}: {problem}; {hint}There are {', '.join(names[:40]) or 'no signals in it'}{rest_text}"


def seconds(stamps: NDArray[Any], first: Any) -> FloatArray:
    """Return dates and times (n,) as s from the first one; missing ones are NaN."""
    return np.asarray((stamps - first) / np.timedelta64(1, "s"), np.float64)
