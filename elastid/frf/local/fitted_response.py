r"""Fitted response: G with its covariances and quality at every line from the local fits.

In closed loop, with N = [I, -G]:

.. math:: G = B_y B_u^{-1}, \qquad dG = N\, dB\, B_u^{-1}

With S_uu the mean power of the inputs in the window of a line, G its response and C_V the covariance of its residual,

.. math:: S_{yu} = G S_{uu}, \quad S_{yy} = G S_{uu} G^H + C_V

These spectra contain no transient, and the coherence of a resonance is the coherence at its line, not the mean over the
window.  The variance of the estimate, cov(vec G) = left (x) C_V, is subtracted from its power; otherwise noise alone
would have a coherence of unknowns over equations.  In closed loop only the motion driven by the reference counts: S_uu
= B_u S_rr B_u^H.

A model that is too simple for a window explains part of G by the transient, which the residual does not show: a
polynomial in a window wider than a resonance, or a rational function with too few poles.  If both models are correct, a
richer model of the same data differs from it by noise alone.  With g the mean over neighbouring lines of

.. math:: \frac{|G - G_{richer}|^2}{\sigma^2 + \sigma^2_{richer}}

the squared error (g - 1)(sum of the variances) is added to the variance of G if g exceeds `MAX_RATIO`; the largest
error of several richer models counts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, mean_of_neighbours, quotient
from elastid.base.matrices import power
from elastid.frf.estimators import kronecker
from elastid.frf.local.least_squares import LocalFit
from elastid.frf.quality import coherences_of_powers, quality_of
from elastid.response import Covariance, LineAmplitudes, Quality

# Thresholds of a fit; false-alarm rates: not measured.
MAX_CONDITION = 1e9  # of the regressors of a line
AVERAGED_LINES = 11  # number of lines in the mean g
MAX_RATIO = 1.5  # of g, above which a difference is significant
MAX_VARIANCE_RATIO = 400.0  # variance of a richer model over the variance of G, above which it is not compared


@dataclass(frozen=True, eq=False)
class Experiments:
    """Experiments of a local fit with n_y outputs.  closed: True if driven by the reference.  periods (E,): numbers.

    C_Z (F, n_y + n_u, n_y + n_u): covariance of [Y; U] in one period at the lines of G, with `dof`; None without bins
    between the lines.
    """

    n_y: int
    closed: bool
    periods: FloatArray
    C_Z: ComplexArray | None
    dof: float


@dataclass(frozen=True)
class FittedResponse:
    """G (F, n_y, n_u) with its covariances and their factors.

    B_u (F, n_u, n_u): inputs per reference, the identity in open loop.  input_factor (F, n_u, n_u): for a covariance C
    of V = Y - G U, cov(vec G) is input_factor (x) C.  C_total (F, n_y, n_y): covariance of V from the residuals,
    records scaled by sqrt(P).  C_Z (F, n_y + n_u, n_y + n_u), C_noise (F, n_y, n_y): covariances of [Y; U] and of V by
    noise in one period; None without bins between the lines.
    """

    G: ComplexArray
    noise: Covariance | None
    total: Covariance
    B_u: ComplexArray
    input_factor: ComplexArray
    C_total: ComplexArray
    C_Z: ComplexArray | None = None
    C_noise: ComplexArray | None = None


def separates_inputs(fit: LocalFit, experiments: Experiments) -> BoolArray:
    """Flag lines (F,) where the inputs are independent."""
    separate = fit.condition < MAX_CONDITION
    if experiments.closed:
        B_u = fit.B[:, experiments.n_y :]
        rms = np.sqrt(np.mean(np.abs(B_u) ** 2, axis=(0, 2)))
        separate &= np.linalg.cond(B_u / np.where(rms > 0, rms, 1.0)[:, None]) < MAX_CONDITION
    return separate


def fitted_response(fit: LocalFit, experiments: Experiments, usable: BoolArray) -> FittedResponse:
    """Return G (F, n_y, n_u) at the usable lines, its covariance by noise, and the total one from the residual."""
    n_y, closed, dof = experiments.n_y, experiments.closed, experiments.dof
    B = fit.B[usable]
    F, _, n_u = B.shape
    B_u = B[:, n_y:] if closed else np.broadcast_to(np.eye(n_u, dtype=np.complex128), (F, n_u, n_u))
    inverse = np.linalg.inv(B_u) if closed else B_u
    G = B[:, :n_y] @ inverse
    N = np.concatenate([np.broadcast_to(np.eye(n_y), (F, n_y, n_y)), -G], axis=2)
    input_covariance = np.swapaxes(inverse, 1, 2) @ fit.input_factor[usable] @ inverse.conj()
    residual_map = N if closed else N[:, :, :n_y]
    M = residual_map[:, None] @ fit.M[usable] @ inverse[:, None]
    poles = (M, fit.A_cov[usable])
    C_total = residual_map @ (fit.scatter[usable] / fit.dof) @ residual_map.mT.conj()
    total = _covariance(input_covariance, C_total, fit.dof, poles)
    if experiments.C_Z is None:
        return FittedResponse(G, None, total, B_u, input_covariance, C_total)
    C_Z = experiments.C_Z[usable]
    C_noise = N @ C_Z @ N.mT.conj()
    # Contribution of the noise to cov(A), by its fraction of the total.
    ratio = np.einsum("fyy->f", C_noise).real / np.maximum(np.einsum("fyy->f", C_total).real, 1e-300)
    noise = _covariance(input_covariance, C_noise, dof, (M, fit.A_cov[usable] * ratio[:, None, None]))
    return FittedResponse(G, noise, total, B_u, input_covariance, C_total, C_Z, C_noise)


def _covariance(
    left: ComplexArray, right: ComplexArray, dof: float, poles: tuple[ComplexArray, ComplexArray]
) -> Covariance:
    r"""Return left (x) right plus the contribution of the uncertain poles, in Kronecker form, added to right.

    .. math:: right + \frac{1}{n_u} \sum_{pq} A_{pq} M_p\, left^{-T} M_q^H

    Exact for one input; for several inputs the trace after whitening by left is exact.
    """
    M, A_cov = poles
    n_u = left.shape[1]
    if M.shape[1]:
        weighted = np.swapaxes(M, 1, 2).reshape(len(M), M.shape[2], -1)
        middle = np.einsum("fpq,fuv->fpuqv", A_cov, np.swapaxes(np.linalg.inv(left), 1, 2))
        d = A_cov.shape[1]
        right = right + weighted @ middle.reshape(len(M), d * n_u, d * n_u) @ weighted.mT.conj() / n_u
    return kronecker(left, right, dof)


def local_mean(x: FloatArray) -> FloatArray:
    """Return mean (F, ...) over the neighbouring lines, fewer of them at the ends."""
    return mean_of_neighbours(x, AVERAGED_LINES)


def with_model_error(
    fitted: FittedResponse, richer: Sequence[tuple[LocalFit, BoolArray]], experiments: Experiments, usable: BoolArray
) -> Covariance:
    """Return the total covariance of G at the usable lines (F,), with the model error estimated from richer models.

    Each output has one factor, the mean over its inputs, so that correlations do not change.
    """
    G, total = fitted.G, fitted.total
    error = np.zeros(G.shape)
    for fit, has_more in richer:
        is_compared = usable & has_more & separates_inputs(fit, experiments)
        if not is_compared.any():
            continue
        on, refit = is_compared[usable], fitted_response(fit, experiments, is_compared)
        difference, variance = np.zeros(G.shape, np.complex128), np.zeros(G.shape)
        difference[on], variance[on] = G[on] - refit.G, refit.total.variance
        is_informative = variance <= MAX_VARIANCE_RATIO * total.variance
        difference = np.where(is_informative, difference, 0.0)
        total_variance = total.variance + np.where(is_informative, variance, 0.0)
        g = local_mean(quotient(np.abs(difference) ** 2, total_variance))
        error = np.maximum(error, np.where(g > MAX_RATIO, (g - 1) * total_variance, 0.0))
    factor = np.sqrt(1 + quotient(error, total.variance).mean(axis=2))
    right = None if total.right is None else factor[:, :, None] * total.right * factor[:, None, :]
    return replace(total, variance=total.variance * factor[:, :, None] ** 2, right=right)


def local_quality(freq_hz: FloatArray, fitted: FittedResponse, periods: FloatArray, S_rr: ComplexArray) -> Quality:
    """Return the quality of G (F, n_y, n_u) without distortion amplitudes; periods (E,) of each experiment.

    S_rr (F, n_u, n_u): `window_power` of the reference, in open loop of the inputs.
    With bins between the lines, the noise is the noise of one period plus the remainder of the residual; otherwise the
    residual is the noise, and the inputs have none.
    """
    G, n_y = fitted.G, fitted.G.shape[1]
    S_uu = fitted.B_u @ S_rr @ fitted.B_u.mT.conj() / periods.sum()
    C_V, noise = power(fitted.C_total), np.zeros(S_uu.shape[:2])
    output_noise = C_V
    if fitted.C_Z is not None and fitted.C_noise is not None:
        noise_power = power(fitted.C_noise)
        C_V = noise_power + (C_V - noise_power) / periods.mean()
        output_noise, noise = np.split(power(fitted.C_Z), [n_y], axis=1)
    *coherence, signal = _coherences(fitted, S_uu, C_V)
    noise_of_mean = output_noise * np.mean(1 / periods)
    amplitudes = LineAmplitudes(freq_hz, np.sqrt(signal + noise_of_mean), np.sqrt(noise_of_mean))
    return quality_of(G, S_uu, (coherence[0], coherence[1]), (noise, output_noise), amplitudes)


def _coherences(
    fitted: FittedResponse, S_uu: ComplexArray, C_V: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ordinary (F, n_y, n_u) and multiple coherence (F, n_y), and the power (F, n_y) of G U; C_V (F, n_y)."""
    G, left, C_total = fitted.G, fitted.input_factor, power(fitted.C_total)
    S_yu = G @ S_uu
    # Contributions of the error of G to the powers of G U and S_yu.
    signal_error = np.einsum("fjk,fjk->f", S_uu, left).real[:, None] * C_total
    cross_error = (
        np.einsum("fkj,fkl,flj->fj", S_uu, left, S_uu.conj(), optimize=True).real[:, None] * C_total[:, :, None]
    )
    signal = np.maximum(np.sum(S_yu * G.conj(), axis=2).real - signal_error, 0.0)
    cross = np.maximum(np.abs(S_yu) ** 2 - cross_error, 0.0)
    return *coherences_of_powers(cross, signal, signal + C_V, power(S_uu)), signal
