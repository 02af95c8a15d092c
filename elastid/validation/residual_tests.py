"""Tests of residuals against the measured noise: power and whiteness, each with its false alarm rate.

The residuals of a line are whitened by the noise with which the fit weighs, z = L^-1 vec E with C~ = L L^H, so that
elements do not count twice where they err together. Each test gives the probability p with which chance leaves as much;
a verdict speaks against the model where p < FALSE_ALARM.
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc, fdtrc, gammaincc

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, quotient
from elastid.fit.problem.smoothed_noise import SmoothedNoise, smooth_noise
from elastid.fit.problem.weights import inverse_cholesky, kronecker_factors, vec
from elastid.response import Response

# Probability of a verdict against a true model.
FALSE_ALARM = 0.005
MAX_LAG = 3


def whitening(noise: SmoothedNoise) -> ComplexArray:
    """Return L^-1 (F, m, m) of vec E, column-major, by element where C is singular; zero rows for zero variances."""
    used = noise.variance > 0
    try:
        L_inverse = inverse_cholesky(kronecker_factors(noise.smooth, used))
    except np.linalg.LinAlgError:
        L_inverse = (np.eye(used[0].size) * quotient(1.0, np.sqrt(vec(noise.variance)))[:, None, :]).astype(complex)
    return np.asarray(L_inverse * vec(used)[:, None, :], np.complex128)


def power_over_noise(
    z: ComplexArray, whiten: ComplexArray, noise: SmoothedNoise, shift_dof: float = 0.0
) -> tuple[float, float]:
    r"""Return ratio of the power of whitened residuals z (F, m) to the noise power, and its degrees of freedom d.

    .. math:: \frac{\sum_k |z_k|^2}{\sum_k \mathrm{tr}(L_k^{-1} S_k L_k^{-H}) / (1 - \kappa / \nu)}

    S is the measured covariance and kappa its part in L (`smooth_covariance`); shift_dof: power of `without_shifts`,
    added to that of z.  Of a true model the ratio has mean 1 and variance 2 / d.
    """
    measured = noise.measured
    S = whiten @ measured.full() @ np.swapaxes(whiten, -1, -2).conj()
    variance = noise.variance_influence if noise.smooth.form == "diagonal" else noise.matrix_influence
    expected = float(np.sum(np.einsum("faa->f", S).real / np.maximum(1 - variance / measured.dof, 0.1)))
    dof = 2 * int(np.count_nonzero(z)) / (1 + noise.repeats) / measured.averaging_lines
    return (float(np.sum(np.abs(z) ** 2)) + shift_dof) / max(expected, 1e-300), dof


def without_shifts(z: ComplexArray, shifts: ComplexArray) -> tuple[ComplexArray, float]:
    r"""Return whitened residuals z (F, m) less the likeliest error of the parameters, and its squares in variances.

    .. math:: z - B c, \qquad c = (1 + \mathrm{Re}\, 2 B^H B)^{-1} \mathrm{Re}\, 2 B^H z

    shifts (n_x, F, m): B, whitened changes by independent errors of unit variance. |z - B c|^2 + |c|^2 / 2 is the
    Mahalanobis distance with the covariance 1 + B B^H of prediction errors.
    """
    B = shifts.reshape(len(shifts), -1)
    H, g = 2 * (B.conj() @ B.T).real, 2 * (B.conj() @ z.ravel()).real
    c = np.linalg.solve(np.eye(len(B)) + H, g)
    return z - np.tensordot(c, shifts, axes=1), float(c @ c) / 2


def exceeds_by_chance(ratio: float, dof: float) -> float:
    """Return P(as much or more) of a ratio of mean 1 and variance 2 / dof, half by the denominator; NaN without noise.

    That of as little is the same of 1 / ratio.
    """
    return float(fdtrc(2 * dof, 2 * dof, ratio)) if math.isfinite(ratio) and dof > 0 else math.nan


def white_by_chance(z: ComplexArray) -> float:
    r"""Return P(as much correlation between neighbouring lines) of whitened residuals z (F, m); NaN of too few lines.

    .. math:: T = \sum_{l=1}^{3} \sum_{a=1}^{m} \frac{|\sum_k \bar z_{ka} z_{k+l,a}|^2}{\sum_k |z_{ka}|^2 |z_{k+l,a}|^2}

    held against its distribution when every line is turned by a random phase, the same for all elements: magnitudes and
    correlations between elements stay, those along frequency vanish. Its mean is 3 m; with the variance and the third
    moment of such draws it is a shifted gamma distribution (Pearson's type III), whose tail is that of T: lags depend
    on each other, and elements are correlated, so that two moments would call white residuals coloured too often.
    """
    z = z[:, np.any(z != 0, axis=0)]
    if len(z) <= MAX_LAG + 1 or not z.size:
        return math.nan
    draws = int(np.clip(2_000_000 // z.size, 400, 2000))  # of random phases, by the values that fit into memory
    turns = np.exp(2j * np.pi * np.random.default_rng(0).random((draws, len(z))))
    statistic, drawn = 0.0, np.zeros(draws)
    for lag in range(1, MAX_LAG + 1):
        product = z[:-lag].conj() * z[lag:]
        scale = np.maximum(np.sum(np.abs(product) ** 2, axis=0), 1e-300)
        statistic += float(np.sum(np.abs(product.sum(axis=0)) ** 2 / scale))
        drawn += np.sum(np.abs((turns[:, :-lag].conj() * turns[:, lag:]) @ product) ** 2 / scale, axis=1)
    mean = float(MAX_LAG * z.shape[1])
    variance, third = float(np.mean((drawn - mean) ** 2)), float(np.mean((drawn - mean) ** 3))
    # Sums of squares have at least the third moment of a gamma distribution from zero on.
    third = max(third, 2 * variance**2 / mean)
    shape = 4 * variance**3 / third**2
    return float(gammaincc(shape, max(0.0, shape + math.sqrt(shape / variance) * (statistic - mean))))


def fisher_p_value(p: Sequence[float] | FloatArray) -> float:
    """Return P of independent tests jointly, -2 sum ln p being chi-squared (Fisher); NaN where none has a p."""
    logarithms = [math.log(max(value, 1e-300)) for value in p if math.isfinite(value)]
    return float(chdtrc(2 * len(logarithms), -2 * sum(logarithms))) if logarithms else math.nan


def sigma_of(measured: Response, noise: SmoothedNoise | None = None) -> FloatArray:
    """Return sigma (F, n_y, n_u), as the fit weighs without its floor; zeros where the measurement came without one.

    noise: that of `smooth_noise`, if it is known.
    """
    variance = noise or smooth_noise(measured)
    return np.zeros(measured.G.shape) if variance is None else np.sqrt(variance.variance)


def above_2sigma(measured: Response, sigma: FloatArray | None = None) -> BoolArray:
    """Return lines (F, n_y, n_u) of at least twice sigma (default: of `sigma_of`); without noise all but zeros."""
    magnitude = np.abs(measured.G)
    sigma = sigma_of(measured) if sigma is None else sigma
    return (magnitude >= 2 * sigma) & (magnitude > 0)
