r"""Quality of a response by a local method: coherences and levels from the spectra that its fits imply.

With S_uu the mean power of the inputs in the window of a line, G its response and C_V the covariance of its residual,

.. math:: S_{yu} = G S_{uu}, \quad S_{yy} = G S_{uu} G^H + C_V, \quad
          \gamma_i^2 = 1 - \frac{C_{V,ii}}{S_{y_i y_i}}, \quad
          \gamma_{ij}^2 = \frac{|S_{y_i u_j}|^2}{S_{y_i y_i} S_{u_j u_j}}

No transient is in them, and a resonance has the coherence of its line, not the mean over the window.  The estimate of
G has the power of its own variance, cov(vec G) = left (x) C_V, which is subtracted: without, noise alone would have a
coherence of unknowns over equations.  In closed loop inputs and outputs are what the reference drives: S_uu = B_u
S_rr B_u^H.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.frf.checks.quality import relative_singular_values
from elastid.frf.local.fitted_response import FittedResponse
from elastid.frf.local.transient import SettledSpectra
from elastid.frf.local.windows import Windows
from elastid.frf.matrices import adjoint, power
from elastid.response import Levels, Quality


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
    periods = np.array([each.n_periods for each in spectra])
    S_uu = fitted.B_u @ S_rr @ adjoint(fitted.B_u) / periods.sum()
    C_V, noise = power(fitted.C_total), np.zeros(S_uu.shape[:2])
    output_noise = C_V
    if fitted.C_Z is not None:
        of_noise = power(fitted.of_residual(fitted.C_Z))
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
    S_yy = signal + C_V
    both = S_yy[:, :, None] * power(S_uu)[:, None, :]
    ordinary = np.divide(cross, both, out=np.zeros(both.shape), where=both > 0)
    multiple = np.divide(signal, S_yy, out=np.zeros(S_yy.shape), where=S_yy > 0)
    return np.minimum(ordinary, 1.0), multiple, signal
