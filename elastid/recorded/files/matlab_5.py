"""Logs in MATLAB files up to version 7, by SciPy."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.log import ArrayLog, StoredArray

# Version and byte order behind the free text of a header, little and big endian.
_SIGNATURES = (b"\x00\x01IM", b"\x01\x00MI")


def recognises(path: Path, head: bytes) -> bool:
    """By the header; files of version 4 have none, and are known by their suffix."""
    return head.startswith(b"MATLAB") or head[124:128] in _SIGNATURES or path.suffix.lower() == ".mat"


@contextmanager
def opened(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """All variables, members of structs and elements of cells; objects of classes are left out."""
    from scipy.io import loadmat

    with warnings.catch_warnings():
        # Files with several objects of classes make SciPy warn of "duplicate variable None"; objects are skipped.
        warnings.simplefilter("ignore")
        variables = loadmat(path)
    arrays: dict[str, StoredArray] = {}
    for name, value in variables.items():
        if isinstance(name, str) and not name.startswith("__"):
            arrays |= _leaves(name, value)
    yield ArrayLog(path, arrays)


def _leaves(name: str, value: Any) -> Iterator[tuple[str, StoredArray]]:
    from scipy.io.matlab import MatlabOpaque

    if isinstance(value, MatlabOpaque):
        return
    if value.dtype == object:
        for index, cell in enumerate(value.ravel(order="F"), start=1):
            yield from _leaves(f"{name}{{{index}}}", cell)
        return
    if value.dtype.names is None:
        yield name, StoredArray(tuple(value.shape), value.dtype, lambda: value)
        return
    for index, element in enumerate(value.ravel(order="F"), start=1):
        prefix = name if value.size == 1 else f"{name}({index})"
        for member in value.dtype.names:
            yield from _leaves(f"{prefix}.{member}", element[member])
