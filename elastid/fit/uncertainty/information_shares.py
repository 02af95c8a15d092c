r"""Which configurations and which lines inform which parameter, and which combination is known worst.

.. math:: s_{ci} = \frac{[A^{-1} A_c A^{-1}]_{ii}}{[A^{-1}]_{ii}}, \qquad A = \sum_c A_c, \quad \sum_c s_{ci} = 1

s is the share of the variance of x_i that the weighted residuals of configuration c, or of one line, bring in: where
they are, there a change of the data would move the estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, frozen
from elastid.fit.uncertainty.line_sums import Evidence


@dataclass(frozen=True)
class Informed:
    """share (Q, n_x) of each configuration; band_hz (n_x, 2): the middle half of the information on each parameter.

    weakest (n_x,): the direction that is known worst, in x scaled by the length of the columns of J, of length one.
    """

    share: FloatArray
    band_hz: FloatArray
    weakest: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("share", "band_hz", "weakest"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def informed(parts: Sequence[Evidence], A_inverse: FloatArray, weakest: FloatArray) -> Informed:
    """The shares of all configurations and the band of each parameter; A_inverse (n_x, n_x) over what data reach."""
    power = [_by_line(part, A_inverse) for part in parts]
    total = np.sum([np.sum(each, axis=0) for each in power], axis=0)
    total[total == 0] = np.nan
    freq_hz = np.concatenate([part.freq_hz for part in parts])
    order = np.argsort(freq_hz, kind="stable")
    rising = np.cumsum(np.concatenate(power)[order], axis=0) / total
    columns = np.nan_to_num(rising.T, nan=1.0)
    places = np.array([np.searchsorted(column, (0.25, 0.75)) for column in columns])
    band = freq_hz[order][np.minimum(places, len(freq_hz) - 1)]
    return Informed(np.array([np.sum(each, axis=0) / total for each in power]), band, weakest)


def _by_line(part: Evidence, A_inverse: FloatArray) -> FloatArray:
    """[A^-1 A_k A^-1]_ii (F, n_x) of each line."""
    moved = (part.rows @ A_inverse) ** 2
    each: FloatArray = moved.reshape(len(part.freq_hz), -1, moved.shape[1]).sum(axis=1)
    return each
