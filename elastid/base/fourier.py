"""Discrete Fourier transform (DFT) of real signals: in C (`base/kernels/fourier.c`), or with NumPy."""

from functools import lru_cache

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.kernels import call, is_wide


def real_dft(x: FloatArray, lines: IntArray | None = None, out: ComplexArray | None = None) -> ComplexArray:
    """Return the DFT (P, F, c) of each of the P periods of N samples of x (P, N, c) at lines (F,), all by default.

    out (P, c, F): memory for the result, in which the numbers of a channel are contiguous.
    """
    (P, N, c), plan, x = x.shape, _plan(x.shape[1]), np.asarray(x, np.float64)
    lines = np.arange(N // 2 + 1) if lines is None else lines
    out = np.empty((P, c, len(lines)), np.complex128) if out is None else out
    if plan is None or not is_wide():
        for period, dft in zip(x, out, strict=True):
            dft[:] = np.fft.rfft(period, axis=0)[lines].T
        return out.swapaxes(1, 2)
    periods, channels = np.arange(P)[:, None], np.arange(c)
    addresses = [a.ctypes.data + a.strides[0] * periods + a.strides[i] * channels for a, i in ((x, 2), (out, 1))]
    call("real_dft", N, P * c, len(lines), x.strides[1] // x.itemsize, *addresses, lines, *plan)
    return out.swapaxes(1, 2)


@lru_cache(maxsize=4)
def _plan(N: int) -> tuple[IntArray, IntArray, ComplexArray] | None:
    """Return the factors of N / 2, digit-reversed indices of the lines (N / 2 + 1,) and roots of unity.

    None if N is odd or too large, or a factor exceeds 13.
    """
    factors, order, quotient = [], np.zeros(1, np.int64), N // 2
    for factor in (8, 4, *range(2, 14)):
        while quotient and quotient % factor == 0:
            factors.append(factor)
            quotient //= factor
    if N % 2 or quotient != 1 or not factors or N > 1 << 19:  # work space above 64 MB
        return None
    for factor in reversed(factors):
        order = (order[:, None] + len(order) * np.arange(factor)).ravel()
    return (
        np.array(factors),
        np.append(order, 0),
        np.concatenate([np.exp(-2j * np.pi * np.arange(n) / n) for n in (N, *factors)]),
    )
