r"""G and its covariances at every line from the local fits there.

Closed loop, with N = [I, -G]:

.. math:: G = B_y B_u^{-1}, \qquad dG = N\, dB\, B_u^{-1}
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.frf.covariance import kronecker
from elastid.frf.local.least_squares import LocalFit
from elastid.frf.local.transient import SettledSpectra
from elastid.frf.matrices import adjoint
from elastid.response import Covariance

# Condition of the regressors of a line, at most.
_MAX_CONDITION = 1e9


@dataclass(frozen=True)
class FittedResponse:
    """G (F, n_y, n_u) with its covariances, and their parts.

    B_u (F, n_u, n_u): inputs per reference, in open loop the identity.  left (F, n_u, n_u): cov(vec G) by a residual
    V = Y - G U of covariance C is left (x) C.  C_total (F, n_y, n_y): of V, from the residual, each record times
    sqrt(P).  C_Z (F, n_y + n_u, n_y + n_u): of the noise of [Y; U] in one period, None where nothing separates it.
    """

    G: ComplexArray
    noise: Covariance | None
    total: Covariance
    B_u: ComplexArray
    left: ComplexArray
    C_total: ComplexArray
    C_Z: ComplexArray | None

    def of_residual(self, C_Z: ComplexArray) -> ComplexArray:
        """N C_Z N^H (F, n_y, n_y): covariance of Y - G U from that of [Y; U]."""
        N = _residual_of(self.G)
        return np.asarray(N @ C_Z @ adjoint(N))


def separates_inputs(fit: LocalFit, closed: bool, n_y: int) -> BoolArray:
    """Flags (F,) of the lines where the fit tells the inputs apart."""
    separate = fit.condition < _MAX_CONDITION
    if closed:
        separate &= _condition(fit.B[:, n_y:]) < _MAX_CONDITION
    return separate


def fitted_response(
    fit: LocalFit, spectra: Sequence[SettledSpectra], closed: bool, usable: BoolArray
) -> FittedResponse:
    """G at the usable lines, its covariance by noise, and the total one from the residual."""
    n_y = spectra[0].Y.shape[1]
    B = fit.B[usable]
    F, _, n_u = B.shape
    B_u = B[:, n_y:] if closed else np.broadcast_to(np.eye(n_u, dtype=np.complex128), (F, n_u, n_u))
    inverse = np.linalg.inv(B_u) if closed else B_u
    G = B[:, :n_y] @ inverse
    N = _residual_of(G)
    left = np.swapaxes(inverse, 1, 2) @ fit.left[usable] @ inverse.conj()
    of_fit = N if closed else N[:, :, :n_y]
    M = of_fit[:, None] @ fit.M[usable] @ inverse[:, None]
    poles = (M, fit.A_cov[usable])
    C_total = of_fit @ (fit.scatter[usable] / fit.dof) @ adjoint(of_fit)
    total = _covariance(left, C_total, fit.dof, poles)
    if not all(each.settled for each in spectra):
        return FittedResponse(G, None, total, B_u, left, C_total, None)
    dof = sum(each.dof for each in spectra)
    C_Z = np.sum([each.noise[usable] * (each.dof * each.n_periods / dof) for each in spectra], axis=0)
    C_noise = N @ C_Z @ adjoint(N)
    # The part of cov(A) that noise explains, by its share in the total.
    share = np.einsum("fyy->f", C_noise).real / np.maximum(np.einsum("fyy->f", C_total).real, 1e-300)
    noise = _covariance(left, C_noise, dof, (M, fit.A_cov[usable] * share[:, None, None]))
    return FittedResponse(G, noise, total, B_u, left, C_total, C_Z)


def _residual_of(G: ComplexArray) -> ComplexArray:
    """N = [I, -G] (F, n_y, n_y + n_u)."""
    F, n_y, _ = G.shape
    return np.concatenate([np.broadcast_to(np.eye(n_y), (F, n_y, n_y)), -G], axis=2)


def _covariance(
    left: ComplexArray, right: ComplexArray, dof: float, poles: tuple[ComplexArray, ComplexArray]
) -> Covariance:
    r"""left (x) right plus the share of the uncertain poles, in Kronecker form: it is added to right.

    .. math:: right + \frac{1}{n_u} \sum_{pq} A_{pq} M_p\, left^{-T} M_q^H

    Exact for one input; for more the trace after whitening by left is kept.  The diagonal alone where there are fewer
    degrees of freedom than outputs.
    """
    M, A_cov = poles
    n_u = left.shape[1]
    if M.shape[1]:
        weighted = np.swapaxes(M, 1, 2).reshape(len(M), M.shape[2], -1)
        middle = np.einsum("fpq,fuv->fpuqv", A_cov, np.swapaxes(np.linalg.inv(left), 1, 2))
        d = A_cov.shape[1]
        right = right + weighted @ middle.reshape(len(M), d * n_u, d * n_u) @ adjoint(weighted) / n_u
    return kronecker(left, right, dof)


def _condition(B: ComplexArray) -> FloatArray:
    """Condition (F,) of B (F, n, n), each row relative to its RMS over all lines."""
    rms = np.sqrt(np.mean(np.abs(B) ** 2, axis=(0, 2)))
    return np.asarray(np.linalg.cond(B / np.where(rms > 0, rms, 1.0)[:, None]))
