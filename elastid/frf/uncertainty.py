r"""Covariance of a mean frequency response: from the scatter of periods (noise) and of realisations (total).

One realisation of E experiments, G^[m] = Y W with W = U^H (U U^H)^-1 and the equation error V = Y - G U, has

.. math:: cov(vec\, G^{[m]}) = (W^T diag(1 / P_e)\, W^*) \otimes C_V

with C_V the covariance (n_y, n_y) of V in one period: V holds the noise of outputs and inputs together (to first
order), so that neither the (n_y + n_u) n_u square covariance of all spectra nor its Jacobian is ever formed.
(Pintelon and Schoukens, System Identification, 2nd ed., section 2.7, in the form of the equation error.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.arrays import BoolArray, ComplexArray, FloatArray
from elastid.frf.spectra import PeriodSpectra
from elastid.response import Covariance


@dataclass(frozen=True)
class Block:
    """What one realisation says, from the means over periods of its E experiments.

    G (F, n_y, n_u).  U (F, n_u, E) and W (F, E, n_u) with U W = 1.  left (F, n_u, n_u): cov(vec G) = left (x) C_V.
    scatter (F, n_y, n_y): the sum of V V^H over all periods of all experiments, of expectation dof C_V.
    """

    G: ComplexArray
    U: ComplexArray
    W: ComplexArray
    left: ComplexArray
    scatter: ComplexArray
    dof: int

    def on(self, lines: BoolArray) -> Block:
        """The same on some of its lines (F,)."""
        return Block(self.G[lines], self.U[lines], self.W[lines], self.left[lines], self.scatter[lines], self.dof)


def block(spectra: Sequence[PeriodSpectra], separated: BoolArray) -> Block:
    """G = Y U^H (U U^H)^-1 of one realisation with what its uncertainty is made of; 0 at lines not separated (F,)."""
    U = np.stack([each.U.mean(axis=0) for each in spectra], axis=2)
    Y = np.stack([each.Y.mean(axis=0) for each in spectra], axis=2)
    W = np.zeros((U.shape[0], U.shape[2], U.shape[1]), dtype=np.complex128)
    W[separated] = right_inverse(U[separated])
    G = Y @ W
    P = np.array([len(each.periods) for each in spectra])
    left = np.swapaxes(W, 1, 2) @ (W.conj() / P[:, None])
    scatter = np.sum([_equation_error_scatter(each, G) for each in spectra], axis=0)
    return Block(G, U, W, left, scatter, int(np.sum(P - 1)))


def right_inverse(U: ComplexArray) -> ComplexArray:
    """W (F, E, n_u) with U W = 1, of U (F, n_u, E): U^-1, or with more experiments than inputs U^H (U U^H)^-1."""
    _, n_u, E = U.shape
    if n_u == E:
        return np.linalg.inv(U).astype(np.complex128)
    return (_H(U) @ np.linalg.inv(U @ _H(U))).astype(np.complex128)


def noise_covariance(blocks: Sequence[Block]) -> Covariance:
    """Covariance of the mean of M blocks that the disturbing noise explains: (1 / M^2) sum_m left_m (x) C_V."""
    dof = sum(each.dof for each in blocks)
    C_V = np.sum([each.scatter for each in blocks], axis=0) / dof
    return _kronecker(np.sum([each.left for each in blocks], axis=0) / len(blocks) ** 2, C_V, dof)


def total_covariance(blocks: Sequence[Block], G: ComplexArray) -> Covariance | None:
    r"""Covariance of the mean G of M blocks that their scatter shows: noise and stochastic nonlinear distortion.

    With S_m = U_m U_m^H, S_m^-1 = W_m^H W_m and the equation error of a block under the mean, D_m = (G_m - G) U_m,

    .. math:: C_T = \frac{\sum_m D_m D_m^H}{(M - 2) n_u + tr(\sum_m S_m^{-1} \sum_m S_m) / M^2}, \quad
              cov(vec\, G) = \frac{1}{M^2} \sum_m S_m^{-T} \otimes C_T

    The denominator is (M - 1) n_u where all S_m are alike and makes C_T unbiased where they are not.  None for M = 1.
    """
    M, n_u = len(blocks), G.shape[2]
    if M < 2:
        return None
    S = [each.U @ _H(each.U) for each in blocks]
    inverse = np.sum([_H(each.W) @ each.W for each in blocks], axis=0)
    D = [(each.G - G) @ each.U for each in blocks]
    expected = (M - 2) * n_u + np.einsum("fab,fba->f", inverse, np.sum(S, axis=0)).real / M**2
    C_T = np.sum([each @ _H(each) for each in D], axis=0) / expected[:, None, None]
    return _kronecker(np.swapaxes(inverse, 1, 2) / M**2, C_T, (M - 1) * n_u)


def _equation_error_scatter(spectra: PeriodSpectra, G: ComplexArray) -> ComplexArray:
    """Sum over periods of (V - mean) (V - mean)^H, V = Y - G U, as (F, n_y, n_y)."""
    U = np.moveaxis(spectra.U - spectra.U.mean(axis=0), 0, 2)
    Y = np.moveaxis(spectra.Y - spectra.Y.mean(axis=0), 0, 2)
    V = Y - G @ U
    scatter: ComplexArray = V @ _H(V)
    return scatter


def _kronecker(left: ComplexArray, right: ComplexArray, dof: int) -> Covariance:
    """left (x) right, or only its diagonal where fewer degrees of freedom than outputs leave right singular."""
    variance: FloatArray = _real_diagonal(right)[:, :, None] * _real_diagonal(left)[:, None, :]
    if right.shape[1] > dof:
        return Covariance(variance, dof)
    return Covariance(variance, dof, left, right)


def _real_diagonal(A: ComplexArray) -> FloatArray:
    diagonal: FloatArray = np.maximum(np.einsum("fii->fi", A).real, 0.0)
    return diagonal


def _H(A: ComplexArray) -> ComplexArray:
    adjoint: ComplexArray = np.swapaxes(A, -1, -2).conj()
    return adjoint
