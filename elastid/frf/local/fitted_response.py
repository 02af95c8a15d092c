r"""G, its covariances, coherences and levels at every line from the local fits.

Closed loop, with N = [I, -G]:

.. math:: G = B_y B_u^{-1}, \qquad dG = N\, dB\, B_u^{-1}

With S_uu the mean power of the inputs in the window of a line, G its response and C_V the covariance of its residual,

.. math:: S_{yu} = G S_{uu}, \quad S_{yy} = G S_{uu} G^H + C_V

No transient is in them, and a resonance has the coherence of its line, not the mean over the window.  The estimate of
G has the power of its own variance, cov(vec G) = left (x) C_V, which is subtracted: without, noise alone would have a
coherence of unknowns over equations.  In closed loop inputs and outputs are what the reference drives: S_uu = B_u
S_rr B_u^H.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.frf.covariance import kronecker
from elastid.frf.local.least_squares import LocalFit, Windows
from elastid.frf.local.regression import SettledSpectra
from elastid.frf.matrices import adjoint, power
from elastid.frf.quality import coherences_of_powers, relative_singular_values
from elastid.response import Covariance, Levels, Quality

_MAX_CONDITION = 1e9  # of the regressors of a line


@dataclass(frozen=True)
class FittedResponse:
    """G (F, n_y, n_u) with its covariances, and their parts.

    B_u (F, n_u, n_u): inputs per reference, in open loop the identity.  left (F, n_u, n_u): cov(vec G) by a residual
    V = Y - G U of covariance C is left (x) C.  C_total (F, n_y, n_y): of V, from the residual, each record times
    sqrt(P).  C_Z (F, n_y + n_u, n_y + n_u): of the noise of [Y; U] in one period, C_noise (F, n_y, n_y): of that of V;
    None where nothing separates it.
    """

    G: ComplexArray
    noise: Covariance | None
    total: Covariance
    B_u: ComplexArray
    left: ComplexArray
    C_total: ComplexArray
    C_Z: ComplexArray | None = None
    C_noise: ComplexArray | None = None


def separates_inputs(fit: LocalFit, closed: bool, n_y: int) -> BoolArray:
    """Flags (F,) of the lines where the fit separates the inputs."""
    separate = fit.condition < _MAX_CONDITION
    if closed:
        B_u = fit.B[:, n_y:]
        rms = np.sqrt(np.mean(np.abs(B_u) ** 2, axis=(0, 2)))
        separate &= np.linalg.cond(B_u / np.where(rms > 0, rms, 1.0)[:, None]) < _MAX_CONDITION
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
    N = np.concatenate([np.broadcast_to(np.eye(n_y), (F, n_y, n_y)), -G], axis=2)
    left = np.swapaxes(inverse, 1, 2) @ fit.left[usable] @ inverse.conj()
    of_fit = N if closed else N[:, :, :n_y]
    M = of_fit[:, None] @ fit.M[usable] @ inverse[:, None]
    poles = (M, fit.A_cov[usable])
    C_total = of_fit @ (fit.scatter[usable] / fit.dof) @ adjoint(of_fit)
    total = _covariance(left, C_total, fit.dof, poles)
    if not all(spectrum.settled for spectrum in spectra):
        return FittedResponse(G, None, total, B_u, left, C_total)
    dof = sum(spectrum.dof for spectrum in spectra)
    C_Z = np.sum([each.noise[usable] * (each.dof * each.n_periods / dof) for each in spectra], axis=0)
    C_noise = N @ C_Z @ adjoint(N)
    # The part of cov(A) that noise explains, by its share in the total.
    share = np.einsum("fyy->f", C_noise).real / np.maximum(np.einsum("fyy->f", C_total).real, 1e-300)
    noise = _covariance(left, C_noise, dof, (M, fit.A_cov[usable] * share[:, None, None]))
    return FittedResponse(G, noise, total, B_u, left, C_total, C_Z, C_noise)


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


def window_power(R: ComplexArray, where: Windows) -> ComplexArray:
    """Mean over each window of the sum over experiments of R R^H (F, n_u, n_u), from R (E, B, n_u)."""
    n_w = where.index.shape[1]
    bins = np.einsum("ebu,ebv->buv", R, R.conj())
    # Sums from the first bin to the one before the last, which may be the end of the array.
    bounds = where.index[:, [0, -1]].ravel()
    sums = np.add.reduceat(bins, bounds, axis=0)[::2] if n_w > 1 else 0.0
    return np.asarray((sums + bins[where.index[:, -1]]) / n_w)


def local_quality(
    freq_hz: FloatArray, fitted: FittedResponse, spectra: Sequence[SettledSpectra], S_rr: ComplexArray
) -> Quality:
    """Quality of G (F, n_y, n_u), its nonlinear levels excepted; S_rr (F, n_u, n_u): `window_power` of what drives.

    Where bins between the lines separate the noise, that of one period counts, with the error of the transient that was
    taken out, and what else the residual has once; else the residual is the noise, and none is known of the inputs.
    """
    G, n_y = fitted.G, fitted.G.shape[1]
    periods = np.array([spectrum.n_periods for spectrum in spectra])
    S_uu = fitted.B_u @ S_rr @ adjoint(fitted.B_u) / periods.sum()
    C_V, noise = power(fitted.C_total), np.zeros(S_uu.shape[:2])
    output_noise = C_V
    if fitted.C_Z is not None and fitted.C_noise is not None:
        of_noise = power(fitted.C_noise)
        C_V = of_noise + (C_V - of_noise) / periods.mean()
        output_noise, noise = np.split(power(fitted.C_Z), [n_y], axis=1)
    coherence, multiple, signal = _coherences(fitted, S_uu, C_V)
    noise_of_mean = output_noise * np.mean(1 / periods)
    return Quality(
        coherence=coherence,
        multiple_coherence=multiple,
        singular_values=np.asarray(np.linalg.svd(G, compute_uv=False), dtype=np.float64),
        input_singular_values=relative_singular_values(S_uu),
        input_noise=noise,
        output_noise=output_noise,
        excited=Levels(freq_hz, np.sqrt(signal + noise_of_mean), np.sqrt(noise_of_mean)),
    )


def _coherences(
    fitted: FittedResponse, S_uu: ComplexArray, C_V: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ordinary (F, n_y, n_u) and multiple coherence (F, n_y), and the power (F, n_y) of G U; C_V (F, n_y)."""
    G, left, C_total = fitted.G, fitted.left, power(fitted.C_total)
    S_yu = G @ S_uu
    # Powers that the error of G brings into G U and S_yu.
    of_signal = np.einsum("fjk,fjk->f", S_uu, left).real[:, None] * C_total
    of_cross = np.einsum("fkj,fkl,flj->fj", S_uu, left, S_uu.conj(), optimize=True).real[:, None] * C_total[:, :, None]
    signal = np.maximum(np.sum(S_yu * G.conj(), axis=2).real - of_signal, 0.0)
    cross = np.maximum(np.abs(S_yu) ** 2 - of_cross, 0.0)
    return *coherences_of_powers(cross, signal, signal + C_V, power(S_uu)), signal
