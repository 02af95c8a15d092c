"""Log files of other programs: the signals in a MATLAB, HDF5 or text file, by the names that they have there.

MATLAB: variables, members of structs with dots (`rec.torque`), elements of struct arrays as `run(2).torque`, of cells
as `run{2}`.
HDF5: paths (`axis1/torque`), fields of compound datasets with dots.  Text: the headings of the columns.
"""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.experiment.specs.recorded import ChannelSpec, TextFormatSpec
from elastid.recorded.files.text import TextLog, open_text, otherwise_written

Arrays: TypeAlias = Mapping[str, Any]
_LISTED = 40


def contents(path: Path, text: TextFormatSpec) -> dict[str, tuple[int, ...]]:
    """Every numeric signal of a log file, by name, with its shape; a text log without headings: its column numbers."""
    with opened_log(path, text) as log:
        if isinstance(log, TextLog):
            names = log.headings or tuple(f"column {i + 1}" for i in range(log.n_columns))
            return {name: (len(log.number_lines) - log.first,) for name in names}
        return {name: tuple(array.shape) for name, array in log.items() if _is_signal(array)}


def read_channels(path: Path, channels: Sequence[ChannelSpec], text: TextFormatSpec) -> FloatArray:
    """The file's values (n_samples, len(channels)) of the channels asked for, as they stand in the file.

    Raises StudyError for a file that is not there and DataError for a channel that is not in it (naming those that
    are), not numeric, of another length than the others, or of a column that it does not have.
    """
    with opened_log(path, text) as log:
        if isinstance(log, TextLog):
            return log.columns([_text_column(log, channel) for channel in channels])
        signals = [_signal(path, log, channel) for channel in channels]
    lengths = [len(signal) for signal in signals]
    if len(set(lengths)) > 1:
        table = ", ".join(f"{name_in_file(c)} {n}" for c, n in zip(channels, lengths, strict=True))
        raise DataError(f"{path}: the channels differ in length: {table} samples; all must come from one recording")
    return np.stack(signals, axis=1)


def name_in_file(channel: ChannelSpec) -> str:
    """How messages name a channel: as it is called in the file."""
    column = "" if channel.column is None else f"column {channel.column}"
    return " ".join(filter(None, (channel.channel, column)))


@contextmanager
def opened_log(path: Path, text: TextFormatSpec) -> Iterator[Arrays | TextLog]:
    """Everything in a log file: arrays by name, read when they are used, or the lines of a text log."""
    if not path.is_file():
        raise StudyError(f"log file {path} is not there; check path under files (it counts from the study's folder)")
    with path.open("rb") as file:
        head = file.read(520)
    signature = b"\x89HDF\r\n\x1a\n"
    if signature in (head[:8], head[512:]):
        # The only h5py beside the store's: these are logs of other programs.
        import h5py

        try:
            with h5py.File(path, "r") as hdf5:
                yield dict(_datasets(hdf5, "", is_matlab=head.startswith(b"MATLAB")))
        except OSError as error:
            raise DataError(f"{path}: damaged or cut short ({error}); copy or export it again") from None
    elif path.suffix.lower() == ".mat" or head.startswith(b"MATLAB"):
        yield dict(_matlab_variables(path))
    else:
        yield open_text(path, text)


def _matlab_variables(path: Path) -> Iterator[tuple[str, Any]]:
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings():
            # Files with several objects of classes make SciPy warn of "duplicate variable None"; objects are skipped.
            warnings.simplefilter("ignore")
            variables = loadmat(path)
    except Exception as error:  # SciPy raises whatever a damaged file leads it to
        raise DataError(f"{path}: not a MATLAB file that can be read ({error}); save it again with -v7") from None
    for name, value in variables.items():
        if isinstance(name, str) and not name.startswith("__"):
            yield from _matlab_leaves(name, value)


