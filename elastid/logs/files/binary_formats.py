"""Logs in formats of which libraries know the layout: HDF5, MATLAB, NumPy, Parquet, and TDMS."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.base.errors import require_package
from elastid.base.hdf5_check import check_self_contained
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.log import ArrayLog, StoredArray, seconds


@contextmanager
def open_matlab(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """Open MATLAB up to version 7 by SciPy: variables, members of structs behind a dot, cells in braces.

    Objects of classes are left out.
    """
    from scipy.io import loadmat

    variables = loadmat(path)
    values = {name: value for name, value in variables.items() if isinstance(name, str) and not name.startswith("__")}
    yield _in_memory(path, dict(leaf for name, value in values.items() for leaf in _leaves_of_matlab(name, value)))


def _in_memory(path: Path, arrays: Mapping[str, NDArray[Any]]) -> ArrayLog:
    return ArrayLog(path, {n: StoredArray(tuple(x.shape), x.dtype, partial(np.asarray, x)) for n, x in arrays.items()})


@contextmanager
def open_numpy(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """Open NumPy's .npz, all arrays, and .npy, one of the name of the file; fields of records behind a dot.

    Pickled objects are left out; dates and times are s from the first.
    """
    loaded, arrays = np.load(path), dict[str, NDArray[Any]]()
    for name in [path.stem] if isinstance(loaded, np.ndarray) else loaded.files:
        with suppress(ValueError):
            array = loaded if isinstance(loaded, np.ndarray) else loaded[name]
            fields = array.dtype.names
            arrays |= {f"{name}.{field}": array[field] for field in fields} if fields else {name: array}
    is_time = {name: x.dtype.kind in "mM" and x.size > 0 for name, x in arrays.items()}
    yield _in_memory(path, {name: seconds(x, x.flat[0]) if is_time[name] else x for name, x in arrays.items()})


def _leaves_of_matlab(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    from scipy.io.matlab import MatlabOpaque

    if isinstance(value, MatlabOpaque) or not isinstance(value, np.ndarray):
        return
    if value.dtype == object:
        for index, cell in enumerate(value.ravel(order="F"), start=1):
            yield from _leaves_of_matlab(f"{name}{{{index}}}", cell)
        return
    if value.dtype.names is None:
        yield name, value
        return
    for index, element in enumerate(value.ravel(order="F"), start=1):
        prefix = name if value.size == 1 else f"{name}({index})"
        for member in value.dtype.names:
            yield from _leaves_of_matlab(f"{prefix}.{member}", element[member])


@contextmanager
def open_parquet(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """Open Parquet, by pyarrow: all columns, each read alone when it is used, fields of structs behind a dot.

    A column of lists of one length is a matrix.  Missing values are NaN, time stamps s from the first.
    """
    parquet = require_package("pyarrow.parquet", "parquet", path)
    with parquet.ParquetFile(path) as file:
        n = file.metadata.num_rows
        leaves = [leaf for field in file.schema_arrow for leaf in _leaves_of_parquet(field.name, field)]
        yield ArrayLog(path, {name: _column(file, name, field, n) for name, field in leaves})


def _leaves_of_parquet(name: str, field: Any) -> Iterator[tuple[str, Any]]:
    from pyarrow import types

    if not types.is_struct(field.type):
        yield name, field
        return
    for member in field.type:
        yield from _leaves_of_parquet(f"{name}.{member.name}", member)


def _column(file: Any, name: str, field: Any, n: int) -> StoredArray:
    from pyarrow import types

    is_time = types.is_timestamp(field.type) or types.is_duration(field.type)
    is_number = types.is_integer(field.type) or types.is_floating(field.type) or types.is_boolean(field.type)
    # A column with missing values is read as float64, whatever its type.
    dtype = field.type.to_pandas_dtype() if types.is_floating(field.type) else np.float64
    unit = (field.metadata or {}).get(b"unit", b"") if is_number else b"s" if is_time else b""
    kind = np.dtype(dtype if is_number or is_time else object)
    shape: tuple[int, ...] = (n,)
    if types.is_fixed_size_list(field.type):
        shape, kind = (n, field.type.list_size), np.dtype(field.type.value_type.to_pandas_dtype())
    return StoredArray(shape, kind, partial(_read_column, file, name), unit.decode("utf-8", "replace"))


def _read_column(file: Any, name: str) -> NDArray[Any]:
    groups = [_values(file.read_row_group(i, columns=[name]), name) for i in range(file.num_row_groups)]
    values = np.concatenate(groups) if groups else np.zeros(0)
    return seconds(values, values[0]) if values.dtype.kind in "mM" else values


def _values(table: Any, name: str) -> NDArray[Any]:
    from pyarrow import types

    column = table.column(0).combine_chunks()
    for member in name.removeprefix(table.column_names[0]).strip(".").split("."):
        column = column.field(member) if member else column
    is_matrix = types.is_fixed_size_list(column.type)
    values = np.asarray((column.flatten() if is_matrix else column).to_numpy(zero_copy_only=False))
    return values.reshape(len(column), -1) if is_matrix else values


@contextmanager
def open_tdms(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """Open LabVIEW and DIAdem (TDMS), by npTDMS: channels with data, `group/channel`; time stamps in s from the first.

    Waveforms whose start times differ have times of their own, `group/channel/time`.
    """
    nptdms = require_package("nptdms", "tdms", path)
    with nptdms.TdmsFile.open(path) as file:
        channels = {f"{c.group_name}/{c.name}": c for group in file.groups() for c in group.channels() if len(c) > 0}
        arrays = {name: _channel(c) for name, c in channels.items()}
        waves = {n: c.properties for n, c in channels.items() if arrays[n].rate_hz and "wf_start_time" in c.properties}
        stamps = np.array([p["wf_start_time"] for p in waves.values()], "datetime64[us]")
        offsets_s = np.array([float(p.get("wf_start_offset", 0.0)) for p in waves.values()])
        starts = dict(zip(waves, (seconds(stamps, stamps[:1]) + offsets_s).tolist(), strict=True))
        for name, start_s in starts.items() if len({*starts.values()}) > 1 else ():
            rate_hz, n, first_s = arrays[name].rate_hz or 1.0, len(channels[name]), start_s - min(starts.values())
            times = partial(np.linspace, first_s, first_s + n / rate_hz, n, False)
            arrays[name] = replace(arrays[name], time=f"{name}/time")
            arrays[f"{name}/time"] = StoredArray((n,), np.dtype(np.float64), times, "s")
        yield ArrayLog(path, arrays)


def _channel(channel: Any) -> StoredArray:
    step = channel.properties.get("wf_increment", 0.0)
    is_time = channel.dtype.kind == "M"
    dtype = np.dtype(np.float64) if is_time else channel.dtype
    units = "s" if is_time else str(channel.properties.get("unit_string", ""))
    rows = partial(_read_channel, channel)
    return StoredArray((len(channel),), dtype, rows, units, 1 / step if step > 0 else None, rows=rows)


def _read_channel(channel: Any, span: slice = slice(None)) -> NDArray[Any]:
    values = np.asarray(channel[span])
    return seconds(values, channel[0]) if values.dtype.kind == "M" else values


@contextmanager
def open_hdf5(path: Path, text: TextFormatSpec, is_matlab: bool = False) -> Iterator[ArrayLog]:
    """Open all datasets of another program's file, read when they are used; it holds its own data.

    MATLAB stores column-major, so that axes arrive reversed; members of structs are behind a dot.
    """
    import h5py

    with h5py.File(path, "r") as file:
        check_self_contained(file)
        yield ArrayLog(path, dict(_datasets(file, "." if is_matlab else "/", is_matlab)))


def _datasets(group: Any, separator: str, is_transposed: bool, prefix: str = "") -> Iterator[tuple[str, StoredArray]]:
    """Yield name and array of every dataset, or compound field, below a group; cells of MATLAB by number."""
    import h5py

    for key, item in group.items():
        name = f"{prefix}{key}"
        if isinstance(item, h5py.Group) and not key.startswith("#"):
            yield from _datasets(item, separator, is_transposed, f"{name}{separator}")
        elif not isinstance(item, h5py.Dataset) or "MATLAB_object_decode" in item.attrs:
            continue  # an object of a class: the numbers refer to its members elsewhere
        elif is_transposed and item.attrs.get("MATLAB_class") == b"cell":
            cells = [item.file[reference] for reference in np.ravel(item[()])]
            whole = [(i, cell) for i, cell in enumerate(cells, start=1) if isinstance(cell, h5py.Dataset)]
            yield from ((f"{name}{{{i}}}", _dataset(cell, "", True)) for i, cell in whole if cell.dtype.kind in "fiu")
        elif item.dtype.names is not None:
            yield from ((f"{name}.{field}", _dataset(item, field, is_transposed)) for field in item.dtype.names)
        else:
            yield name, _dataset(item, "", is_transposed)


def _dataset(dataset: Any, field: str, is_transposed: bool) -> StoredArray:
    units = dataset.attrs.get("units", "")
    shape = tuple(dataset.shape or ())  # an empty dataset has none
    # MATLAB stores texts as numbers.
    is_text = dataset.attrs.get("MATLAB_class") == b"char"
    dtype = np.dtype(str) if is_text else dataset.dtype[field] if field else dataset.dtype
    rows = partial(_read_dataset, dataset, field, is_transposed)
    units = units.decode() if isinstance(units, bytes) else str(units)
    return StoredArray(shape[::-1] if is_transposed else shape, dtype, rows, units, rows=rows)


def _read_dataset(dataset: Any, field: str, is_transposed: bool, span: slice | None = None) -> NDArray[Any]:
    index = () if span is None else (..., span) if is_transposed else span
    values = np.asarray((dataset.fields(field) if field else dataset)[index])
    return values.T if is_transposed else values
