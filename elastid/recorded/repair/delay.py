"""Delay between two logs that hold the same signal: y(t) = x(t - delay), periodic with N samples."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.recorded.repair.repeats import blocks

# Correlation at the best delay at least; below, the signals are not the same.
MIN_CORRELATION = 0.5
_NEWTON_STEPS = 5


def delay(first: FloatArray, second: FloatArray, N: int | None) -> tuple[float, float]:
    """Delay of the second signal (n,) against the first, in samples from -N/2 to N/2, and their correlation there.

    Of the mean periods, or of the whole signals without a period (N None); the fraction of a sample comes from the
    phase of their cross-spectrum.
    """
    if N is None:
        N = 2 * max(len(first), len(second))
        first, second = (np.concatenate([x - x.mean(), np.zeros(N - len(x))]) for x in (first, second))
    X, Y = (np.fft.rfft(blocks(x, N).mean(axis=0)) for x in (first, second))
    C = Y * X.conj()
    C[0] = 0.0
    together = np.fft.irfft(C, N)
    size = np.sqrt(np.sum(np.abs(X[1:]) ** 2) * np.sum(np.abs(Y[1:]) ** 2))
    at = int(np.argmax(together))
    whole = at - N if at > N // 2 else at
    tau = refined_shift(C, N, float(whole))
    return tau, correlation(C, N, tau) / size if size > 0 else 0.0


def correlation(C: ComplexArray, N: int, shift: float) -> float:
    """Re sum_k C_k exp(2 pi j k shift / N) of a cross-spectrum (N // 2 + 1,)."""
    return float(np.sum((C * np.exp(_turns(C, N) * shift)).real))


def refined_shift(C: ComplexArray, N: int, shift: float) -> float:
    """The maximum of the correlation near a shift, by Newton's method; as it is where it is near no maximum."""
    turns = _turns(C, N)
    for _ in range(_NEWTON_STEPS):
        phasor = C * np.exp(turns * shift)
        slope, bend = float(np.sum((turns * phasor).real)), float(np.sum((turns**2 * phasor).real))
        if bend >= 0:
            return shift
        shift -= float(np.clip(slope / bend, -0.5, 0.5))
    return shift


def _turns(C: ComplexArray, N: int) -> ComplexArray:
    return (2j * np.pi * np.arange(len(C)) / N).astype(np.complex128)
