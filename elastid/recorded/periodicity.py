r"""Whether a recorded excitation repeats with the stated period, and otherwise with which: by autocorrelation.

.. math:: \rho(l) = \frac{\sum_t x(t)\, x(t + l)}{\sqrt{\sum_t x(t)^2 \sum_t x(t + l)^2}}
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray

# Correlation of a repetition at least: below, noise has more power than the signal.
_MIN_CORRELATION = 0.5
# A stated period is wrong where another leaves a fifth, and 1 % of the signal's power, less unexplained.
_MAX_UNEXPLAINED_RATIO = 1.2
_UNEXPLAINED_MARGIN = 0.01
# The period is the shortest of the lags with at least this part of the best correlation.
_MIN_PART_OF_BEST = 0.95


@dataclass(frozen=True)
class Repetition:
    """How well signals repeat after the stated lag, and the lag (in samples, not always whole) that repeats them best.

    correlation: with themselves at the stated lag.  best_correlation: at best_samples; both count minus a half wave
    as a repetition where the study states it.  best_samples is 0 where they repeat at no lag.
    """

    correlation: float
    best_samples: float
    best_correlation: float

    @property
    def is_as_stated(self) -> bool:
        """Whether the stated lag repeats the signals, as well as any other does."""
        unexplained = 1 - self.correlation
        return (
            self.correlation >= _MIN_CORRELATION
            and unexplained <= _MAX_UNEXPLAINED_RATIO * (1 - self.best_correlation) + _UNEXPLAINED_MARGIN
        )


def repetition(signals: FloatArray, lag: int, sign: int = 1) -> Repetition:
    """How signals (n, c) repeat after lag samples, with sign -1 as x(t + lag) = -x(t); n must hold two lags.

    The signal that repeats best stands for all: not every input is excited in every experiment.  One repetition is
    compared with the next and, to detect a period that is off by a fraction of a sample, with many later ones.  Means
    and ramps of each lag are removed first: a position that drifts still repeats.
    """
    flat = without_ramps(signals, lag)
    moving = flat[:, np.ptp(flat, axis=0) > 0]
    found = [_repetition(autocorrelation(x), len(signals), lag, sign) for x in moving.T]
    return max(found, key=lambda each: each.best_correlation, default=Repetition(0.0, 0.0, 0.0))


def _repetition(rho: FloatArray, n: int, lag: int, sign: int) -> Repetition:
    for repeats in sorted({1, max(1, n // lag // 2)}):
        middle = repeats * lag
        near = sign**repeats * rho[middle - lag // 2 : middle + lag // 2 + 1]
        here = Repetition(float(near[lag // 2]), float(lag), float(near.max()))
        if not here.is_as_stated:
            return _anywhere(rho, here.correlation)
    return here


def _anywhere(rho: FloatArray, stated: float) -> Repetition:
    """The shortest lag after which the signals repeat as well as after any other."""
    beyond_first_lobe = np.flatnonzero(rho < 0.5)
    if beyond_first_lobe.size == 0:
        return Repetition(stated, 0.0, stated)
    start = int(beyond_first_lobe[0])
    highest = float(rho[start:].max())
    if highest < _MIN_CORRELATION:
        return Repetition(stated, 0.0, highest)
    before, at, after = rho[start:-2], rho[start + 1 : -1], rho[start + 2 :]
    peaks = np.flatnonzero((at >= before) & (at > after))
    # A parabola through three lags: the period need not be a whole number of samples.
    bend, tilt = (before - 2 * at + after)[peaks], (before - after)[peaks]
    good = np.flatnonzero(at[peaks] - tilt**2 / (8 * bend) > _MIN_PART_OF_BEST * highest)
    if good.size == 0:
        return Repetition(stated, float(start + np.argmax(rho[start:])), highest)
    period = float(start + 1 + peaks[good[0]] + tilt[good[0]] / (2 * bend[good[0]]))
    # Later repetitions, each searched for near its prediction from the earlier ones, make the period more exact.
    for repeats in range(2, int(len(rho) / period)):
        around = np.arange(-3, 4) + round(repeats * period)
        around = around[around < len(rho)]
        period = float(around[np.argmax(rho[around])]) / repeats
    return Repetition(stated, period, highest)


def autocorrelation(x: FloatArray) -> FloatArray:
    """rho (n - n // 8,) of a signal (n,) after 0, 1, ... samples, over the samples that overlap, at least n // 8."""
    n = len(x)
    n_fft = 1 << (2 * n - 1).bit_length()
    product = np.fft.irfft(np.abs(np.fft.rfft(x, n_fft)) ** 2, n_fft)[:n]
    power = np.cumsum(x**2)
    first, last = power[::-1], power[-1] - np.concatenate([[0.0], power[:-1]])
    with np.errstate(invalid="ignore", divide="ignore"):
        rho = np.nan_to_num(product / np.sqrt(first * last), posinf=0.0, neginf=0.0)
    return np.asarray(rho[: n - n // 8], dtype=np.float64)


def without_ramps(signals: FloatArray, block: int) -> FloatArray:
    """Signals (n, c) without the mean and the slope of every block of samples (least squares)."""
    n, c = signals.shape
    whole = signals[: n // block * block].reshape(-1, block, c)
    t = np.arange(block) - (block - 1) / 2
    slope = np.einsum("t,btc->bc", t, whole) / np.sum(t**2)
    flat = whole - whole.mean(axis=1, keepdims=True) - slope[:, None] * t[:, None]
    return np.asarray(flat.reshape(-1, c))
