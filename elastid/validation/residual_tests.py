"""Statistical tests of residuals against the measured noise: power and whiteness.

The noise covariance of the fit's weights whitens the residuals of a line, z = L^-1 vec E with C~ = L L^H. Each test
returns the probability p of a statistic at least as large for a correct model. The model fails a test if p <
FALSE_ALARM.
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc, fdtrc, gammaincc

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, quotient
from elastid.fit.problem.smoothed_noise import SmoothedNoise, smooth_noise
from elastid.fit.problem.weights import inverse_cholesky, kronecker_factors, vec
from elastid.response import Response

# False-alarm rate of each test.
FALSE_ALARM = 0.005
MAX_LAG = 3


def whitening(noise: SmoothedNoise) -> ComplexArray:
    """Return L^-1 (F, m, m) for vec E, column-major; a diagonal one if C is singular; zero columns without noise."""
    has_noise = noise.variance > 0
    try:
        L_inverse = inverse_cholesky(kronecker_factors(noise.smooth, has_noise))
    except np.linalg.LinAlgError:
        inverse_std = quotient(1.0, np.sqrt(vec(noise.variance)))
        L_inverse = (np.eye(has_noise[0].size) * inverse_std[:, None, :]).astype(complex)
    return np.asarray(L_inverse * vec(has_noise)[:, None, :], np.complex128)


def power_over_noise(
    z: ComplexArray, whiten: ComplexArray, noise: SmoothedNoise, shift_dof: float = 0.0
) -> tuple[float, float]:
    r"""Return the ratio of the power of whitened residuals z (F, m) to the noise power, and its degrees of freedom d.

    .. math:: \frac{\sum_k |z_k|^2}{\sum_k \mathrm{tr}(L_k^{-1} S_k L_k^{-H}) / (1 - \kappa / \nu)}

    S: measured covariance; kappa: its influence on L (`SelfInfluence`); shift_dof: power of `without_shifts`, added
    to that of z.  For a correct model the ratio has mean 1 and variance 2 / d.
    """
    measured = noise.measured
    S = whiten @ measured.full() @ np.swapaxes(whiten, -1, -2).conj()
    variance = noise.influence.variance if noise.smooth.form == "diagonal" else noise.influence.matrix
    expected = float(np.sum(np.einsum("faa->f", S).real / np.maximum(1 - variance / measured.dof, 0.1)))
    dof = 2 * int(np.count_nonzero(z)) / (1 + noise.repeats) / measured.averaging_lines
    return (float(np.sum(np.abs(z) ** 2)) + shift_dof) / max(expected, 1e-300), dof


def without_shifts(z: ComplexArray, shifts: ComplexArray) -> tuple[ComplexArray, float]:
    r"""Return whitened residuals z (F, m) minus the most likely effect of parameter errors, and |c|^2 / 2.

    .. math:: z - B c, \qquad c = (1 + \mathrm{Re}\, 2 B^H B)^{-1} \mathrm{Re}\, 2 B^H z

    shifts B (n_x, F, m): whitened changes by independent errors of unit variance. |z - B c|^2 + |c|^2 / 2 is the
    Mahalanobis distance with the covariance 1 + B B^H of prediction errors.
    """
    B = shifts.reshape(len(shifts), -1)
    H, g = 2 * (B.conj() @ B.T).real, 2 * (B.conj() @ z.ravel()).real
    c = np.linalg.solve(np.eye(len(B)) + H, g)
    return z - np.tensordot(c, shifts, axes=1), float(c @ c) / 2


def exceeds_by_chance(ratio: float, dof: float) -> float:
    """Return the probability of at least this ratio of powers, each with 2 dof degrees of freedom; NaN without noise.

    The probability of at most this ratio is that of 1 / ratio.
    """
    return float(fdtrc(2 * dof, 2 * dof, ratio)) if math.isfinite(ratio) and dof > 0 else math.nan


def white_by_chance(z: ComplexArray) -> float:
    r"""Return the probability of at least this correlation between neighbouring lines of whitened residuals z (F, m).

    .. math:: T = \sum_{l=1}^{3} \sum_{a=1}^{m} \frac{|\sum_k \bar z_{ka} z_{k+l,a}|^2}{\sum_k |z_{ka}|^2 |z_{k+l,a}|^2}

    is compared with its distribution for random phases of the lines, equal for all elements, which keep magnitudes and
    correlations between elements but no correlation along frequency. The distribution is a shifted gamma distribution
    (Pearson's type III) with the mean 3 m and the variance and third moment of random samples. With two moments only,
    the false-alarm rate would be too high, because lags and elements are correlated. NaN for too few lines.
    """
    z = z[:, np.any(z != 0, axis=0)]
    if len(z) <= MAX_LAG + 1 or not z.size:
        return math.nan
    n = int(np.clip(2_000_000 // z.size, 400, 2000))  # as many samples as fit into memory
    phases = np.exp(2j * np.pi * np.random.default_rng(0).random((n, len(z))))
    statistic, samples = 0.0, np.zeros(n)
    for lag in range(1, MAX_LAG + 1):
        product = z[:-lag].conj() * z[lag:]
        scale = np.maximum(np.sum(np.abs(product) ** 2, axis=0), 1e-300)
        statistic += float(np.sum(np.abs(product.sum(axis=0)) ** 2 / scale))
        samples += np.sum(np.abs((phases[:, :-lag].conj() * phases[:, lag:]) @ product) ** 2 / scale, axis=1)
    mean = float(MAX_LAG * z.shape[1])
    variance, third = float(np.mean((samples - mean) ** 2)), float(np.mean((samples - mean) ** 3))
    # Sums of squares have at least the third moment of a gamma distribution that starts at zero.
    third = max(third, 2 * variance**2 / mean)
    shape = 4 * variance**3 / third**2
    return float(gammaincc(shape, max(0.0, shape + math.sqrt(shape / variance) * (statistic - mean))))


def fisher_p_value(p: Sequence[float] | FloatArray) -> float:
    """Return the joint p of independent tests by Fisher's method (-2 sum ln p is chi-squared); NaN without any p."""
    logarithms = [math.log(max(value, 1e-300)) for value in p if math.isfinite(value)]
    return float(chdtrc(2 * len(logarithms), -2 * sum(logarithms))) if logarithms else math.nan


def sigma_of(measured: Response, noise: SmoothedNoise | None = None) -> FloatArray:
    """Return sigma (F, n_y, n_u) of the fit's weights without model error; zeros for a measurement without noise.

    noise: default `smooth_noise`.
    """
    variance = noise or smooth_noise(measured)
    return np.zeros(measured.G.shape) if variance is None else np.sqrt(variance.variance)


def above_2sigma(measured: Response, sigma: FloatArray | None = None) -> BoolArray:
    """Return flags (F, n_y, n_u) of lines with |G| >= 2 sigma > 0 or without noise; sigma: default `sigma_of`."""
    magnitude = np.abs(measured.G)
    sigma = sigma_of(measured) if sigma is None else sigma
    return (magnitude >= 2 * sigma) & (magnitude > 0)
