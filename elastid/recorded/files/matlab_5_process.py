"""The process that reads a file of MATLAB and hands over plain arrays: it loads NumPy and SciPy and nothing else."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray


def hand_over() -> None:
    """In the process that reads: the arrays of the file that it was started with, as an npz on standard output."""
    from scipy.io import loadmat

    with warnings.catch_warnings():
        # Files with several objects of classes make SciPy warn of "duplicate variable None"; objects are skipped.
        warnings.simplefilter("ignore")
        try:
            variables = loadmat(sys.argv[1])
        except Exception as error:
            sys.exit(f"{type(error).__name__}: {error}")
    named = {name: value for name, value in variables.items() if isinstance(name, str) and not name.startswith("__")}
    arrays = dict(leaf for name, value in named.items() for leaf in _leaves(name, value))
    np.savez(sys.stdout.buffer, *arrays.values(), names=np.array(list(arrays), dtype=str))


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
