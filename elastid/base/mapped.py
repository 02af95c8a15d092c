"""Arrays that are kept in a file and not in memory: the system holds as much of them as there is room for."""

from __future__ import annotations

import mmap
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray

# Larger arrays are kept in files, and worked on in pieces of so many values.
MIN_LARGE_VALUES = 1 << 25
PIECE_VALUES = 1 << 21


def empty_in_file(shape: tuple[int, ...]) -> FloatArray:
    """An array to fill, in a temporary file that is gone with it (in the folder that TMPDIR names)."""
    with tempfile.TemporaryFile() as file:
        return np.memmap(file, dtype=np.float64, mode="w+", shape=shape)


def release(array: FloatArray) -> None:
    """Give the memory of an array in a file back, which keeps its values; nothing happens to an array in memory."""
    pages = getattr(array, "_mmap", None)
    if pages is not None and hasattr(mmap, "MADV_DONTNEED"):
        # Pages that were written stay with the system: the mapping is shared.
        pages.madvise(mmap.MADV_DONTNEED)


def read_only(array: FloatArray) -> FloatArray:
    """The same array, which nobody can write to any more."""
    array.flags.writeable = False
    return array


def mapped(path: Path, dataset: Any) -> FloatArray | None:
    """A large dataset of an HDF5 file in its place there; None of one that is small, or not stored in one piece."""
    offset = dataset.id.get_offset()
    if dataset.size < MIN_LARGE_VALUES or offset is None or dataset.dtype != np.float64:
        return None
    return np.memmap(path, dtype=np.float64, mode="r", offset=offset, shape=dataset.shape)
