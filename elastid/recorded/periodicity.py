r"""Whether a recorded excitation repeats with the stated period, and otherwise with which: by autocorrelation.

.. math:: \rho(l) = \frac{\sum_t x(t)\, x(t + l)}{\sqrt{\sum_t x(t)^2 \sum_t x(t + l)^2}}

A part of the signal that repeats, and noise in the rest, have the same rho after one, two and more periods; a slow
motion that resembles itself after some lag does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.recorded.repair.clock import at_times

# Correlation of a repetition at least, and where several periods show that the rest is noise: that has less power then.
MIN_CORRELATION = 0.95
_MIN_NOISY_CORRELATION = 0.5
# The rest is noise where so many periods have correlations that differ by no more than this part.
_MIN_NOISY_PERIODS = 4
_MAX_CORRELATION_CHANGE = 0.1
# The change from one repetition to the next is noise where its autocorrelation, from lags of a twentieth to a half of a
# repetition, is at most this; the change of a motion is as slow as the motion.
_MIN_REST_LAG = 0.05
_MAX_REST_CORRELATION = 0.3
# A stated period is wrong where another leaves a fifth, and 1 % of the signal's power, less unexplained.
_MAX_UNEXPLAINED_RATIO = 1.2
_UNEXPLAINED_MARGIN = 0.01
# So many periods of the log are two of them, of which the second may end early.
MIN_PERIODS = 1.9
# Peaks with at least this part of the highest one are looked at closely, at this spacing in samples.
_MIN_PART_OF_BEST = 0.8
_FINE_STEP = 0.02


@dataclass(frozen=True)
class Repetition:
    """How well signals repeat after the stated lag, and the lag (in samples, not always whole) that repeats them best.

    correlation: with themselves at the stated lag.  best_correlation: at best_samples; both count minus a half wave
    as a repetition where the study states it.  best_samples is 0 where they repeat at no lag.  rest_is_noise: several
    repetitions agree that what does not repeat is noise.
    """

    correlation: float
    best_samples: float
    best_correlation: float
    rest_is_noise: bool = False

    @property
    def is_as_stated(self) -> bool:
        """Whether the stated lag repeats the signals, as well as any other does."""
        least = _MIN_NOISY_CORRELATION if self.rest_is_noise else MIN_CORRELATION
        return self.correlation >= least and _is_as_good(self.correlation, self.best_correlation)


def repetition(signals: FloatArray, lag: int, sign: int = 1) -> Repetition:
    """How signals (n, c), NaN where missing, repeat after lag samples, with sign -1 as x(t + lag) = -x(t).

    The signal that repeats best stands for all: not every input is excited in every experiment.  One repetition is
    compared with the next and, to detect a period that is off by a fraction of a sample, with many later ones.  Means
    and ramps of each lag are removed first: a position that drifts still repeats.
    """
    found = [_repetition(x, lag, sign) for x in signals.T if _moves(x)]
    return max(found, key=lambda each: (each.is_as_stated, each.best_correlation), default=Repetition(0.0, 0.0, 0.0))


def find_period(signals: FloatArray) -> Repetition:
    """The shortest lag after which one of the signals (n, c) repeats, least drift; best_samples 0 where none does."""
    found = [_found(x) for x in signals.T if _moves(x)]
    return max(found, key=_rank, default=Repetition(0.0, 0.0, 0.0))


def _moves(x: FloatArray) -> bool:
    return bool(np.isfinite(x).any() and np.nanmax(x) > np.nanmin(x))


def _repetition(x: FloatArray, lag: int, sign: int, starts: bool = True) -> Repetition:
    """The verdict on one signal (n,); starts: its first repetition may hold the start from rest."""
    # Repetitions at the end that are missing altogether show nothing.
    known = np.flatnonzero(np.isfinite(x))
    x = x[: max(int(known.max(initial=-1)) + 1, 2 * lag)]
    n = len(x)
    if n < MIN_PERIODS * lag or lag < 1 or known.size == 0:
        return Repetition(0.0, 0.0, 0.0)
    flat = without_ramps(x[:, None], lag)[:, 0] if n >= 2 * lag else _levelled(x, lag)
    rho = autocorrelation(flat)
    P = len(flat) // lag
    here = Repetition(_at(rho, lag, sign), float(lag), 0.0, _rest_is_noise(rho, lag, sign))
    for repeats in sorted({1, max(1, P // 2)}):
        middle = repeats * lag
        near = sign**repeats * rho[max(1, middle - lag // 2) : middle + lag // 2 + 1]
        here = replace(here, correlation=_at(rho, middle, sign**repeats), best_correlation=float(near.max(initial=0.0)))
        if not here.is_as_stated:
            # Estimators leave the first repetition out where it differs.
            if starts and n >= 3 * lag and (later := _repetition(x[lag:], lag, sign, starts=False)).is_as_stated:
                return later
            other = max((_anywhere(flat), _found(x)), key=_rank)
            return replace(other, correlation=here.correlation)
    return here


def _found(x: FloatArray) -> Repetition:
    """The lag at which a signal (n,) repeats, whether it drifts or not."""
    ways = (x - np.nanmean(x), without_ramps(x[:, None], len(x))[:, 0])
    found = max((_anywhere(way) for way in ways), key=_rank)
    return _anywhere(_levelled(x, round(found.best_samples))) if found.best_samples else found


def _levelled(x: FloatArray, lag: int) -> FloatArray:
    """A signal (n,) without its mean and its drift, which is what a repetition differs by in the mean."""
    change = x[lag:] - x[:-lag]
    drift = float(np.nanmean(change)) / lag if np.isfinite(change).any() else 0.0
    level = x - drift * np.arange(len(x))
    return np.asarray(level - np.nanmean(level))


def _rank(found: Repetition) -> tuple[bool, float]:
    return found.best_samples > 0, found.best_correlation


def _at(rho: FloatArray, lag: int, sign: int) -> float:
    return sign * float(rho[lag]) if lag < len(rho) else 0.0


def _is_as_good(correlation: float, best: float) -> bool:
    return 1 - correlation <= _MAX_UNEXPLAINED_RATIO * (1 - best) + _UNEXPLAINED_MARGIN


def _rest_is_noise(rho: FloatArray, lag: float, sign: int = 1) -> bool:
    """Whether the correlations after one, two, ... repetitions, over half of the log at least, are the same.

    And whether d(t) = x(t + T) - x(t) is noise: its autocorrelation is 2 rho(l) - rho(T + l) - rho(T - l) of x(t)^2.
    """
    n = len(rho) * 8 / 7
    if n < _MIN_NOISY_PERIODS * lag:
        return False
    repeats = np.arange(1, int(n / lag) // 2 + 1)
    lags = np.round(repeats * lag).astype(int)
    # A lag that is not whole has its peak at one of two samples.
    near = np.clip(lags + np.array([-1, 0, 1])[:, None], 0, len(rho) - 1)
    beside = np.max((float(sign) ** repeats) * rho[near], axis=0)
    if np.any(np.abs(beside / max(beside[0], 1e-300) - 1) > _MAX_CORRELATION_CHANGE):
        return False
    T = max(1, round(lag))
    later = np.arange(max(1, round(_MIN_REST_LAG * T)), T // 2 + 1)
    rest = 2 * rho[later] - sign * (rho[T + later] + rho[T - later])
    return bool(np.all(np.abs(rest) <= _MAX_REST_CORRELATION * 2 * max(1 - sign * rho[T], 1e-3)))


def _anywhere(x: FloatArray) -> Repetition:
    """The shortest lag, two of which fit, after which a signal (n,) repeats as well as after any other."""
    rho = autocorrelation(x)[: int(len(x) / MIN_PERIODS) + 1]
    beyond_first_lobe = np.flatnonzero(rho < 0.5)
    if beyond_first_lobe.size == 0:
        return Repetition(0.0, 0.0, 0.0)
    start = int(beyond_first_lobe[0])
    highest = float(rho[start:].max())
    peaks = (
        start + 1 + np.flatnonzero((rho[start + 1 : -1] >= rho[start:-2]) & (rho[start + 1 : -1] > rho[start + 2 :]))
    )
    peaks = peaks[rho[peaks] > max(_MIN_PART_OF_BEST * highest, _MIN_NOISY_CORRELATION)]
    if peaks.size == 0:
        return Repetition(0.0, 0.0, highest)
    whole = autocorrelation(x)
    best = max(highest, _refined(whole, int(peaks[np.argmax(rho[peaks])]))[1])
    for peak in peaks:
        period, correlation = _refined(whole, int(peak))
        if not _is_as_good(correlation, best):
            continue
        if correlation >= MIN_CORRELATION or _rest_is_noise(whole, period):
            return Repetition(0.0, _from_later(whole, period), correlation)
    return Repetition(0.0, 0.0, best)


def _refined(rho: FloatArray, peak: int) -> tuple[float, float]:
    """The place, between samples, of a peak of rho, and its height."""
    first, last = max(0, peak - 64), min(len(rho), peak + 65)
    times = np.arange(-1, 1 + _FINE_STEP / 2, _FINE_STEP) + (peak - first)
    fine = at_times(rho[first:last, None], times, float(last - first))[:, 0]
    i = int(np.clip(np.argmax(fine), 1, len(fine) - 2))
    bend, tilt = fine[i - 1] - 2 * fine[i] + fine[i + 1], fine[i - 1] - fine[i + 1]
    part = float(np.clip(tilt / (2 * bend), -1, 1)) if bend < 0 else 0.0
    return first + float(times[i]) + part * _FINE_STEP, float(fine.max())


def _from_later(rho: FloatArray, period: float) -> float:
    """The period from later repetitions, each searched for near its prediction from the earlier ones."""
    for repeats in range(2, int(len(rho) / period) + 1):
        around: IntArray = np.arange(-3, 4) + round(repeats * period)
        around = around[(around > 0) & (around < len(rho) - 1)]
        if around.size == 0:
            break
        period = _refined(rho, int(around[np.argmax(rho[around])]))[0] / repeats
    return period


def autocorrelation(x: FloatArray) -> FloatArray:
    """rho (n - n // 8,) of a signal (n,) after 0, 1, ... samples, over the samples that overlap, at least n // 8.

    Missing samples (NaN) and their partners do not count.
    """
    n = len(x)
    n_fft = 1 << (2 * n - 1).bit_length()
    known = np.isfinite(x)
    X = np.fft.rfft(np.where(known, x, 0.0), n_fft)
    product = np.fft.irfft(np.abs(X) ** 2, n_fft)[:n]
    if known.all():
        power = np.cumsum(x**2)
        first, last = power[::-1], power[-1] - np.concatenate([[0.0], power[:-1]])
    else:
        squares, there = np.fft.rfft(np.where(known, x, 0.0) ** 2, n_fft), np.fft.rfft(known.astype(float), n_fft)
        first, last = (np.fft.irfft(c, n_fft)[:n] for c in (squares.conj() * there, there.conj() * squares))
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(np.maximum(first, 0.0) * np.maximum(last, 0.0))
        # Rounding in what is nothing beside the signal correlates with anything.
        rho = np.where(size > 1e-12 * max(float(size[0]), 1e-300), product / size, 0.0)
    return np.asarray(np.nan_to_num(rho, posinf=0.0, neginf=0.0)[: n - n // 8], dtype=np.float64)


def without_ramps(signals: FloatArray, block: int) -> FloatArray:
    """Signals (n, c) without the mean and the slope of every whole block of samples (least squares, NaN left out)."""
    n, c = signals.shape
    whole = signals[: n // block * block].reshape(-1, block, c)
    t = np.broadcast_to(np.arange(block)[None, :, None] - (block - 1) / 2, whole.shape)
    known = np.isfinite(whole)
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    mean = np.where(known, whole, 0.0).sum(axis=1, keepdims=True) / count
    centred = np.where(known, t - np.where(known, t, 0.0).sum(axis=1, keepdims=True) / count, 0.0)
    away = whole - mean
    spread = np.sum(centred**2, axis=1, keepdims=True)
    slope = np.sum(centred * np.where(known, away, 0.0), axis=1, keepdims=True) / np.where(spread > 0, spread, 1.0)
    return np.asarray((away - slope * centred).reshape(-1, c))
