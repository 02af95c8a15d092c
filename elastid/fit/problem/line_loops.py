"""The loops of `triangle` in C (`line_loops.c`): to call only where `elastid.base.compiled` finds a compiler.

Lines lie side by side in memory, BATCH at a time, real and imaginary parts apart, so that the processor takes several
at once. Columns are formed, whitened and summed up while they are in the cache. R (batches, n_r, 2, BATCH) has its rows
one below the other, each from its diagonal on; of diagonal weights it has the diagonal alone. Lines that fill up the
last batch are zero.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.compiled import call, loops
from elastid.linear.response.derivatives import Sensitivity

BATCH = 16
SOURCE = Path(__file__).with_name("line_loops.c")


def _loops(precision: type[np.floating[Any]]) -> ctypes.CDLL | None:
    return loops(SOURCE, "-DREAL=" + ("float" if precision is np.float32 else "double"))


def is_compiled() -> bool:
    """Whether the loops can be compiled here."""
    return None not in (_loops(np.float32), _loops(np.float64))


def packed(R: ComplexArray | FloatArray) -> FloatArray:
    """R (F, n_e, n_e), or its diagonal (F, n_e), as the loops take it."""
    rows = R if R.ndim == 2 else R[:, *np.triu_indices(R.shape[1])]
    F, n_r = rows.shape
    filled = np.zeros((-(-F // BATCH) * BATCH, n_r), complex)
    filled[:F] = rows
    parts = np.stack([filled.real, filled.imag], axis=2).reshape(-1, BATCH, n_r, 2)
    return np.ascontiguousarray(parts.transpose(0, 2, 3, 1))


def residual(R: FloatArray, start: int, q: ComplexArray, G: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """r = q - R g (F, n_e) and r^H R of the lines from start on, q and G (F, n_e)."""
    F, n_e = G.shape
    r, found = np.empty((F, n_e), complex), np.empty((F, n_e), complex)
    call(_loops(np.float64), "residuals", F, n_e, R.shape[1] == n_e, R[start // BATCH :], q, G, r, found)
    return r, found


def returned(R: FloatArray, start: int, r: ComplexArray) -> ComplexArray:
    """r^H R (F, n_e) of the lines from start on, r (F, n_e)."""
    F, n_e = r.shape
    found = np.empty((F, n_e), complex)
    call(_loops(np.float64), "residuals", F, n_e, R.shape[1] == n_e, R[start // BATCH :], None, None, r.copy(), found)
    return found


def pulled(part: Sensitivity, weight: ComplexArray) -> ComplexArray:
    """sum_e weight_e left_e right_e (F, n_1) of a block of lines, weight (F, n_e)."""
    (F, n_y, n_1), n_u = part.left.shape, part.right.shape[1]
    row, found = np.empty(n_1, complex), np.empty((F, n_1), complex)
    call(
        _loops(np.float64),
        "pulled",
        F,
        n_y,
        n_u,
        n_1,
        len(part.outputs),
        part.left,
        part.right,
        part.outputs,
        part.inputs,
        weight,
        row,
        found,
    )
    return found


def moments(
    part: Sensitivity,
    scale: FloatArray,
    slope: ComplexArray | None,
    R: FloatArray,
    omega: FloatArray,
    precision: type[np.floating[Any]],
) -> FloatArray:
    """As `Full.moments`."""
    (F, n_y, n_1), n_u = part.left.shape, part.right.shape[1]
    n_b, n_e = len(scale), len(part.outputs)
    found, factor = np.zeros((5, n_b, n_b)), scale.copy()
    factor[:n_1] *= part.sign
    left = np.ascontiguousarray(part.left)
    right = left if part.is_alike else part.right
    call(
        _loops(precision),
        "moments",
        F,
        n_y,
        n_u,
        n_1,
        n_b - n_1,
        n_e,
        R.shape[1] == n_e,
        left,
        right,
        part.gain,
        factor,
        part.whole,
        part.outputs,
        part.inputs,
        slope,
        R[part.block.start // BATCH :],
        omega,
        found,
    )
    return found
