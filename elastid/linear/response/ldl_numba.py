"""The loop of `ldl` compiled by numba; to import only where that is installed.

The innermost loops run over lines that lie side by side in memory, real and imaginary parts apart, so that the
processor takes several lines at once. Compiled at the first call, in a second or two, and kept for the next one. The
steps are one function on purpose: rows handed to functions of their own are no longer known to lie apart from each
other, and half of the speed is lost.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray

# Lines worked on at once: their matrices stay in the cache.
LANES = 32


def _fast(loops: Callable[..., None]) -> Callable[..., None]:
    """Compiled with fused multiplication and addition and sums in any order; NaN and infinity stay what they are."""
    how = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}
    try:
        compiled: Callable[..., None] = njit(cache=True, **how)(loops)
    except RuntimeError:  # no folder that can be written to: compiled anew in every process
        compiled = njit(**how)(loops)
    return compiled


@_fast
def eliminate(
    M: FloatArray,
    D: FloatArray,
    K: FloatArray,
    B: FloatArray,
    omega: FloatArray,
    filled: BoolArray,
    Y: FloatArray,
    found: ComplexArray,
    smallest: FloatArray,
) -> None:
    """found (F, m, n_d) = X^T Y of Z X = B by L D L^T, and each line's smallest |pivot|^2 beside its terms (F,).

    M, D, K, B, Y: rows and columns in the order of elimination.  filled (n, n): where L^T is not zero.
    """
    n, m, F = M.shape[0], B.shape[1], omega.size
    first, row = np.zeros(Y.shape[1] + 1, np.int64), np.empty(Y.size, np.int64)
    for d in range(Y.shape[1]):
        first[d + 1] = first[d]
        for i in range(n):
            if Y[i, d] != 0.0:
                row[first[d + 1]] = i
                first[d + 1] += 1
    reached = B != 0.0
    for k in range(n):
        for i in range(k + 1, n):
            if filled[k, i]:
                reached[i] |= reached[k]
    Zr, Zi = np.empty((n, n, LANES)), np.empty((n, n, LANES))
    Xr, Xi = np.empty((n, m, LANES)), np.empty((n, m, LANES))
    Pr, Pi = np.empty((n, LANES)), np.empty((n, LANES))  # 1 / pivot
    lr, li, w, least = np.empty(LANES), np.empty(LANES), np.ones(LANES), np.empty(LANES)
    for start in range(0, F, LANES):
        many = min(LANES, F - start)
        for q in range(LANES):
            w[q] = omega[start + min(q, many - 1)]
            least[q] = np.inf
        for i in range(n):
            for j in range(i, n):
                if i == j or filled[i, j]:
                    for q in range(LANES):
                        Zr[i, j, q] = K[i, j] - w[q] * w[q] * M[i, j]
                        Zi[i, j, q] = w[q] * D[i, j]
            for j in range(m):
                for q in range(LANES):
                    Xr[i, j, q] = B[i, j]
                    Xi[i, j, q] = 0.0
        for k in range(n):
            stiff, heavy = abs(K[k, k]), abs(M[k, k])
            for q in range(LANES):
                square = Zr[k, k, q] * Zr[k, k, q] + Zi[k, k, q] * Zi[k, k, q]
                size = stiff + w[q] * w[q] * heavy
                least[q] = min(least[q], square / (size * size))
                Pr[k, q] = Zr[k, k, q] / square
                Pi[k, q] = -Zi[k, k, q] / square
            for i in range(k + 1, n):
                if filled[k, i]:
                    for q in range(LANES):
                        lr[q] = Zr[k, i, q] * Pr[k, q] - Zi[k, i, q] * Pi[k, q]
                        li[q] = Zr[k, i, q] * Pi[k, q] + Zi[k, i, q] * Pr[k, q]
                    for j in range(i, n):
                        if filled[k, j]:
                            for q in range(LANES):
                                Zr[i, j, q] -= lr[q] * Zr[k, j, q] - li[q] * Zi[k, j, q]
                                Zi[i, j, q] -= lr[q] * Zi[k, j, q] + li[q] * Zr[k, j, q]
                    for j in range(m):
                        if reached[k, j]:
                            for q in range(LANES):
                                Xr[i, j, q] -= lr[q] * Xr[k, j, q] - li[q] * Xi[k, j, q]
                                Xi[i, j, q] -= lr[q] * Xi[k, j, q] + li[q] * Xr[k, j, q]
        for k in range(n - 1, -1, -1):
            for j in range(m):
                for i in range(k + 1, n):
                    if filled[k, i]:
                        for q in range(LANES):
                            Xr[k, j, q] -= Zr[k, i, q] * Xr[i, j, q] - Zi[k, i, q] * Xi[i, j, q]
                            Xi[k, j, q] -= Zr[k, i, q] * Xi[i, j, q] + Zi[k, i, q] * Xr[i, j, q]
                for q in range(LANES):
                    real = Xr[k, j, q]
                    Xr[k, j, q] = real * Pr[k, q] - Xi[k, j, q] * Pi[k, q]
                    Xi[k, j, q] = real * Pi[k, q] + Xi[k, j, q] * Pr[k, q]
        for q in range(many):
            smallest[start + q] = least[q]
        for j in range(m):
            for d in range(Y.shape[1]):
                lr[:], li[:] = 0.0, 0.0
                for at in range(first[d], first[d + 1]):
                    i = row[at]
                    for q in range(LANES):
                        lr[q] += Y[i, d] * Xr[i, j, q]
                        li[q] += Y[i, d] * Xi[i, j, q]
                for q in range(many):
                    found[start + q, j, d] = complex(lr[q], li[q])
