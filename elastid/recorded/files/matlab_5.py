"""Logs in MATLAB files up to version 7, by SciPy.

SciPy's reader is compiled and trusts the lengths in a file: a damaged one can end the process.  It reads in a process
of its own, which hands over plain arrays.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files import matlab_5_process
from elastid.recorded.files.log import ArrayLog, StoredArray

# Version and byte order behind the free text of a header, little and big endian.
_SIGNATURES = (b"\x00\x01IM", b"\x01\x00MI")


def recognises(path: Path, head: bytes) -> bool:
    """By the header; files of version 4 have none, and are known by their suffix."""
    return head.startswith(b"MATLAB") or head[124:128] in _SIGNATURES or path.suffix.lower() == ".mat"


@contextmanager
def opened(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """All variables, members of structs and elements of cells; objects of classes are left out.

    Raises ValueError with what SciPy said, or that its process died.
    """
    found = os.stat(path)
    arrays = _read_apart(path, found.st_ino, found.st_size, found.st_mtime_ns)
    yield ArrayLog(path, {name: _stored(value) for name, value in arrays.items()})


@lru_cache(maxsize=1)
def _read_apart(path: Path, inode: int, size: int, written_ns: int) -> Mapping[str, NDArray[Any]]:
    """The arrays of this version of a file, from a process of its own."""
    # -P: nothing is imported from the folder that the user happens to be in.
    reader = [sys.executable, "-P", "-c", f"from {matlab_5_process.__name__} import hand_over; hand_over()", str(path)]
    where = os.pathsep.join(place or os.getcwd() for place in sys.path)
    ended = subprocess.run(reader, capture_output=True, check=False, env=os.environ | {"PYTHONPATH": where})
    if ended.returncode != 0:
        said = ended.stderr.decode(errors="replace").strip().splitlines()
        died = f"the process that read it died, exit code {ended.returncode}"
        raise ValueError(said[-1] if ended.returncode == 1 and said else died)
    with np.load(io.BytesIO(ended.stdout), allow_pickle=False) as kept:
        return {str(name): kept[f"arr_{i}"] for i, name in enumerate(kept["names"])}


def _stored(value: NDArray[Any]) -> StoredArray:
    return StoredArray(tuple(value.shape), value.dtype, lambda: value)
