"""Logs in HDF5: datasets by path, fields behind a dot; MATLAB 7.3, HDF5 with reversed axes and structs as groups."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.base.files import require_own_data
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.log import ArrayLog, StoredArray


def recognises(path: Path, head: bytes) -> bool:
    """True by the signature, at the start or behind a user block, the size of which is a power of two."""
    return any(head.startswith(b"\x89HDF\r\n\x1a\n", offset) for offset in (0, 512, 1024, 2048, 4096))


def recognises_matlab(path: Path, head: bytes) -> bool:
    """HDF5 with MATLAB's header in front of it."""
    return head.startswith(b"MATLAB") and recognises(path, head)


@contextmanager
def opened(path: Path, text: TextFormatSpec, is_matlab: bool = False) -> Iterator[ArrayLog]:
    """All datasets of another program's file, read when they are used; it holds its own data.

    MATLAB stores column-major, so that axes arrive reversed; members of structs are behind a dot.
    """
    import h5py

    with h5py.File(path, "r") as file:
        require_own_data(file)
        yield ArrayLog(path, dict(_datasets(file, "." if is_matlab else "/", is_matlab)))


def _datasets(group: Any, separator: str, is_transposed: bool, prefix: str = "") -> Iterator[tuple[str, StoredArray]]:
    """Name and array of every dataset, or field of a compound one, below a group; MATLAB's references are left out."""
    import h5py

    for key, item in group.items():
        name = f"{prefix}{key}"
        if isinstance(item, h5py.Group) and not key.startswith("#"):
            yield from _datasets(item, separator, is_transposed, f"{name}{separator}")
        elif isinstance(item, h5py.Dataset) and "MATLAB_object_decode" in item.attrs:
            continue  # an object of a class: the numbers refer to its members elsewhere
        elif isinstance(item, h5py.Dataset) and item.dtype.names is not None:
            yield from ((f"{name}.{field}", _stored(item, field, is_transposed)) for field in item.dtype.names)
        elif isinstance(item, h5py.Dataset):
            yield name, _stored(item, "", is_transposed)


def _stored(dataset: Any, field: str, is_transposed: bool) -> StoredArray:
    units = dataset.attrs.get("units", "")
    shape = tuple(dataset.shape or ())  # an empty dataset has none
    # MATLAB stores texts as numbers.
    is_text = dataset.attrs.get("MATLAB_class") == b"char"
    dtype = np.dtype(str) if is_text else dataset.dtype[field] if field else dataset.dtype
    read = partial(_read, dataset, field, is_transposed)
    units = units.decode() if isinstance(units, bytes) else str(units)
    return StoredArray(shape[::-1] if is_transposed else shape, dtype, read, units, rows=read)


def _read(dataset: Any, field: str, is_transposed: bool, part: slice | None = None) -> NDArray[Any]:
    index = () if part is None else (..., part) if is_transposed else part
    values = np.asarray((dataset.fields(field) if field else dataset)[index])
    return values.T if is_transposed else values
