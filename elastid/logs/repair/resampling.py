r"""Resampling of signals by a sinc in a Kaiser window of half width W samples.

.. math:: x(t) = \sum_n x(n)\, b\, \mathrm{sinc}(b (t - n))\, I_0(\beta \sqrt{1 - (b (t - n) / W)^2}) / I_0(\beta)

with b = 1, or the ratio of the rates where the new one is lower (Kaiser and Schafer, IEEE Trans. ASSP 28, 1980).
"""

import math

import numpy as np

from elastid.base.arrays import FloatArray, IntArray

RESAMPLED = "samples resampled"
# Half width W in samples and shape beta of the Kaiser window; it passes frequencies up to this part of the rate.
HALF_WIDTH, _BETA, PASSBAND = 32, 9.0, 0.45
# The kernels of so many times are in memory together.
_TIMES_AT_ONCE = 4096


def resample_at(signals: FloatArray, times: FloatArray, period: float | None = None, band: float = 1.0) -> FloatArray:
    """Interpolate signals (n, c) at times (m,) in samples, periodic beyond the ends; band: b, < 1 for a lower rate.

    Without a period (None), the signals are point-symmetric to their first and last samples, which keeps the slope.
    """
    half_width = math.ceil(HALF_WIDTH / band)
    n_before = half_width + max(0, math.ceil(-times.min()))
    extended = _extend(signals, period, n_before, half_width + 1 + max(0, math.ceil(times.max()) - len(signals) + 1))
    result = np.empty((len(times), signals.shape[1]))
    offsets = np.arange(-half_width, half_width + 1)
    for first in range(0, len(times), _TIMES_AT_ONCE):
        nearest, weights = sinc_weights(times[first : first + _TIMES_AT_ONCE], band)
        result[first : first + _TIMES_AT_ONCE] = np.einsum(
            "tk,tkc->tc", weights, extended[nearest[:, None] + n_before + offsets]
        )
    return result


def sinc_weights(t: FloatArray, band: float = 1.0) -> tuple[IntArray, FloatArray]:
    """Compute the samples (m,) nearest to times t (m,), and the weights (m, 2 W / b + 1) of those around them."""
    half_width = math.ceil(HALF_WIDTH / band)
    nearest = np.round(t).astype(np.int64)
    apart = band * ((t - nearest)[:, None] - np.arange(-half_width, half_width + 1))
    inside = np.clip(1 - (apart / HALF_WIDTH) ** 2, 0.0, None)
    weights = band * np.sinc(apart) * np.i0(_BETA * np.sqrt(inside)) / np.i0(_BETA) * (inside > 0)
    # A constant stays a constant.
    return nearest, weights / weights.sum(axis=1, keepdims=True)


def _extend(x: FloatArray, period: float | None, n_before: int, n_after: int) -> FloatArray:
    n = len(x)
    if period is None:
        return np.pad(x, ((n_before, n_after), (0, 0)), "reflect", reflect_type="odd")
    # Each end and its continuation, taken one period further inside.
    first = _values_at(x, np.arange(-n_before, 1.0) + period, period)
    last = _values_at(x, np.arange(n - 1.0, n + n_after) - period, period)
    return np.concatenate([first[:-1] + x[0] - first[-1], x, last[1:] + x[-1] - last[0]])


def _values_at(x: FloatArray, times: FloatArray, period: float) -> FloatArray:
    N = round(period)
    if period != N and len(x) > period + 2 * HALF_WIDTH:
        return resample_at(x, times, N)
    nearest = np.round(times).astype(np.int64)
    return x[
        np.where(nearest < 0, nearest % N, np.where(nearest < len(x), nearest, len(x) - N + (nearest - len(x)) % N))
    ]