def _matlab_leaves(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    from scipy.io.matlab import MatlabOpaque

    if isinstance(value, MatlabOpaque):
        return
    if value.dtype == object:
        for index, cell in enumerate(value.ravel(order="F"), start=1):
            yield from _matlab_leaves(f"{name}{{{index}}}", cell)
        return
    if value.dtype.names is None:
        yield name, value
        return
    for index, element in enumerate(value.ravel(order="F"), start=1):
        prefix = name if value.size == 1 else f"{name}({index})"
        for member in value.dtype.names:
            yield from _matlab_leaves(f"{prefix}.{member}", element[member])


@dataclass(frozen=True)
class _Dataset:
    """An HDF5 dataset, or one field of it, that is read when it is used."""

    dataset: Any
    field: str
    is_matlab: bool

    @property
    def dtype(self) -> Any:
        return self.dataset.dtype[self.field] if self.field else self.dataset.dtype

    @property
    def units(self) -> str:
        units = self.dataset.attrs.get("units", "")
        return units.decode() if isinstance(units, bytes) else str(units)

    @property
    def shape(self) -> tuple[int, ...]:
        # MATLAB stores column-major: its axes arrive reversed. An empty dataset has no shape.
        shape = tuple(self.dataset.shape or ())
        return shape[::-1] if self.is_matlab else shape

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        values = self.dataset.fields(self.field)[()] if self.field else self.dataset[()]
        return np.array(values.T if self.is_matlab else values, dtype=dtype)


def _datasets(group: Any, prefix: str, is_matlab: bool) -> Iterator[tuple[str, _Dataset]]:
    import h5py

    for key, item in group.items():
        name = f"{prefix}{key}"
        if isinstance(item, h5py.Group) and not key.startswith("#"):
            yield from _datasets(item, f"{name}{'.' if is_matlab else '/'}", is_matlab)
        elif isinstance(item, h5py.Dataset) and item.dtype.names is not None:
            yield from ((f"{name}.{field}", _Dataset(item, field, is_matlab)) for field in item.dtype.names)
        elif isinstance(item, h5py.Dataset):
            yield name, _Dataset(item, "", is_matlab)


def _is_signal(array: Any) -> bool:
    return array.dtype.kind in "fiub" and len(array.shape) > 0 and max(array.shape) > 1


def _signal(path: Path, log: Arrays, channel: ChannelSpec) -> FloatArray:
    name = channel.channel.strip("/")
    signals = {key: array for key, array in log.items() if _is_signal(array)}
    if not name and len(signals) == 1:
        (name,) = signals
    if name not in log:
        raise DataError(_missing(path, channel, {key: tuple(array.shape) for key, array in signals.items()}))
    if name not in signals:
        raise DataError(
            f"{path}: channel {name} is no signal but {log[name].dtype} of shape {tuple(log[name].shape)}; "
            f"there are {', '.join(signals)}"
        )
    array = np.squeeze(np.asarray(log[name], dtype=np.float64))
    if array.ndim > 2:
        raise DataError(f"{path}: channel {name} has {array.ndim} axes {array.shape}; one or two can be read")
    # Samples outnumber signals: a matrix with its samples along a row is turned.
    matrix = np.atleast_2d(array).T if array.ndim == 1 or array.shape[0] < array.shape[1] else array
    n, columns = matrix.shape
    if channel.column is None and columns > 1:
        raise DataError(
            f"{path}: channel {name} holds {columns} signals of {n} samples; say which with column: 1 to {columns}"
        )
    if channel.column is not None and channel.column > columns:
        raise DataError(
            f"{path}: channel {name} has no column {channel.column}; it has {columns}, the first is column 1"
        )
    column: FloatArray = matrix[:, (channel.column or 1) - 1]
    return column


def _text_column(log: TextLog, channel: ChannelSpec) -> int:
    column = channel.column
    if channel.channel and (log.headings or column is None):
        headed = [i for i, heading in enumerate(log.headings, start=1) if heading == channel.channel]
        if not headed:
            raise DataError(_not_headed(log, channel))
        if column not in (headed if len(headed) > 1 else (None, *headed)):
            listed = ", ".join(map(str, headed))
            raise DataError(
                f"{log.path}: '{channel.channel}' is the heading of column {listed}; say which one with column"
                if column is None
                else f"{log.path}: column {column} is not headed '{channel.channel}', but column {listed} is"
            )
        return (column or headed[0]) - 1
    column = column or 1
    if column > log.n_columns:
        raise DataError(f"{log.path}: there is no column {column}; it has {log.n_columns}, the first is column 1")
    return column - 1


def _not_headed(log: TextLog, channel: ChannelSpec) -> str:
    """What is in a text log instead of a channel, and where its data were taken to start."""
    rows = len(log.number_lines) - log.first
    names = log.headings or tuple(f"column: {i + 1}" for i in range(log.n_columns))
    start = f"; data were taken to start in line {log.first + 1} (text.header_lines says otherwise)"
    return _missing(log.path, channel, dict.fromkeys(names, (rows,))) + start + otherwise_written(log.path, log.format)


def _missing(path: Path, channel: ChannelSpec, shapes: Mapping[str, tuple[int, ...]]) -> str:
    listed = [f"{name} ({' x '.join(str(n) for n in shape)})" for name, shape in shapes.items()]
    more = f" and {len(listed) - _LISTED} more" if len(listed) > _LISTED else ""
    close = difflib.get_close_matches(channel.channel, shapes, n=1)
    hint = f"did you mean {close[0]}? " if close else ""
    what = f"channel '{channel.channel}' is not in it" if channel.channel else "give the name of a channel"
    return f"{path}: {what}; {hint}There are {', '.join(listed[:_LISTED])}{more}"
