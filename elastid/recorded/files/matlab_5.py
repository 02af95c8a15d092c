"""Logs in MATLAB files up to version 7, by SciPy: members of structs behind a dot, elements of cells in braces."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.log import ArrayLog, StoredArray


def recognises(path: Path, head: bytes) -> bool:
    """True by the header; files of version 4 have none, and are known by their suffix."""
    # Version and byte order stand behind the free text of a header, little or big endian.
    signatures = (b"\x00\x01IM", b"\x01\x00MI")
    return head.startswith(b"MATLAB") or head[124:128] in signatures or path.suffix.lower() == ".mat"


@contextmanager
def opened(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """All variables, members of structs and elements of cells; objects of classes are left out."""
    from scipy.io import loadmat

    variables = loadmat(path)
    named = {name: value for name, value in variables.items() if isinstance(name, str) and not name.startswith("__")}
    arrays = dict(leaf for name, value in named.items() for leaf in _leaves(name, value))
    yield ArrayLog(path, {name: _stored(value) for name, value in arrays.items()})


def _leaves(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    from scipy.io.matlab import MatlabOpaque

    if isinstance(value, MatlabOpaque) or not isinstance(value, np.ndarray):
        return
    if value.dtype == object:
        for index, cell in enumerate(value.ravel(order="F"), start=1):
            yield from _leaves(f"{name}{{{index}}}", cell)
        return
    if value.dtype.names is None:
        yield name, value
        return
    for index, element in enumerate(value.ravel(order="F"), start=1):
        prefix = name if value.size == 1 else f"{name}({index})"
        for member in value.dtype.names:
            yield from _leaves(f"{prefix}.{member}", element[member])


def _stored(value: NDArray[Any]) -> StoredArray:
    return StoredArray(tuple(value.shape), value.dtype, lambda: value)
