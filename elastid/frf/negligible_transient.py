r"""Whether a transient matters: its error in the mean of a record's periods, against the total standard deviation.

The periods at the start that differ, n_t of P, change the equation error of the mean by

.. math:: \Delta V = \frac{n_t}{P} \left[(\bar Y_t - \bar Y_s) - G (\bar U_t - \bar U_s)\right]

with s the other periods.  To leave them out costs n_t / P of the data; to keep them costs nothing where |Delta V| is
small against the total error, from the scatter of realisations, of the mean of them all: at neighbouring lines
everywhere, since a transient sits at resonances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.frf.spectra import PeriodSpectra

# RMS of the transient's error over the total standard deviation, at most, in each of so many groups of lines.
_MAX_RELATIVE_ERROR = 0.2
_MAX_GROUPS = 20
_MIN_LINES_IN_GROUP = 5


@dataclass(frozen=True)
class TotalError:
    """G (F, n_y, n_u) and the variance (F, n_y) of the outputs' total error in the mean of all realisations.

    lines (F_e,): which of the excited lines these F are.
    """

    G: ComplexArray
    variance: FloatArray
    lines: BoolArray

    def at_every(self, step: int) -> TotalError:
        """The same at every step-th of the excited lines."""
        taken = np.zeros(len(self.lines), dtype=np.bool_)
        taken[::step] = True
        of_G = taken[self.lines]
        return TotalError(self.G[of_G], self.variance[of_G], self.lines[::step])


def is_negligible(spectra: PeriodSpectra, leading: int, total: TotalError) -> bool:
    """Whether the first `leading` periods of a record change G by far less than it scatters anyway."""
    spectra = spectra.on(total.lines)
    dY, dU = (X[:leading].mean(axis=0) - X[leading:].mean(axis=0) for X in (spectra.Y, spectra.U))
    dV = leading / len(spectra.periods) * (dY - np.einsum("fyu,fu->fy", total.G, dU))
    groups = min(_MAX_GROUPS, max(1, len(dV) // _MIN_LINES_IN_GROUP))
    error, variance = (
        np.array([part.sum(axis=0) for part in np.array_split(x, groups)]) for x in (np.abs(dV) ** 2, total.variance)
    )
    return bool(np.all(error <= _MAX_RELATIVE_ERROR**2 * variance))
