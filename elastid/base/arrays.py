"""Array types of signatures, frozen values with labelled fields, arrays kept in a file, an array in a few numbers."""

import mmap
import os
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, cast, dataclass_transform
from weakref import WeakValueDictionary, finalize

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Label:
    """Meaning of a field and where its numbers stand.

    unit: SI, `{name}` in it being an attribute of the value or of one that contains it; by default that of the ending
    of the field's name (_hz, _s).  axes: one name a dimension, of a field or property that holds the values along
    it, or of an index.  rows: a tuple or mapping of values with arrays is a table, whose columns are stacked.
    entry: attribute that names each value of a tuple.
    """

    text: str = ""
    unit: str = ""
    axes: tuple[str, ...] = ()
    rows: bool = False
    entry: str = ""


NO_LABEL = Label()
_UNIT_OF_ENDING = {"hz": "Hz", "s": "s", "deg": "deg", "degc": "degC", "db": "dB"}


def labelled(
    text: str = "", unit: str = "", axes: str = "", rows: bool = False, entry: str = "", **default: Any
) -> Any:
    """Declare a dataclass field with a label: `x: FloatArray = labelled("angle", "rad", "time_s inputs")`.

    axes: names with a space between them.  default: as of `dataclasses.field`.
    """
    return field(metadata={"label": Label(text, unit, tuple(axes.split()), rows, entry)}, **default)


def unit_of_name(name: str) -> str:
    """Return the unit in the ending of a name.

    >>> unit_of_name("rate_hz"), unit_of_name("message")
    ('Hz', '')
    """
    return _UNIT_OF_ENDING.get(name.rpartition("_")[2], "") if "_" in name else ""


FloatArray: TypeAlias = NDArray[np.float64]
ComplexArray: TypeAlias = NDArray[np.complex128]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]


def laplace_variable(freq_hz: NDArray[np.floating[Any]]) -> ComplexArray:
    """Return s = 2 pi j f in rad/s, of the shape of the frequencies."""
    return (2j * np.pi * freq_hz).astype(np.complex128)


def quotient(a: FloatArray | float, b: FloatArray, otherwise: float = 0.0) -> FloatArray:
    """Return a / b where b is positive, else `otherwise`."""
    out = np.full(np.broadcast_shapes(np.shape(a), b.shape), otherwise)
    return np.asarray(np.divide(a, b, out=out, where=b > 0))


Signals = TypeVar("Signals", FloatArray, ComplexArray)


def folded(x: Signals, N: int) -> Signals:
    """Return X (P, N, ...): whole pieces of N rows each of x (n, ...), without the rest at the end."""
    P = len(x) // N
    return x[: P * N].reshape(P, N, *x.shape[1:])


def named(names: Iterable[str], values: FloatArray) -> dict[str, float]:
    """Return numbers (n,) by their names."""
    return dict(zip(names, values.tolist(), strict=True))


def frozen(array: Any, dtype: Any = np.float64) -> NDArray[Any]:
    """Return a read-only copy of an array, or itself if it is read-only: such a copy, part of one, or mapped."""
    if isinstance(array, LargeArray):
        return cast("NDArray[Any]", array)
    if isinstance(array, np.ndarray) and not array.flags.writeable and array.dtype == dtype:
        owner = array if array.base is None else array.base
        is_plain = type(array) is type(owner) is np.ndarray and owner.flags.owndata and not owner.flags.writeable
        if is_plain or isinstance(array, np.memmap):
            return cast("NDArray[Any]", array)
    copy = np.array(array, dtype=dtype)
    copy.flags.writeable = False
    return copy


_DTYPES: dict[str, type] = {
    "FloatArray": np.float64,
    "ComplexArray": np.complex128,
    "BoolArray": np.bool_,
    "IntArray": np.int64,
}
# Annotations are strings in modules with `from __future__ import annotations` and types in all others.
_DTYPES |= {str(NDArray[dtype]): dtype for dtype in [*_DTYPES.values()]}  # type: ignore[valid-type]
T = TypeVar("T")


@dataclass_transform(frozen_default=True, field_specifiers=(field, labelled))
def frozen_value(cls: Any = None, /, *, eq: bool = True) -> Any:
    """Make a frozen dataclass whose array fields are read-only copies, made before its `__post_init__`.

    An array field is one annotated FloatArray, ComplexArray, BoolArray or IntArray, alone or with `| None`; the
    annotation gives the dtype.
    """

    def decorated(cls: type[T]) -> type[T]:
        """Return the class, with arrays checked and frozen after every construction."""
        names = {name: _DTYPES.get(str(text).removesuffix(" | None")) for name, text in cls.__annotations__.items()}
        arrays = {name: dtype for name, dtype in names.items() if dtype is not None}
        check: Callable[[T], None] | None = getattr(cls, "__post_init__", None)

        def freeze(self: T) -> None:
            for name, dtype in arrays.items():
                value = getattr(self, name)
                if value is not None:
                    object.__setattr__(self, name, frozen(value, dtype))
            if check is not None:
                check(self)

        cls.__post_init__ = freeze  # type: ignore[attr-defined]
        return dataclass(frozen=True, eq=eq)(cls)

    return decorated if cls is None else decorated(cls)


