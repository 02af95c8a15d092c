"""Chirps (swept sines) and pseudo-random binary sequences: periodic, limited to the lines of a grid."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray

Sweep: TypeAlias = Literal["linear-sweep", "log-sweep", "prbs"]

# Feedback taps of maximum-length shift registers by their length.
_TAPS = {2: 1, 3: 2, 4: 3, 5: 3, 6: 5, 7: 6, 9: 5, 10: 7, 11: 9, 15: 14, 17: 14, 18: 11}


def sweep_spectrum(kind: Sweep, lines: IntArray) -> ComplexArray:
    """Relative spectrum (F,) of one input at the lines, which are all the lines or all the odd ones of a band."""
    odd = bool(np.all(lines % 2))
    n = 2 * 64 * int(lines[-1])  # samples of a cycle of the highest line: little above half the rate folds back
    length = n // 2 if odd else n
    signal = _binary(length, int(lines[-1])) if kind == "prbs" else _sweep(kind, length, lines, odd)
    period = np.concatenate([signal, -signal]) if odd else signal
    spectrum: ComplexArray = np.fft.rfft(period)[lines]
    spectrum /= np.sqrt(np.mean(np.abs(spectrum) ** 2))
    return spectrum


def _sweep(kind: Sweep, n: int, lines: IntArray, odd: bool) -> FloatArray:
    """Constant amplitude, frequency from the first line to the last."""
    t = np.arange(n) / n
    first, last = lines[[0, -1]] / (2 if odd else 1)  # cycles in the sweep's length
    if kind == "linear-sweep":
        cycles = first * t + (last - first) * t**2 / 2
    else:
        rate = np.log(last / first)
        cycles = first * np.expm1(rate * t) / rate
    return np.asarray(np.sin(2 * np.pi * cycles))


def _binary(n: int, last: int) -> FloatArray:
    """+-1 of a maximum-length sequence whose clock is 2.5 times the highest line or more, stretched over n samples."""
    length = next(bits for bits in _TAPS if 2**bits - 1 >= 2.5 * last or bits == max(_TAPS))
    register = np.ones(length, dtype=np.int64)
    sequence = np.empty(2**length - 1)
    for i in range(len(sequence)):
        sequence[i] = 2 * register[-1] - 1
        feedback = register[-1] ^ register[_TAPS[length] - 1]
        register = np.concatenate([[feedback], register[:-1]])
    return sequence[np.arange(n) * len(sequence) // n]
