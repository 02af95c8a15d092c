r"""The covariance with which the elements of a line weigh together, and its Cholesky factor.

.. math:: C = \frac{\nu}{\nu - m}\, \tilde v^{1/2} R\, \tilde v^{1/2} + diag(\alpha^2 |\hat G|^2) = L L^H

R are the measured correlations of vec G, m how many elements are correlated in it (n_y in the Kronecker form), nu its
degrees of freedom: the inverse of a covariance of m elements estimated from nu of them is nu / (nu - m) too large.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError
from elastid.fit.spec import WeightSpec
from elastid.response import Covariance, FrequencyResponse

# Degrees of freedom for each correlated element from which `auto` takes the full covariance: its weights then make the
# variance of the estimate 1 / 9 larger than those of a known one.
MIN_DOF_PER_ELEMENT = 10
# The smallest eigenvalue of the correlations, beside the largest, that is not taken for rounding.
EIGENVALUE_TOLERANCE = 1e-10


def correlated_noise(
    response: FrequencyResponse, variance: FloatArray, sigma: FloatArray, spec: WeightSpec
) -> ComplexArray | None:
    """nu / (nu - m) v~^1/2 R v~^1/2 (F, n_y n_u, n_y n_u), vec column-major; None for weights element by element.

    variance, sigma (F, n_y, n_u): v~, and what elements weigh, inf where they are left out.
    Raises DataError where `full` is asked for and no covariance is known, it has too few degrees of freedom, or it is
    singular and no floor makes it regular.
    """
    known, asked = response.uncertainty, spec.covariance == "full"
    where = f"configuration {response.configuration.name}"
    if spec.covariance == "diagonal" or (not asked and (known is None or known.form == "diagonal")):
        return None
    if known is None or known.form == "diagonal":
        raise DataError(
            f"{where}: fit.weights.covariance is full, but only {'variances are' if known else 'nothing is'} known of "
            "its noise; take auto or diagonal, or measure more periods or realisations"
        )
    m = _correlated_elements(known)
    if known.dof <= m or (not asked and known.dof < MIN_DOF_PER_ELEMENT * m):
        if not asked:
            return None
        raise DataError(
            f"{where}: fit.weights.covariance is full, but {known.dof:g} degrees of freedom cannot correlate {m} "
            "elements; take auto or diagonal, or measure more realisations"
        )
    C: ComplexArray = known.full()
    deviation = np.sqrt(np.einsum("faa->fa", C).real)
    deviation[deviation == 0] = np.inf
    R = np.asarray(C / (deviation[:, :, None] * deviation[:, None, :]), np.complex128)
    diagonal = np.arange(R.shape[1])
    R[:, diagonal, diagonal] = 1.0
    flaw = _flaw(response, R, sigma) if spec.floor == 0 else ""
    if flaw and asked:
        raise DataError(f"{where}: {flaw}; take fit.weights.covariance: diagonal, or a floor above zero")
    if flaw:
        return None
    v = np.sqrt(np.swapaxes(variance, 1, 2).reshape(len(variance), -1))
    correction = known.dof / (known.dof - m) if np.isfinite(known.dof) else 1.0
    return np.asarray(correction * v[:, :, None] * R * v[:, None, :])


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


def _correlated_elements(known: Covariance) -> int:
    _, n_y, n_u = known.variance.shape
    return int(n_y * n_u if known.form == "full" else n_y)


def _flaw(response: FrequencyResponse, R: ComplexArray, sigma: FloatArray) -> str:
    """What is wrong with the correlations of the elements that count, or nothing."""
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