# Larger arrays are kept in files, and worked on in pieces of so many values.
MIN_LARGE_VALUES = 1 << 25
PIECE_VALUES = 1 << 20
# And those of so many bytes of a file that is this large in all.
MIN_PART_BYTES, MIN_LARGE_FILE = 1 << 15, 1 << 26


@dataclass(frozen=True, eq=False)
class LargeArray:
    """An array (n, c) too large for memory: x[a:b] reads these rows, in double precision.

    dtype: of the numbers as they are stored.  rows: the rows from a first to before a last one.
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
        part, *columns = index if isinstance(index, tuple) else (index,)
        if not isinstance(part, slice) or (part.step or 1) < 0:
            return np.asarray(self)[index]
        first, last, step = part.indices(len(self))
        return np.asarray(self.rows(first, max(first, last)), dtype=np.float64)[(slice(None, None, step), *columns)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self.rows(0, len(self)), dtype=dtype or np.float64)

    def copy(self) -> FloatArray:
        """Read the whole array into memory."""
        return np.array(self)


def empty_in_file(shape: tuple[int, ...], dtype: Any = np.float64) -> FloatArray:
    """Create an array to fill, in a temporary file that is deleted with it (in the folder that TMPDIR names)."""
    with tempfile.TemporaryFile() as file:
        return np.memmap(file, dtype=dtype, mode="w+", shape=shape)


def release(array: NDArray[Any] | LargeArray | None) -> None:
    """Give the memory of an array in a file back, which keeps its values; nothing happens to an array in memory."""
    pages = getattr(array, "_mmap", None)
    if pages is not None and hasattr(mmap, "MADV_DONTNEED"):
        # Pages that were written stay with the system: the mapping is shared.
        pages.madvise(mmap.MADV_DONTNEED)


def mean_of_rows(array: FloatArray | LargeArray, n: int) -> FloatArray:
    """Return the mean (c,) of the first n rows."""
    if not isinstance(array, LargeArray):
        return np.asarray(array[:n].mean(axis=0))
    step = max(1, PIECE_VALUES // array.shape[1])
    return np.asarray(sum(array[first : min(n, first + step)].sum(axis=0) for first in range(0, n, step)) / n)


class FileArray(np.memmap):
    """A read-only array in its place in a file, which is mapped once for all of its arrays.

    To another process, which must see the same file, only its place goes.
    """

    place: tuple[Path, int]
    folder: Path

    @classmethod
    def at(cls, path: Path, offset: int, dtype: np.dtype[Any], shape: tuple[int, ...]) -> "FileArray":
        """Return the array of a shape at an offset in bytes of a file."""
        content = path.stat()
        array = cls.within(_pages(path, content.st_ino, content.st_mtime_ns), offset, dtype, shape)
        array.place, array.folder = (path, offset), path.parent
        return array

    @classmethod
    def within(cls, pages: mmap.mmap, offset: int, dtype: np.dtype[Any], shape: tuple[int, ...]) -> "FileArray":
        """Return the array of a shape at an offset in bytes of the mapped file."""
        array = np.ndarray.__new__(cls, shape, dtype, buffer=pages, offset=offset)
        array._mmap = pages  # type: ignore[attr-defined]
        return array

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        """Results of arithmetic with it are in memory."""
        plain = np.asarray(array)
        return plain[()] if return_scalar else plain

    def __reduce__(self) -> Any:
        """Pickle the file name and location, or the values of a temporary file or of a part."""
        if hasattr(self, "place"):
            return FileArray.at, (*self.place, self.dtype, self.shape)
        values = np.array(self)
        return (stored_in, (self.folder, values)) if hasattr(self, "folder") else values.__reduce__()


# Bytes of a temporary file, which arrays share: each mapped file takes a descriptor, and there may be thousands.
ROOM_BYTES = 1 << 28


class _Room:
    """A temporary file that has no name: gone with its last array, or with the process, however that ends."""

    def __init__(self, folder: Path, size: int) -> None:
        self.file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 (as long as its arrays)
        finalize(self, self.file.close)
        self.file.truncate(size)
        self.pages, self.used = mmap.mmap(self.file.fileno(), size, access=mmap.ACCESS_READ), 0

    def add(self, values: NDArray[Any]) -> FileArray:
        """Add a copy; OSError on a full disk, which a write to mapped pages would not survive."""
        data, done = values.reshape(-1).view(np.uint8).data, 0
        while done < len(data):
            done += os.pwrite(self.file.fileno(), data[done:], self.used + done)
        array = FileArray.within(self.pages, self.used, values.dtype, values.shape)
        self.used += -(-values.nbytes // mmap.PAGESIZE) * mmap.PAGESIZE
        return array


# The last room of a process in a folder, as long as an array is in it.
_ROOMS: WeakValueDictionary[tuple[int, Path], _Room] = WeakValueDictionary()


def stored_beside(source: NDArray[Any] | None, values: NDArray[Any]) -> NDArray[Any]:
    """Move values, read-only, into a temporary file if their source is in a file; otherwise return them.

    `release` gives its memory back. In memory, too, where the folder takes no file.
    """
    folder = getattr(source, "folder", None)
    return values if folder is None else stored_in(folder, values)


def stored_in(folder: Path, values: NDArray[Any]) -> NDArray[Any]:
    """Move numbers into a temporary file of a folder."""
    if not hasattr(mmap, "MADV_DONTNEED"):
        return values
    values, key = np.ascontiguousarray(values), (os.getpid(), folder)
    try:
        room = _ROOMS.get(key)
        if room is None or room.used + values.nbytes > len(room.pages):
            room = _ROOMS[key] = _Room(folder, max(ROOM_BYTES, values.nbytes))
        array = room.add(values)
    except OSError:
        return values
    array.folder, array.room = folder, room  # type: ignore[attr-defined]
    return array


@lru_cache(maxsize=4)
def _pages(path: Path, inode: int, mtime_ns: int) -> mmap.mmap:
    """Map a file in its present version; a later replacement is a different file."""
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def mapped(path: Path, dataset: Any) -> FloatArray | None:
    """Map a large contiguous dataset of an HDF5 file in its place; None for any other dataset."""
    offset, shape = dataset.id.get_offset(), dataset.shape
    is_part = dataset.nbytes >= MIN_PART_BYTES and path.stat().st_size >= MIN_LARGE_FILE
    if offset is None or not (is_part or dataset.size >= MIN_LARGE_VALUES):
        return None
    if dataset.dtype == np.float32 and len(shape) == 2:
        return cast(FloatArray, LargeArray(shape, dataset.dtype, partial(_stored_rows, path, offset, shape[1])))
    is_known = dataset.dtype in (np.float64, np.complex128)
    return cast(FloatArray, FileArray.at(path.resolve(), offset, dataset.dtype, shape)) if is_known else None


def _stored_rows(path: Path, offset: int, columns: int, first: int, last: int) -> NDArray[Any]:
    """Read rows of a table of single precision that starts at an offset of a file."""
    values = np.fromfile(path, np.float32, (last - first) * columns, offset=offset + 4 * columns * first)
    return values.reshape(last - first, columns)


@dataclass(frozen=True)
class ValueRange:
    """First value, range low to high of finite values (NaN without any), and number of missing values."""

    first: float
    low: float
    high: float
    missing: int


def value_range(blocks: Iterable[NDArray[Any]]) -> ValueRange:
    """Return the range of numbers in pieces; magnitudes for complex numbers.

    >>> value_range([np.array([2.0, 1.0]), np.array([np.nan, 5.0])])
    ValueRange(first=2.0, low=1.0, high=5.0, missing=1)
    """
    firsts: list[float] = []
    lows, highs, missing = [np.nan], [np.nan], 0
    for block in blocks:
        values = np.abs(block) if block.dtype.kind == "c" else block
        if not values.size:
            continue
        firsts.append(float(values.flat[0]))
        good = values if values.dtype.kind in "iub" else values[np.isfinite(values)]
        missing += values.size - good.size
        if good.size:
            lows.append(float(good.min()))
            highs.append(float(good.max()))
    return ValueRange(
        firsts[0] if firsts else np.nan, float(np.fmin.reduce(lows)), float(np.fmax.reduce(highs)), missing
    )


def format_values(values: NDArray[Any]) -> str:
    """Format an array in one row: all values if they are few, else their range.

    >>> format_values(np.array([0, 1, 2]))
    '0, 1, 2'
    >>> format_values(np.linspace(0, 1j, 100))
    'magnitude 0 to 1'
    """
    most = 40
    if values.dtype.kind not in "fiubc":
        if not any(str(value) for value in values.ravel()):
            return "empty texts"
        texts = [f"{text[:100]} ..." if len(text) > 100 else text for text in map(str, values.ravel()[:most])]
        return ", ".join(texts) + (f" and {values.size - most} more" if values.size > most else "")
    if values.size == 1 or (values.ndim < 2 and values.size <= most):
        return ", ".join(str(v) if values.dtype.kind == "b" else f"{v:.6g}" for v in values.ravel())
    return format_range(value_range([values]), values.dtype.kind == "c")


def format_range(ends: ValueRange, is_complex: bool = False) -> str:
    """Format a range."""
    if np.isnan(ends.low):
        return "no finite number"
    missing = f", {ends.missing} not finite" if ends.missing else ""
    return f"{'magnitude ' if is_complex else ''}{ends.low:.6g} to {ends.high:.6g}{missing}"
