r"""Interpolation of missing samples: repetition of the period plus a polynomial through the samples beside a gap.

.. math:: \hat x(t) = r(t) + h(t), \qquad r(t) = \text{mean}_{p} \, s^{p} x(t + p L)

r: mean of other periods; h: polynomial fitted to x - r on both sides of the gap (Savitzky and Golay, Anal. Chem. 36,
1964). Periods that contain a transient, and polynomials that follow noise, are worse references: each candidate (set of
periods, degree) is tried on gaps of the same length beside the gap, where the samples are measured, and the one with
the smallest error is taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from statistics import NormalDist

import numpy as np

from elastid.base.arrays import FloatArray, IntArray, true_runs
from elastid.base.statistics import STD_OVER_MAD

# Degree of the polynomial, and samples on each side of the gap that it is fitted to.
_POLYNOMIALS = ((0, 16), (3, 2), (1, 2))
_TRIALS = 32  # samples on each side of the gap for trial gaps
# Quantile of deviations that is robust against damaged samples, and the same quantile of the absolute value of a
# standard normal variable.
QUIET_FRACTION = 0.75
QUIET_STD = NormalDist().inv_cdf((1 + QUIET_FRACTION) / 2)
_TRIAL_GAP = 8  # longest trial gap in samples
MAX_BRIDGED = 2  # longest gap in samples for a polynomial without another period
_MAX_STEP = 2.0  # largest step to an interpolated sample, relative to the largest step of the signal


@dataclass(frozen=True)
class Interpolation:
    """Interpolated values (g,) of a gap, and the standard deviation of the interpolation on trial gaps beside it."""

    values: FloatArray
    error: float


def interpolations(x: FloatArray, L: int, sign: int) -> Iterator[tuple[slice, Interpolation | None]]:
    """Interpolate the gaps of a signal x (n,), NaN where missing, that repeats after L samples.

    sign: -1 where x(t + L) = -x(t).  None without a candidate: a gap of more than two samples that no other period
    covers, or values that change by more than twice the largest step of the signal from one sample to the next.
    """
    steps = np.abs(np.diff(x))
    max_step = float(np.nanmax(steps)) if np.isfinite(steps).any() else np.inf
    for start, end in true_runs(~np.isfinite(x)):
        yield slice(start, end), _interpolation(x, start, end, L, sign, max_step)


def _interpolation(x: FloatArray, start: int, end: int, L: int, sign: int, max_step: float) -> Interpolation | None:
    half_width = _TRIALS + max(width for _, width in _POLYNOMIALS)
    rows = np.arange(max(0, start - half_width), min(len(x), end + half_width))
    gap = slice(start - int(rows[0]), end - int(rows[0]))
    best = None
    for reference, (degree, width) in product(_references(x, rows, gap, L, sign), _POLYNOMIALS):
        candidate = _fit_gap(x[rows] - reference, gap, degree, width)
        if candidate is None or (best is not None and candidate.error >= best.error):
            continue
        values = reference[gap] + candidate.values
        with_ends = np.concatenate([x[rows[: gap.start]][-1:], values, x[rows[gap.stop :]][:1]])
        if not np.any(np.abs(np.diff(with_ends)) > _MAX_STEP * max_step):
            best = Interpolation(values, candidate.error)
    return best


def _references(x: FloatArray, rows: IntArray, gap: slice, L: int, sign: int) -> Iterator[FloatArray]:
    """Yield means (m,) of other periods at rows (m,), finite in the gap; last, for a short gap, zero.

    The first period, whose transient adds up over a long gap, is in the reference of one only if no other has the gap.
    """
    is_short = gap.stop - gap.start <= MAX_BRIDGED
    shifts = np.array([p for p in range(-(len(x) // L), len(x) // L + 1) if p != 0])
    at = rows + shifts[:, None] * L
    is_inside = (at >= 0) & (at < len(x))
    values = np.where(is_inside, x[np.where(is_inside, at, 0)], np.nan) * (float(sign) ** shifts)[:, None]
    for first in (L, 0):
        candidates = np.where(at >= first, values, np.nan)
        n = np.isfinite(candidates).sum(axis=0)
        if np.all(n[gap] > 0):
            yield np.where(n > 0, np.nansum(candidates, axis=0) / np.maximum(n, 1), np.nan)
            if not is_short:
                return
    if is_short:
        yield np.zeros(len(rows))


def _fit_gap(e: FloatArray, gap: slice, degree: int, width: int) -> Interpolation | None:
    """Fit a polynomial (g,) through the finite samples e (m,) on both sides of a gap, if they are enough."""
    g = gap.stop - gap.start
    offsets = np.r_[-width:0, g : g + width]
    at = gap.start + offsets
    is_usable = (at >= 0) & (at < len(e))
    is_usable[is_usable] = np.isfinite(e[at[is_usable]])
    offsets = offsets[is_usable]
    n_before, n_after = int(np.sum(offsets < 0)), int(np.sum(offsets >= g))
    if min(n_before, n_after) < (degree + 1) // 2 or n_before + n_after <= degree:
        return None
    g_trial = min(g, _TRIAL_GAP)
    trial_offsets = np.where(offsets < 0, offsets, offsets - g + g_trial)
    error = _trial_error(e, trial_offsets, _weights(tuple(trial_offsets.tolist()), g_trial, degree))
    beside = e[gap.start + offsets]
    # A transient at a few of these samples hardly changes the trial error.
    misfit = float(np.std(beside)) if degree == 0 else 0.0
    return Interpolation(_weights(tuple(offsets.tolist()), g, degree) @ beside, max(error, misfit))


@lru_cache(maxsize=256)
def _weights(offsets: tuple[int, ...], g: int, degree: int) -> FloatArray:
    """Return weights (g, k) of the least-squares polynomial for a gap of g samples with neighbours at offsets (k,)."""
    centred = np.array([*offsets, *range(g)]) - (g - 1) / 2
    powers = np.vander(centred / np.abs(centred).max(), degree + 1)
    return powers[len(offsets) :] @ np.linalg.pinv(powers[: len(offsets)])


def _trial_error(e: FloatArray, offsets: IntArray, weights: FloatArray) -> float:
    """Estimate the interpolation error of weights (g, k) from trial gaps at all samples of e (m,).

    The quantile QUIET_FRACTION ignores a few damaged samples nearby, but not a transient on one side.
    """
    inner = np.arange(len(weights))
    first, last = -min(int(offsets.min()), 0), max(int(offsets.max()), len(weights) - 1)
    if len(e) <= first + last:
        return np.inf
    windows = np.lib.stride_tricks.sliding_window_view(e, first + last + 1)
    errors = windows[:, first + inner] - windows[:, first + offsets] @ weights.T
    errors = errors[np.isfinite(errors).all(axis=1)]
    return float(np.quantile(np.abs(errors), QUIET_FRACTION) / QUIET_STD) if errors.size else np.inf


def period_noise(x: FloatArray, L: int, sign: int) -> float:
    """Estimate the noise of a signal (P L,), NaN if missing: robust change between consecutive periods over root two.

    The smallest of all pairs: a transient adds to the first ones.
    """
    change = (x[L:] - sign * x[:-L]).reshape(-1, L)
    change = change[np.isfinite(change).any(axis=1)]
    away = np.abs(change - np.nanmedian(change, axis=1, keepdims=True))
    return float(STD_OVER_MAD * np.nanmedian(away, axis=1).min(initial=np.inf) / np.sqrt(2))
