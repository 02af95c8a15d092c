"""The loops of `ldl` compiled by numba; to import only where that is installed.

The innermost loops run over lines that lie side by side in memory, real and imaginary parts apart, so that the
processor takes several lines at once. Elimination and substitution are one function on purpose, which allocates what it
works on: of rows handed to functions of their own it is no longer known that they lie apart from each other, and half
of the speed is lost.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.compiled import fast

# Lines worked on at once: their matrices stay in the cache.
LANES = 32


def eliminate(
    M: FloatArray, D: FloatArray, K: FloatArray, B: FloatArray, omega: FloatArray, filled: BoolArray, Y: FloatArray
) -> tuple[ComplexArray, FloatArray]:
    """X^T Y (F, m, n_d) of Z X = B by L D L^T, and each line's smallest |pivot|^2 beside its terms (F,).

    M, D, K, B, Y: rows and columns in the order of elimination.  filled (n, n): where L^T is not zero.
    """
    found, smallest = np.empty((len(omega), B.shape[1], Y.shape[1]), complex), np.empty(len(omega))
    columns, rows = np.nonzero(Y.T)
    first = np.searchsorted(columns, np.arange(Y.shape[1] + 1))
    _solve_batches(M, D, K, B, omega, filled, _reached(B, filled), Y, first, rows, found, smallest)
    return found, smallest


@fast
def _reached(B: FloatArray, filled: BoolArray) -> BoolArray:
    """Where L^-1 B is not zero (n, m)."""
    reached: BoolArray = B != 0.0
    for k in range(len(B)):
        for i in range(k + 1, len(B)):
            if filled[k, i]:
                reached[i] |= reached[k]
    return reached


@fast
def _solve_batches(
    M: FloatArray,
    D: FloatArray,
    K: FloatArray,
    B: FloatArray,
    omega: FloatArray,
    filled: BoolArray,
    reached: BoolArray,
    Y: FloatArray,
    first: IntArray,
    rows: IntArray,
    found: ComplexArray,
    smallest: FloatArray,
) -> None:
    """X^T Y and the smallest pivots, `LANES` lines at a time; rows[first[d] : first[d + 1]]: of Y's column d."""
    n, m = B.shape
    Zr, Zi = np.empty((n, n, LANES)), np.empty((n, n, LANES))
    Xr, Xi = np.empty((n, m, LANES)), np.empty((n, m, LANES))
    Pr, Pi = np.empty((n, LANES)), np.empty((n, LANES))  # 1 / pivot
    lr, li, w, least = np.empty(LANES), np.empty(LANES), np.ones(LANES), np.empty(LANES)
    for start in range(0, omega.size, LANES):
        for q in range(LANES):
            w[q] = omega[min(start + q, omega.size - 1)]
            least[q] = np.inf
        _assemble(M, D, K, B, w, filled, Zr, Zi, Xr, Xi)
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
        for q in range(min(LANES, omega.size - start)):
            smallest[start + q] = least[q]
        _gather(Xr, Xi, Y, first, rows, lr, li, found[start : start + LANES])


@fast
def _assemble(
    M: FloatArray,
    D: FloatArray,
    K: FloatArray,
    B: FloatArray,
    w: FloatArray,
    filled: BoolArray,
    Zr: FloatArray,
    Zi: FloatArray,
    Xr: FloatArray,
    Xi: FloatArray,
) -> None:
    """Z = K + j w D - w^2 M on and above the diagonal where it is not zero, and the right sides B."""
    n, m = B.shape
    for i in range(n):
        for j in range(i, n):
            if i == j or filled[i, j]:
                for q in range(w.size):
                    Zr[i, j, q] = K[i, j] - w[q] * w[q] * M[i, j]
                    Zi[i, j, q] = w[q] * D[i, j]
        for j in range(m):
            for q in range(w.size):
                Xr[i, j, q] = B[i, j]
                Xi[i, j, q] = 0.0


@fast
def _gather(
    Xr: FloatArray,
    Xi: FloatArray,
    Y: FloatArray,
    first: IntArray,
    rows: IntArray,
    real: FloatArray,
    imaginary: FloatArray,
    found: ComplexArray,
) -> None:
    """X^T Y (lines, m, n_d), the zeros of Y skipped."""
    for j in range(Xr.shape[1]):
        for d in range(Y.shape[1]):
            real[:], imaginary[:] = 0.0, 0.0
            for i in rows[first[d] : first[d + 1]]:
                for q in range(real.size):
                    real[q] += Y[i, d] * Xr[i, j, q]
                    imaginary[q] += Y[i, d] * Xi[i, j, q]
            for q in range(len(found)):
                found[q, j, d] = complex(real[q], imaginary[q])
