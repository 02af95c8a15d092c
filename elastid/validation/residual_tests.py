"""The measured uncertainty, and tests of whether a residual is no more than noise: share, whiteness, normality."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import log_ndtr

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.fit.weights.smoothed_noise import MIN_DOF, SmoothedNoise, smooth_noise, smooth_variance
from elastid.response import Covariance, FrequencyResponse
from elastid.validation.noise_tests import LAGS

# The statistic of `normality` that one in twenty normal samples exceeds (Stephens, JASA 69, 1974, case 3).
NORMALITY_95 = 0.752
# Fewer numbers do not show the shape of their distribution.
MIN_SAMPLES = 16


def sigma_of(measured: FrequencyResponse) -> tuple[FloatArray, float]:
    """sigma (F, n_y, n_u) and its degrees of freedom, as the fit weighs without its floor.

    Zeros where the measurement came without an uncertainty.
    """
    return sigma_of_noise(measured, smooth_noise(measured))


def sigma_of_noise(measured: FrequencyResponse, noise: SmoothedNoise | None) -> tuple[FloatArray, float]:
    """`sigma_of` where the smooth noise is there already."""
    if noise is None:
        return np.zeros(measured.G.shape), 0.0
    return np.sqrt(noise.variance), max(noise.measured.dof, MIN_DOF)


def smoothed_std(measured: FrequencyResponse, covariance: Covariance) -> tuple[FloatArray, float]:
    """Standard deviation (F, n_y, n_u) of G and its degrees of freedom, smoothed over lines where they are few."""
    G, variance = measured.G, covariance.variance
    smooth = np.empty(G.shape)
    for i, j in np.ndindex(G.shape[1:]):
        smooth[:, i, j] = smooth_variance(variance[:, i, j], G[:, i, j], covariance.dof)[1]
    return np.sqrt(smooth), max(covariance.dof, MIN_DOF)


def above_2sigma(measured: FrequencyResponse, sigma: FloatArray | None = None) -> BoolArray:
    """Lines (F, n_y, n_u) of at least twice the measured uncertainty; without one, all that are not zero.

    sigma (F, n_y, n_u): of `sigma_of`, where it is there already.
    """
    magnitude = np.abs(measured.G)
    sigma = sigma_of(measured)[0] if sigma is None else sigma
    return np.asarray((magnitude >= 2 * sigma) & (magnitude > 0))


def inside_expected(dof: float) -> float:
    r"""P(|E| <= 2 sigma) = 1 - (1 + 4 / dof)^{-dof} of a true model.

    |E|^2 / sigma^2 is F-distributed with 2 and 2 dof degrees of freedom; dof counts complex numbers. 0.80 for two
    realisations, 0.982 for a variance that is known, NaN where there is none.
    """
    if dof == 0:
        return math.nan
    return 1 - math.exp(-4 if math.isinf(dof) else -dof * math.log1p(4 / dof))


def autocorrelation(e: ComplexArray) -> tuple[FloatArray, FloatArray]:
    r"""|r_l| (3, n_y, n_u) of a normalised residual e (F, n_y, n_u) along frequency, and its 95 % bound.

    .. math:: r_l = \sum_k \bar e_k e_{k+l} / \sum_k |e_k|^2, \qquad
              b_l^2 = -\ln 0.05 \sum_k |e_k|^2 |e_{k+l}|^2 / (\sum_k |e_k|^2)^2

    Given the magnitudes, the sum is nearly complex normal of that variance for a white circular residual, so the bound
    holds even where sigma is uncertain. Lines with e = 0 are not counted.
    """
    power = np.abs(e) ** 2
    total = power.sum(axis=0)
    total = np.where(total > 0, total, np.nan)
    r = np.stack([np.abs((e[:-lag].conj() * e[lag:]).sum(axis=0)) for lag in LAGS]) / total
    variance = np.stack([(power[:-lag] * power[lag:]).sum(axis=0) for lag in LAGS]) / total**2
    return r, np.sqrt(-math.log(0.05) * variance)


def normality(e: ComplexArray, dof: float = math.inf) -> FloatArray:
    r"""Anderson and Darling's statistic A*^2 (n_y, n_u) of the real and imaginary parts of a residual e (F, n_y, n_u).

    .. math:: A^2 = -n - \frac1n \sum_{i=1}^n (2i - 1) [\ln \Phi(z_i) + \ln(1 - \Phi(z_{n+1-i}))],
              \quad A^{*2} = A^2 (1 + 0.75 / n + 2.25 / n^2)

    z: the n = 2 F numbers, less their mean, over their standard deviation, in order. Of normal residuals 5 % exceed
    NORMALITY_95, whatever their variance; a few lines that are far off raise it most. Where sigma has `dof` degrees of
    freedom, |e|^2 becomes dof ln(1 + |e|^2 / dof) first, which is exponential as it is for a known sigma. NaN where
    fewer than eight lines have a residual that is not 0.
    """
    statistic = np.full(e.shape[1:], np.nan)
    for i, j in np.ndindex(e.shape[1:]):
        some = e[:, i, j][e[:, i, j] != 0]
        if math.isfinite(dof) and dof > 0:
            power = np.abs(some) ** 2 / np.mean(np.abs(some) ** 2)
            some = some / np.abs(some) * np.sqrt(dof * np.log1p(power / dof))
        z = np.concatenate([some.real, some.imag])
        n = len(z)
        if n < MIN_SAMPLES:
            continue
        z = np.sort((z - z.mean()) / z.std(ddof=1))
        weight = 2 * np.arange(1, n + 1) - 1
        A2 = -n - np.mean(weight * (log_ndtr(z) + log_ndtr(-z[::-1])))
        statistic[i, j] = A2 * (1 + 0.75 / n + 2.25 / n**2)
    return statistic
