"""Loops compiled by numba; to import only where that is installed (the extra `fast`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

Loops = TypeVar("Loops", bound=Callable[..., Any])


def fast(loops: Loops) -> Loops:
    """Compiled with fused multiplication and addition and sums in any order; NaN and infinity stay what they are.

    Compiled at the first call, in a second or two, and kept for the next process.
    """
    how = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}
    try:
        compiled: Loops = njit(cache=True, **how)(loops)
    except RuntimeError:  # no folder that can be written to: compiled anew in every process
        compiled = njit(**how)(loops)
    return compiled
