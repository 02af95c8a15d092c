"""A low-pass filter of finite length: behind it, no sample depends on those further away than half its length.

A sample that a wrong model spoils, as while a joint sticks, then spoils only its neighbours, and the equations of all
others hold exactly (modulating functions: Shinbrot, Trans. ASME 79, 1957).
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import maximum_filter1d
from scipy.signal import upfirdn

from elastid.base.arrays import BoolArray, FloatArray

# Boxes whose convolution the taps are, and their width over a period of the passband for -3 dB at its end.
_BOXES, _WIDTH = 6, 0.1863


def b_spline_taps(rate_hz: float, passband_hz: float) -> FloatArray:
    r"""Taps (2 h + 1,) of unit sum: |H(f)| = |sinc(w f)|^6 with w = 0.1863 / passband."""
    half = _BOXES / 2 * _WIDTH * rate_hz / passband_hz  # samples
    h = max(1, int(half))
    spline = BSpline.basis_element(np.linspace(-half, half, _BOXES + 1), extrapolate=False)
    taps = np.nan_to_num(spline(np.arange(-h, h + 1)))
    return np.asarray(taps / taps.sum())


def filtered(column: FloatArray, taps: FloatArray, kept: slice) -> FloatArray:
    """The samples of a slice, further than half the filter from the ends, of a column (n, ...) along its first axis."""
    h = len(taps) // 2
    before = h + -2 * h % kept.step  # a whole number of steps before the end of the taps
    sums = upfirdn(taps, column[kept.start - before : kept.stop + h], 1, kept.step, axis=0)
    first = (before + h) // kept.step
    return np.asarray(sums[first : first + len(range(kept.start, kept.stop, kept.step))])


def within(samples: BoolArray, reach: int) -> BoolArray:
    """True for each sample (n,) with one of the given ones at most `reach` samples away."""
    return np.asarray(maximum_filter1d(samples.astype(np.uint8), 2 * reach + 1, mode="constant") > 0)
