r"""Shares of the information on each parameter by configuration and line, and the least determined combination.

.. math:: s_{ci} = \frac{[A^{-1} A_c A^{-1}]_{ii}}{[A^{-1}]_{ii}}, \qquad A = \sum_c A_c, \quad \sum_c s_{ci} = 1

s is the share of the variance of x_i that the weighted residuals of configuration c, or of one line, contribute.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.fit.uncertainty.line_sums import LineSums


@frozen_value
class InformationShares:
    """share (Q, n_x) of each configuration; band_hz (n_x, 2): the middle half of the information on each parameter.

    weakest (n_x,): the least determined direction, of length one, in x scaled by the length of the columns of J.
    """

    share: FloatArray
    band_hz: FloatArray
    weakest: FloatArray


def information_shares(parts: Sequence[LineSums], A_inverse: FloatArray, weakest: FloatArray) -> InformationShares:
    """The shares of all configurations and the band of each parameter; A_inverse (n_x, n_x)
    over the directions that the data reach."""
    power = [_by_line(part, A_inverse) for part in parts]
    total = np.sum([np.sum(each, axis=0) for each in power], axis=0)
    total[total == 0] = np.nan
    freq_hz = np.concatenate([part.freq_hz for part in parts])
    order = np.argsort(freq_hz, kind="stable")
    rising = np.cumsum(np.concatenate(power)[order], axis=0) / total
    columns = np.nan_to_num(rising.T, nan=1.0)
    places = np.array([np.searchsorted(column, (0.25, 0.75)) for column in columns])
    band = freq_hz[order][np.minimum(places, len(freq_hz) - 1)]
    return InformationShares(np.array([np.sum(each, axis=0) / total for each in power]), band, weakest)


def _by_line(part: LineSums, A_inverse: FloatArray) -> FloatArray:
    """[A^-1 A_k A^-1]_ii (F, n_x) of each line."""
    moved = (part.rows @ A_inverse) ** 2
    return np.asarray(moved.reshape(len(part.freq_hz), -1, moved.shape[1]).sum(axis=1))
