"""Logs in Parquet files, by pyarrow: columns by their name, fields of structs behind a dot."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.log import ArrayLog, StoredArray, imported, seconds


def recognises(path: Path, head: bytes) -> bool:
    """True by the mark at the start."""
    return head.startswith(b"PAR1")


@contextmanager
def opened(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """All columns, each read alone when it is used; missing values are NaN, time stamps s from the first."""
    parquet = imported("pyarrow.parquet", path, "a Parquet file", "parquet")
    with parquet.ParquetFile(path) as file:
        n = file.metadata.num_rows
        leaves = [leaf for field in file.schema_arrow for leaf in _leaves(field.name, field)]
        yield ArrayLog(path, {name: _stored(file, name, field, n) for name, field in leaves})


def _leaves(name: str, field: Any) -> Iterator[tuple[str, Any]]:
    from pyarrow import types

    if not types.is_struct(field.type):
        yield name, field
        return
    for member in field.type:
        yield from _leaves(f"{name}.{member.name}", member)


def _stored(file: Any, name: str, field: Any, n: int) -> StoredArray:
    from pyarrow import types

    is_time = types.is_timestamp(field.type)
    is_number = types.is_integer(field.type) or types.is_floating(field.type) or types.is_boolean(field.type)
    # A column with missing values is read as float64, whatever its type.
    dtype = field.type.to_pandas_dtype() if types.is_floating(field.type) else np.float64
    unit = (field.metadata or {}).get(b"unit", b"") if is_number else b"s" if is_time else b""
    kind = np.dtype(dtype if is_number or is_time else object)
    return StoredArray((n,), kind, partial(_read, file, name), unit.decode("utf-8", "replace"))


def _read(file: Any, name: str) -> NDArray[Any]:
    """A column, one row group in memory at a time in addition to the result."""
    parts = [_values(file.read_row_group(i, columns=[name]), name) for i in range(file.num_row_groups)]
    values = np.concatenate(parts) if parts else np.zeros(0)
    return seconds(values, values[0]) if values.dtype.kind == "M" else values


def _values(table: Any, name: str) -> NDArray[Any]:
    column = table.column(0).combine_chunks()
    for member in name.removeprefix(table.column_names[0]).strip(".").split("."):
        column = column.field(member) if member else column
    return np.asarray(column.to_numpy(zero_copy_only=False))
