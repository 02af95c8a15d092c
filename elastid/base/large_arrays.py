"""Arrays in files: mapped and shared between processes, or read by rows if they are too large for memory."""

import mmap
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, cast
from weakref import WeakValueDictionary, finalize

import numpy as np
from numpy.typing import NDArray

MIN_LARGE_VALUES = 1 << 25  # larger arrays are not read into memory
PIECE_VALUES = 1 << 20  # values that are read from a file at once
MIN_MAPPED_BYTES, MIN_LARGE_FILE = 1 << 15, 1 << 26  # a smaller array of this size is mapped if its file is large


@dataclass(frozen=True, eq=False)
class LargeArray:
    """An array (n, c) too large for memory: x[a:b] reads these rows, in double precision.

    dtype: of the numbers in the file.  rows(first, end): reads these rows.
    """

    shape: tuple[int, int]
    dtype: np.dtype[Any]
    rows: Callable[[int, int], NDArray[Any]]

    @property
    def size(self) -> int:
        """Number of values."""
        return self.shape[0] * self.shape[1]

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, index: Any) -> Any:
        rows, *columns = index if isinstance(index, tuple) else (index,)
        if not isinstance(rows, slice) or (rows.step or 1) < 0:
            return np.asarray(self)[index]
        first, last, step = rows.indices(len(self))
        return np.asarray(self.rows(first, max(first, last)), dtype=np.float64)[(slice(None, None, step), *columns)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self.rows(0, len(self)), dtype=dtype or np.float64)

    def copy(self) -> NDArray[np.float64]:
        """Read the whole array into memory."""
        return np.array(self)


def empty_in_file(shape: tuple[int, ...], dtype: Any = np.float64) -> NDArray[np.float64]:
    """Create an array in a temporary file (folder: TMPDIR), which is deleted with the array."""
    with tempfile.TemporaryFile() as file:
        return np.memmap(file, dtype=dtype, mode="w+", shape=shape)


def release(array: NDArray[Any] | LargeArray | None) -> None:
    """Release the memory of an array in a file, which keeps its values; an array in memory stays as it is."""
    pages = getattr(array, "_mmap", None)
    if pages is not None and hasattr(mmap, "MADV_DONTNEED"):
        # The system keeps written pages, because the mapping is shared.
        pages.madvise(mmap.MADV_DONTNEED)


