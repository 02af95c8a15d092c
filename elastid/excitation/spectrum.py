r"""Amplitude spectra: how the power of a multisine is spread over its lines.

.. math:: A_{ki} = a_i\, s(f_k) / |T_{ii}(f_k)|, \qquad \tfrac12 \sum_k A_{ki}^2 = \mathrm{rms}_i^2

s: power law times table.  T: response, known beforehand, from injected torque to what is to be flat.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.arrays import FloatArray


def shape(freq_hz: FloatArray, power: float, table: Sequence[tuple[float, float]]) -> FloatArray:
    """s (F,), relative: f^power, times the table of (frequency, amplitude) points where there is one.

    The table is straight lines on log-log axes and constant beyond its ends.
    """
    relative: FloatArray = (freq_hz / freq_hz[0]) ** power
    if table:
        frequency, amplitude = np.log(np.array(sorted(table))).T
        relative = relative * np.exp(np.interp(np.log(freq_hz), frequency, amplitude))
    return relative


def amplitudes(relative: FloatArray, rms: FloatArray) -> FloatArray:
    """A (F, n_u) of the given relative amplitude, (F,) or (F, n_u), with sum_k A_ki^2 / 2 = rms_i^2.

    rms (n_u,): of each input over a period.
    """
    columns = relative if relative.ndim == 2 else relative[:, None]
    A: FloatArray = columns * np.sqrt(2 / np.sum(columns**2, axis=0)) * rms
    return A
