"""Delay between two logs that hold the same signal: y(t) = x(t - delay), periodic with N samples."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.recorded.repair.repeats import blocks

# Correlation at the best delay at least; below, the signals are not the same.
MIN_CORRELATION = 0.5


def delay(first: FloatArray, second: FloatArray, N: int) -> tuple[float, float]:
    """Delay of the second signal (n,) against the first, in samples from -N/2 to N/2, and their correlation there.

    Of the mean periods; the fraction of a sample comes from the phase of their cross-spectrum.
    """
    X, Y = (np.fft.rfft(blocks(x, N).mean(axis=0)) for x in (first, second))
    C = Y * X.conj()
    C[0] = 0.0
    together = np.fft.irfft(C, N)
    size = np.sqrt(np.sum(np.abs(X[1:]) ** 2) * np.sum(np.abs(Y[1:]) ** 2))
    at = int(np.argmax(together))
    whole = at - N if at > N // 2 else at
    turns = 2j * np.pi * np.arange(len(C)) / N
    tau = float(whole)
    for _ in range(5):
        phasor = C * np.exp(turns * tau)
        bend = float(np.sum((turns**2 * phasor).real))
        if bend >= 0:
            break
        tau -= float(np.clip(np.sum((turns * phasor).real) / bend, -0.5, 0.5))
    best = float(np.sum((C * np.exp(turns * tau)).real))
    return tau, best / size if size > 0 else 0.0
