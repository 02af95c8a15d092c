"""The sums of `triangle` in C (`base/kernels/line_loops.c`); callable only where the kernels are built.

Lines lie side by side in memory, BATCH at a time, real and imaginary parts apart, so that the processor takes several
at once. Columns are formed, whitened and summed up while they are in the cache. R (batches, n_r, 2, BATCH) has its rows
one below the other, each from its diagonal on; of diagonal weights it has the diagonal alone. Lines that fill up the
last batch are zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.kernels import call
from elastid.linear.response.sensitivity import Sensitivity

BATCH = 16


def packed(R: ComplexArray | FloatArray) -> FloatArray:
    """R (F, n_e, n_e), or its diagonal (F, n_e), as the kernel takes it."""
    rows = R if R.ndim == 2 else R[:, *np.triu_indices(R.shape[1])]
    F, n_r = rows.shape
    filled = np.zeros((-(-F // BATCH) * BATCH, n_r), complex)
    filled[:F] = rows
    parts = np.stack([filled.real, filled.imag], axis=2).reshape(-1, BATCH, n_r, 2)
    return np.ascontiguousarray(parts.transpose(0, 2, 3, 1))


def compiled_sums(
    part: Sensitivity,
    R: FloatArray,
    q: ComplexArray,
    G: ComplexArray | None,
    slope: ComplexArray | None,
    scale: FloatArray,
    precision: type[np.floating[Any]],
) -> tuple[float, ComplexArray, ComplexArray, FloatArray]:
    """As `Full.sums`, R packed; moments on and above the diagonal."""
    (F, n_y, _), n_u, (n_b, n_e) = part.left.shape, part.right.shape[1], (len(scale), len(part.outputs))
    n_1, (_, n_2, r, _) = len(part.sign), part.S.shape
    sign = np.ones(n_b)
    sign[:n_1] = part.sign
    cost, weight = np.zeros(1), np.empty((n_e, F), complex)
    pulled, moments = np.zeros((3, n_b), complex), np.zeros((5, n_b, n_b))
    between = np.zeros((3, r, r), complex)
    call(
        "sums_float" if precision is np.float32 else "sums_double",
        F,
        n_y,
        n_u,
        n_1,
        n_2,
        r,
        n_b - n_1 - n_2,
        n_e,
        R.shape[1] == n_e,
        part.left.T,
        None if part.is_alike else part.right.T,
        part.gain,
        part.S,
        part.whole.T,
        part.outputs,
        part.inputs,
        q.T,
        None if G is None else G.T,
        None if slope is None else slope.T,
        R[part.block.start // BATCH :],
        part.omega,
        sign,
        sign * scale,
        cost,
        weight,
        pulled,
        between,
        moments,
    )
    pulled[:, n_1 : n_1 + n_2] = part.pulled_by(between)
    return float(cost[0]), weight.T, pulled, moments
