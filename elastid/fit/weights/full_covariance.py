r"""The covariance with which the elements of a line weigh together, and its Cholesky factor.

.. math:: C = \tilde C + diag(\alpha^2 |\hat G|^2) = L L^H

C~ is the measured covariance of vec G, smoothed over lines (`smoothed_noise`), alpha the floor of the study.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.errors import DataError
from elastid.fit.weight_spec import WeightSpec
from elastid.fit.weights.smoothed_noise import SmoothedNoise
from elastid.response import Covariance, FrequencyResponse

# The smallest eigenvalue of the correlations, relative to the largest, that is not taken for rounding.
EIGENVALUE_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class Whitening:
    """Whitens errors relative to sigma (F, n_y, n_u), inf where an element is left out; small, since not worked out.

    noise: C~.  floor (F, n_y, n_u): alpha |G|.  phase (F, n_y, n_u): factors of modulus one between the residual and
    the error of G.
    """

    noise: Covariance
    floor: FloatArray
    sigma: FloatArray
    phase: ComplexArray | FloatArray

    @property
    def matrix(self) -> ComplexArray:
        """L^-1 diag(sigma phase) (F, n_y n_u, n_y n_u), elements in the order of G; computed at every call."""
        return whitening(self.noise.full(), self.floor, self.sigma, self.phase)

    def lines(self, keep: BoolArray | slice) -> Whitening:
        """The same on some lines."""
        kept = np.zeros(len(self.sigma), dtype=np.bool_)
        kept[keep] = True
        return Whitening(self.noise.lines(kept), self.floor[keep], self.sigma[keep], self.phase[keep])


def weighs_correlations(
    response: FrequencyResponse, smooth: SmoothedNoise | None, sigma: FloatArray, spec: WeightSpec
) -> bool:
    """True if C~ weighs the elements of a line jointly, False if each element counts by itself.

    smooth: the noise.  sigma (F, n_y, n_u): what elements weigh, inf where they are left out.
    Raises DataError where `full` is asked for and no covariance is known, or it is singular and no floor makes it
    regular.
    """
    asked, where = spec.covariance == "full", f"configuration {response.configuration.name}"
    if spec.covariance == "diagonal" or (not asked and (smooth is None or smooth.is_diagonal)):
        return False
    if smooth is None or smooth.is_diagonal:
        raise DataError(
            f"{where}: fit.weights.covariance is full, but only {'variances are' if smooth else 'nothing is'} known of "
            "its noise; take auto or diagonal, or measure more periods or realisations"
        )
    flaw = _flaw(response, smooth.covariance, sigma) if spec.floor == 0 else ""
    if flaw and asked:
        raise DataError(f"{where}: {flaw}; take fit.weights.covariance: diagonal, or a floor above zero")
    return not flaw


def whitening(
    noise: ComplexArray, floor: FloatArray, sigma: FloatArray, phase: ComplexArray | FloatArray
) -> ComplexArray:
    """L^-1 diag(sigma phase) (F, m, m) that whitens errors relative to sigma; elements in the order of G, row by row.

    noise (F, m, m): vec column-major.  floor, sigma, phase (F, n_y, n_u): alpha |G|, inf where an element is left out,
    and factors of modulus one between the residual and the error of G.
    """
    F, n_y, n_u = sigma.shape
    row_by_row = np.arange(n_y * n_u).reshape(n_u, n_y).T.ravel()
    C = noise[:, row_by_row[:, None], row_by_row].copy()
    used = np.isfinite(sigma).reshape(F, -1)
    s = np.where(used, sigma.reshape(F, -1), 1.0)
    diagonal = np.arange(n_y * n_u)
    C[:, diagonal, diagonal] += floor.reshape(F, -1) ** 2
    both = used[:, :, None] & used[:, None, :]
    relative = np.where(both, C / (s[:, :, None] * s[:, None, :]), 0.0)
    relative[:, diagonal, diagonal] += ~used
    L_inverse = np.linalg.inv(np.linalg.cholesky(relative))
    return np.asarray(L_inverse * phase.reshape(F, 1, -1))


def _flaw(response: FrequencyResponse, C: ComplexArray, sigma: FloatArray) -> str:
    """The flaw of the correlations of the elements that count, empty without one."""
    deviation = np.sqrt(np.einsum("faa->fa", C).real)
    deviation[deviation == 0] = np.inf
    R = C / (deviation[:, :, None] * deviation[:, None, :])
    used = np.swapaxes(np.isfinite(sigma), 1, 2).reshape(len(sigma), -1)
    part = np.where(used[:, :, None] & used[:, None, :], R, 0.0)
    diagonal = np.arange(R.shape[1])
    part[:, diagonal, diagonal] = 1.0
    values = np.linalg.eigvalsh(part)
    bad = np.flatnonzero(values[:, 0] < EIGENVALUE_TOLERANCE * values[:, -1])
    if not bad.size:
        return ""
    return (
        f"the covariance of its elements is singular at {bad.size} of {len(R)} lines, first at "
        f"{response.freq_hz[bad[0]]:g} Hz (smallest eigenvalue {values[bad[0], 0]:.1e} of the correlations)"
    )
