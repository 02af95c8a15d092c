r"""G, its covariances, coherences and levels at every line from the local fits.

Closed loop, with N = [I, -G]:

.. math:: G = B_y B_u^{-1}, \qquad dG = N\, dB\, B_u^{-1}

With S_uu the mean power of the inputs in the window of a line, G its response and C_V the covariance of its residual,

.. math:: S_{yu} = G S_{uu}, \quad S_{yy} = G S_{uu} G^H + C_V

No transient is in them, and a resonance has the coherence of its line, not the mean over the window.  The estimate of
G has the power of its own variance, cov(vec G) = left (x) C_V, which is subtracted: without, noise alone would have a
coherence of unknowns over equations.  In closed loop inputs and outputs are what the reference drives: S_uu = B_u
S_rr B_u^H.

A model that is too simple for a window passes part of G off as transient, and its residual does not show it: a
polynomial in a window wider than a resonance, a rational function with too few poles beside one.  A richer model of
about the same data differs from it by noise alone where both are right.  With g the mean over neighbouring lines of

.. math:: \frac{|G - G_{richer}|^2}{\sigma^2 + \sigma^2_{richer}}

the squared error (g - 1)(sum of the variances) is added to the variance of G where g is clearly above 1; of several
richer models that with the largest error counts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, quotient
from elastid.base.matrices import power
from elastid.base.statistics import mean_of_neighbours
from elastid.frf.estimators import kronecker
from elastid.frf.local.least_squares import LocalFit
from elastid.frf.quality import coherences_of_powers, quality_of
from elastid.response import Covariance, LineAmplitudes, Quality

# Thresholds of a fit; false-alarm rates: not measured.
MAX_CONDITION = 1e9  # of the regressors of a line
AVERAGED_LINES = 11  # over which a difference to a richer model is averaged
MAX_RATIO = 1.5  # of its mean square to its variance, above which a difference is more than noise
MAX_VARIANCE_RATIO = 400.0  # a richer model of a variance so many times that of G shows no error of G


@dataclass(frozen=True, eq=False)
class Experiments:
    """Experiments of a local fit, with n_y outputs. closed: driven by the reference. periods (E,) of each.

    C_Z (F, n_y + n_u, n_y + n_u): noise of [Y; U] in one period at the lines of G, with its dof; None where no bin
    separates it from the response.
    """

    n_y: int
    closed: bool
    periods: FloatArray
    C_Z: ComplexArray | None
    dof: float


@dataclass(frozen=True)
class FittedResponse:
    """G (F, n_y, n_u) with its covariances, and their parts.

    B_u (F, n_u, n_u): inputs per reference, in open loop the identity.  input_factor (F, n_u, n_u): cov(vec G) by a
    residual V = Y - G U of covariance C is input_factor (x) C.  C_total (F, n_y, n_y): covariance of V, from the
    residual, each record times sqrt(P).  C_Z (F, n_y + n_u, n_y + n_u): of the noise of [Y; U] in one period, C_noise
    (F, n_y, n_y): of that of V; None where nothing separates it.
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
    """Return flags (F,) of the lines where the fit separates the inputs."""
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
    # The part of cov(A) that noise explains, by its share in the total.
    ratio = np.einsum("fyy->f", C_noise).real / np.maximum(np.einsum("fyy->f", C_total).real, 1e-300)
    noise = _covariance(input_covariance, C_noise, dof, (M, fit.A_cov[usable] * ratio[:, None, None]))
    return FittedResponse(G, noise, total, B_u, input_covariance, C_total, C_Z, C_noise)


def _covariance(
    left: ComplexArray, right: ComplexArray, dof: float, poles: tuple[ComplexArray, ComplexArray]
) -> Covariance:
    r"""Return left (x) right plus the share of the uncertain poles, in Kronecker form: it is added to right.

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
        right = right + weighted @ middle.reshape(len(M), d * n_u, d * n_u) @ weighted.mT.conj() / n_u
    return kronecker(left, right, dof)


def local_mean(x: FloatArray) -> FloatArray:
    """Return mean (F, ...) over the neighbouring lines, fewer of them at the ends."""
    return mean_of_neighbours(x, AVERAGED_LINES)


def with_model_error(
    fitted: FittedResponse, richer: Sequence[tuple[LocalFit, BoolArray]], experiments: Experiments, usable: BoolArray
) -> Covariance:
    """Return the total covariance of G at usable (F,) lines with the error of its model, as richer ones show it.

    A difference of 0 carries no information.  Outputs are widened as a whole, by the mean over their inputs, so that
    their correlations stay.
    """
    G, total = fitted.G, fitted.total
    error = np.zeros(G.shape)
    for fit, has_more in richer:
        is_compared = usable & has_more & separates_inputs(fit, experiments)
        if not is_compared.any():
            continue
        on, refit = is_compared[usable], fitted_response(fit, experiments, is_compared)
        difference, variance = np.zeros(G.shape, dtype=np.complex128), np.zeros(G.shape)
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
    """Return quality of G (F, n_y, n_u), its nonlinear levels excepted; periods (E,) of each experiment.

    S_rr (F, n_u, n_u): `window_power` of what drives.

    Where bins between the lines separate the noise, that of one period counts, with the error of the transient that was
    taken out, and what else the residual has once; else the residual is the noise, and none is known of the inputs.
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
    # Powers that the error of G brings into G U and S_yu.
    signal_error = np.einsum("fjk,fjk->f", S_uu, left).real[:, None] * C_total
    cross_error = (
        np.einsum("fkj,fkl,flj->fj", S_uu, left, S_uu.conj(), optimize=True).real[:, None] * C_total[:, :, None]
    )
    signal = np.maximum(np.sum(S_yu * G.conj(), axis=2).real - signal_error, 0.0)
    cross = np.maximum(np.abs(S_yu) ** 2 - cross_error, 0.0)
    return *coherences_of_powers(cross, signal, signal + C_V, power(S_uu)), signal
