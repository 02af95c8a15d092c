"""The loops of `triangle` compiled by numba; to import only where that is installed.

The innermost loops run over lines that lie side by side in memory, so many that what is done before each loop does not
count, and so few that their columns stay in the cache. R (n_r, F) has its rows one below the other, each from its
diagonal on; of diagonal weights it has the diagonal alone.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.compiled import fast


@fast
def residual(R: ComplexArray, start: int, q: ComplexArray, G: ComplexArray) -> ComplexArray:
    """r = q - R g (F, n_e) of the lines from start on, q and G (F, n_e)."""
    F, n_e = G.shape
    r, g = np.ascontiguousarray(q.T), np.ascontiguousarray(G.T)
    width, t = n_e if len(R) > n_e else 1, 0
    for e in range(n_e):
        for k in range(e, min(e + width, n_e)):
            for f in range(F):
                r[e, f] -= R[t, start + f] * g[k, f]
            t += 1
    return np.ascontiguousarray(r.T)


@fast
def returned(R: ComplexArray, start: int, r: ComplexArray) -> ComplexArray:
    """r^H R (F, n_e) of the lines from start on, r (F, n_e)."""
    F, n_e = r.shape
    found, conjugate = np.zeros((n_e, F), np.complex128), np.ascontiguousarray(r.T.conj())
    width, t = n_e if len(R) > n_e else 1, 0
    for e in range(n_e):
        for k in range(e, min(e + width, n_e)):
            for f in range(F):
                found[k, f] += conjugate[e, f] * R[t, start + f]
            t += 1
    return np.ascontiguousarray(found.T)


@fast
def pulled(
    left: ComplexArray, right: ComplexArray, outputs: IntArray, inputs: IntArray, weight: ComplexArray
) -> ComplexArray:
    """sum_e weight_e left_e right_e (F, n_1) of left (F, n_y, n_1), right (F, n_u, n_1), weight (F, n_e)."""
    F, n_y, n_1 = left.shape
    found, row = np.zeros((F, n_1), np.complex128), np.empty((n_y, n_1), np.complex128)
    for f in range(F):
        row[:] = 0.0
        for e in range(len(outputs)):
            for d in range(n_1):
                row[outputs[e], d] += weight[f, e] * right[f, inputs[e], d]
        for i in range(n_y):
            for d in range(n_1):
                found[f, d] += left[f, i, d] * row[i, d]
    return found


@fast
def moments(
    left: ComplexArray,
    right: ComplexArray,
    gain: ComplexArray,
    factor: FloatArray,
    outputs: IntArray,
    inputs: IntArray,
    whole: ComplexArray,
    slope: ComplexArray,
    R: ComplexArray,
    start: int,
    omega: FloatArray,
    V: FloatArray,
) -> FloatArray:
    """Re, for odd p Im, of sum_f omega^p V_f^H V_f (5, n_b, n_b) above the diagonal, V = R diag(slope) U, of a block.

    U = [gain factor left right^T of the bases of rank one, whole].
    slope (F, n_e), or empty for one.  V (2, n_b, n_e, lanes): memory for the columns of a batch, in the precision
    wanted.
    """
    F, lanes = omega.size, V.shape[3]
    found = np.zeros((5, V.shape[1], V.shape[1]))
    T = np.empty((2, len(R), lanes), V.dtype)
    for first in range(0, F, lanes):
        last = min(first + lanes, F)
        many = slice(first, last)
        _columns(left[many], right[many], gain[many], factor, outputs, inputs, whole[many], V[0], V[1])
        _triangles(R, start + first, slope[first:last], V.shape[2], last - first, T[0], T[1])
        _whiten(V[0], V[1], T[0], T[1], last - first)
        _add_up(V[0], V[1], omega[first:last], found)
    return found


@fast
def _columns(
    left: ComplexArray,
    right: ComplexArray,
    gain: ComplexArray,
    factor: FloatArray,
    outputs: IntArray,
    inputs: IntArray,
    whole: ComplexArray,
    Vr: FloatArray,
    Vi: FloatArray,
) -> None:
    """U of some lines, real and imaginary parts (n_b, n_e, lanes)."""
    n_e, (F, n_y, n_1) = Vr.shape[1], left.shape
    y, u = np.empty((2, n_y, F), Vr.dtype), np.empty((2, right.shape[1], F), Vr.dtype)
    for b in range(n_1):
        for i in range(n_y):
            for q in range(F):
                y[0, i, q], y[1, i, q] = factor[b] * left[q, i, b].real, factor[b] * left[q, i, b].imag
        for i in range(right.shape[1]):
            for q in range(F):
                z = gain[q] * right[q, i, b]
                u[0, i, q], u[1, i, q] = z.real, z.imag
        for e in range(n_e):
            i, j = outputs[e], inputs[e]
            for q in range(F):
                Vr[b, e, q] = y[0, i, q] * u[0, j, q] - y[1, i, q] * u[1, j, q]
                Vi[b, e, q] = y[0, i, q] * u[1, j, q] + y[1, i, q] * u[0, j, q]
    for w in range(whole.shape[2]):
        for e in range(n_e):
            for q in range(F):
                Vr[n_1 + w, e, q], Vi[n_1 + w, e, q] = whole[q, e, w].real, whole[q, e, w].imag


@fast
def _triangles(
    R: ComplexArray, start: int, slope: ComplexArray, n_e: int, lines: int, Tr: FloatArray, Ti: FloatArray
) -> None:
    """R diag(slope) of some lines, real and imaginary parts (n_r, lanes)."""
    width, t = n_e if len(R) > n_e else 1, 0
    for e in range(n_e):
        for k in range(e, min(e + width, n_e)):
            for q in range(lines):
                z = R[t, start + q] * slope[q, k] if slope.size else R[t, start + q]
                Tr[t, q], Ti[t, q] = z.real, z.imag
            t += 1


@fast
def _whiten(Vr: FloatArray, Vi: FloatArray, Tr: FloatArray, Ti: FloatArray, lines: int) -> None:
    """V becomes R V, from the first row on."""
    n_b, n_e = Vr.shape[:2]
    width = n_e if len(Tr) > n_e else 1
    row = np.empty((2, lines), Vr.dtype)
    real, imaginary = row[0], row[1]
    for b in range(n_b):
        t = 0
        for e in range(n_e):
            row[:] = 0.0
            for k in range(e, min(e + width, n_e)):
                for q in range(lines):
                    real[q] += Tr[t, q] * Vr[b, k, q] - Ti[t, q] * Vi[b, k, q]
                    imaginary[q] += Tr[t, q] * Vi[b, k, q] + Ti[t, q] * Vr[b, k, q]
                t += 1
            for q in range(lines):
                Vr[b, e, q], Vi[b, e, q] = real[q], imaginary[q]


@fast
def _add_up(Vr: FloatArray, Vi: FloatArray, omega: FloatArray, found: FloatArray) -> None:
    """Adds the moments of some lines."""
    n_b, n_e = Vr.shape[:2]
    power = np.ones((5, omega.size), Vr.dtype)
    for p in range(1, 5):
        power[p] = power[p - 1] * omega
    gram = np.empty((2, omega.size), Vr.dtype)
    real, imaginary = gram[0], gram[1]
    for b in range(n_b):
        for c in range(b, n_b):
            gram[:] = 0.0
            for e in range(n_e):
                for q in range(omega.size):
                    real[q] += Vr[b, e, q] * Vr[c, e, q] + Vi[b, e, q] * Vi[c, e, q]
                    imaginary[q] += Vr[b, e, q] * Vi[c, e, q] - Vi[b, e, q] * Vr[c, e, q]
            for p in range(5):
                total = Vr.dtype.type(0.0)
                for q in range(omega.size):
                    total += gram[p % 2, q] * power[p, q]
                found[p, b, c] += total
