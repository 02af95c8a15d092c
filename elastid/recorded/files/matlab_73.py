"""Logs in MATLAB files of version 7.3: HDF5 behind a MATLAB header, axes reversed, structs as groups."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files import hdf5
from elastid.recorded.files.log import ArrayLog


def recognises(path: Path, head: bytes) -> bool:
    """HDF5 with MATLAB's header in front of it."""
    return head.startswith(b"MATLAB") and hdf5.recognises(path, head)


@contextmanager
def opened(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """All variables and members of structs; MATLAB stores column-major, so that axes arrive reversed."""
    with hdf5.opened_file(path) as file:
        yield ArrayLog(path, dict(hdf5.datasets(file, separator=".", is_transposed=True)))