def mean_of_rows(array: NDArray[np.float64] | LargeArray, n: int) -> NDArray[np.float64]:
    """Return the mean (c,) of the first n rows."""
    if not isinstance(array, LargeArray):
        return np.asarray(array[:n].mean(axis=0))
    step = max(1, PIECE_VALUES // array.shape[1])
    return np.asarray(sum(array[first : min(n, first + step)].sum(axis=0) for first in range(0, n, step)) / n)


class FileArray(np.memmap):
    """A read-only array at an offset of a file. A file is mapped once for all of its arrays.

    Another process, on the same file system, receives path and offset instead of the values.
    """

    location: tuple[Path, int]
    folder: Path

    @classmethod
    def at(cls, path: Path, offset: int, dtype: np.dtype[Any], shape: tuple[int, ...]) -> "FileArray":
        """Return the array of a shape at an offset in bytes of a file."""
        content = path.stat()
        array = cls.within(_pages(path, content.st_ino, content.st_mtime_ns), offset, dtype, shape)
        array.location, array.folder = (path, offset), path.parent
        return array

    @classmethod
    def within(cls, pages: mmap.mmap, offset: int, dtype: np.dtype[Any], shape: tuple[int, ...]) -> "FileArray":
        """Return the array of a shape at an offset in bytes of the mapped file."""
        array = np.ndarray.__new__(cls, shape, dtype, buffer=pages, offset=offset)
        array._mmap = pages  # type: ignore[attr-defined]
        return array

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        """Return results of arithmetic as arrays in memory."""
        plain = np.asarray(array)
        return plain[()] if return_scalar else plain

    def __reduce__(self) -> Any:
        """Pickle path and offset; for a temporary file or a slice, which has no location, the values."""
        if hasattr(self, "location"):
            return FileArray.at, (*self.location, self.dtype, self.shape)
        values = np.array(self)
        return (move_to_file, (self.folder, values)) if hasattr(self, "folder") else values.__reduce__()


SHARED_FILE_BYTES = 1 << 28  # arrays share files, since each file needs a descriptor


class _SharedFile:
    """An unnamed temporary file of arrays; deleted with its last array or at the end of the process."""

    def __init__(self, folder: Path, size: int) -> None:
        self.file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 (as long as its arrays)
        finalize(self, self.file.close)
        self.file.truncate(size)
        self.pages, self.end = mmap.mmap(self.file.fileno(), size, access=mmap.ACCESS_READ), 0

    def add(self, values: NDArray[Any]) -> FileArray:
        """Add a copy; OSError on a full disk. (A write to mapped pages would end the process instead.)"""
        data, n_written = values.reshape(-1).view(np.uint8).data, 0
        while n_written < len(data):
            n_written += os.pwrite(self.file.fileno(), data[n_written:], self.end + n_written)
        array = FileArray.within(self.pages, self.end, values.dtype, values.shape)
        self.end += -(-values.nbytes // mmap.PAGESIZE) * mmap.PAGESIZE
        return array


# The last shared file by process and folder, until its last array is deleted.
_SHARED_FILES: WeakValueDictionary[tuple[int, Path], _SharedFile] = WeakValueDictionary()


def move_beside(source: NDArray[Any] | None, values: NDArray[Any]) -> NDArray[Any]:
    """Move values, read-only, into a temporary file beside the file of `source`; no change if `source` is in memory."""
    folder = getattr(source, "folder", None)
    return values if folder is None else move_to_file(folder, values)


def move_to_file(folder: Path, values: NDArray[Any]) -> NDArray[Any]:
    """Move values, read-only, into a temporary file of a folder; return `values` themselves if this is impossible."""
    if not hasattr(mmap, "MADV_DONTNEED"):
        return values
    values, key = np.ascontiguousarray(values), (os.getpid(), folder)
    try:
        shared = _SHARED_FILES.get(key)
        if shared is None or shared.end + values.nbytes > len(shared.pages):
            shared = _SHARED_FILES[key] = _SharedFile(folder, max(SHARED_FILE_BYTES, values.nbytes))
        array = shared.add(values)
    except OSError:
        return values
    array.folder, array.shared_file = folder, shared  # type: ignore[attr-defined]  # keeps the file open
    return array


@lru_cache(maxsize=4)
def _pages(path: Path, inode: int, mtime_ns: int) -> mmap.mmap:
    """Map a file in its present version; a later replacement is a different file."""
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def map_dataset(path: Path, dataset: Any) -> NDArray[np.float64] | None:
    """Map a large contiguous dataset of an HDF5 file at its offset; None for any other dataset."""
    offset, shape, dtype = dataset.id.get_offset(), dataset.shape, dataset.dtype
    is_in_large_file = dataset.nbytes >= MIN_MAPPED_BYTES and path.stat().st_size >= MIN_LARGE_FILE
    if offset is None or not (is_in_large_file or dataset.size >= MIN_LARGE_VALUES):
        return None
    if dtype == np.float32 and len(shape) == 2:
        rows = partial(_read_single_precision, path, offset, shape[1])
        return cast(NDArray[np.float64], LargeArray(shape, dtype, rows))
    return FileArray.at(path.resolve(), offset, dtype, shape) if dtype in (np.float64, np.complex128) else None


def _read_single_precision(path: Path, offset: int, columns: int, first: int, last: int) -> NDArray[Any]:
    """Read rows of a table of single precision that starts at an offset of a file."""
    values = np.fromfile(path, np.float32, (last - first) * columns, offset=offset + 4 * columns * first)
    return values.reshape(last - first, columns)
