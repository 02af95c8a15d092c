r"""Smoothed noise: the sample covariance of a measured response, smoothed over DFT lines in its original form.

A full covariance is smoothed around a model of the noise (`noise_model`).
With an exact model C = L L^H the whitened covariances X_k = L_k^{-1} S_k L_k^{-H} have the expectation 1. The errors of
the model are estimated from the neighbouring lines:

.. math:: \tilde C_k = c\, l_k\, L_k [\rho + (1 - \rho) \bar X_k] L_k^H

l: geometric mean of tr(X) / n over m lines.  Xbar: mean of X / (tr(X) / n) over these lines.  rho: the value of
`SHRINKAGES` with the largest cross-validated likelihood, the sum over lines of -ln det C~ - tr(C~^-1 S) with C~
computed without the line's own S.  c: makes the weights unbiased, E[tr(C~^-1 C)] = n, for noise that is smooth over m
lines.  A line with significantly more noise than its neighbours keeps its own power.
"""

import math
from operator import is_
from typing import Any

import numpy as np
from scipy.special import fdtr, gammainc

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.large_arrays import move_beside
from elastid.base.messages import WorkerConstant
from elastid.base.statistics import chi_square_limit
from elastid.fit.problem.noise_model import NoiseShapes, noise_model
from elastid.response import Covariance, Response


@frozen_value
class SelfInfluence:
    """Influence kappa (F,) of a line on its own smoothed covariance: on the variances, and on the whole matrix.

    To first order tr(C~^-1 S) is 1 - kappa / dof times its value for a sample S that is independent of C~.
    """

    variance: FloatArray
    matrix: FloatArray


@frozen_value
class SmoothedNoise(WorkerConstant):
    """Sample covariance and its smoothed value over neighbouring DFT lines, for unbiased weights 1 / v.

    Both covariances have the same form. Matrices of all elements are computed when needed and not stored.
    """

    measured: Covariance
    smooth: Covariance
    influence: SelfInfluence

    @property
    def variance(self) -> FloatArray:
        """The smooth variance v~ (F, n_y, n_u)."""
        return self.smooth.variance

    @property
    def repeats(self) -> float:
        """Normalised variance of sum tr(C~^-1 S) divided by the normalised variance of the error power."""
        return (self.variance.shape[2] if self.measured.form == "kronecker" else 1) / self.measured.dof


def smooth_noise(response: Response) -> SmoothedNoise | None:
    """Return the smoothed noise of a response, computed from `larger_covariance`; None without a covariance."""
    raw, key = larger_covariance(response), (response.G, response.freq_hz, response.quantity)
    if raw is None:
        return None
    if math.isinf(raw.dof) and raw.form != "diagonal":
        return SmoothedNoise(raw, raw, SelfInfluence(*np.zeros((2, len(response.G)))))
    # Weights, residual tests and validation smooth the same covariance. Its object keeps the value for the last
    # response, so that the value is freed with it and, as a cached property, is not sent to workers.
    cache = vars(raw)
    if not all(map(is_, key, cache.get("smooth_of", [None] * 3))):
        cache["smooth"], cache["smooth_of"] = _smooth(response, raw), key
    return SmoothedNoise(raw, *cache["smooth"])


def _smooth(response: Response, raw: Covariance) -> tuple[Covariance, SelfInfluence]:
    """Return the smooth covariance in the form of `raw`, and the influence of a line on it."""
    F, n_y, n_u = response.G.shape
    if raw.form == "diagonal":
        variance, kappa = smooth_variance(raw.variance, response.G, raw.dof)
        factor = np.full(F, float(kappa.max()))
        return Covariance(variance, raw.dof), SelfInfluence(factor, factor)
    S = raw.matrix if raw.left is None or raw.right is None else raw.right
    assert S is not None
    covariance, influence = smooth_covariance(S, _model(response, raw, S), raw.dof)
    power = np.einsum("faa->fa", covariance).real
    covariance = move_beside(S, covariance)
    if raw.left is None:
        smooth = Covariance(power.reshape(F, n_u, n_y).swapaxes(1, 2), raw.dof, matrix=covariance)
    else:
        variance = power[:, :, None] * np.einsum("faa->fa", raw.left).real[:, None, :]
        smooth = Covariance(variance, raw.dof, raw.left, covariance)
    return smooth, influence


def _model(response: Response, raw: Covariance, S: ComplexArray) -> ComplexArray:
    inverse_power = None if raw.left is None else np.mean(np.einsum("faa->fa", raw.left).real, axis=1)
    shapes = NoiseShapes.of(response.freq_hz, response.G, response.quantity, inverse_power)
    if raw.left is not None:
        return noise_model(S, shapes)
    _, n_y, n_u = response.G.shape
    model = np.zeros_like(S)
    for rows in (slice(j * n_y, (j + 1) * n_y) for j in range(n_u)):
        model[:, rows, rows] = noise_model(S[:, rows, rows], shapes)
    return model


def larger_covariance(response: Response) -> Covariance | None:
    """Return the total covariance, or the noise covariance if the total is significantly smaller (p-value 0.001).

    The total includes the noise. The geometric mean of their ratio over lines and elements is compared with the F
    distribution of a single line: elements can share one error, and realisations can share their noise at all lines.
    """
    total, noise = response.total, response.noise
    if total is None or noise is None:
        return response.uncertainty
    is_positive = (total.variance > 0) & (noise.variance > 0)
    if not is_positive.any() or math.isinf(total.dof):
        return total
    ratio = math.exp(float(np.mean(np.log(total.variance[is_positive] / noise.variance[is_positive]))))
    is_exact = math.isinf(noise.dof)
    p_value = gammainc(total.dof, total.dof * ratio) if is_exact else fdtr(2 * total.dof, 2 * noise.dof, ratio)
    return noise if p_value < 1e-3 else total


# Values of rho that are compared, from the model alone to the mean of the neighbours; the likelihood is flat between.
SHRINKAGES = (1.0, 0.7, 0.4, 0.2, 0.1, 0.03, 0.01, 0.003)


def smooth_covariance(S: ComplexArray, model: ComplexArray, dof: float) -> tuple[ComplexArray, SelfInfluence]:
    """Return C~ (F, n, n) of sample covariances S (F, n, n) of `dof` degrees of freedom, and a line's influence on it.

    model (F, n, n): noise model C.
    """
    F, n = S.shape[:2]
    width = min(_width(n, dof), F)
    L = np.asarray(np.linalg.cholesky(model), np.complex128)
    whitening = np.asarray(np.linalg.inv(L), np.complex128)
    X = whitening @ S @ whitening.mT.conj()
    scale = np.einsum("faa->f", X).real / n
    positive = scale > 0
    scale = fill_zeros(scale) if positive.any() else np.ones(F)
    for_weights = _smooth_power(scale, n * dof, width)
    X = X / scale[:, None, None]
    X[~positive] = np.eye(n)
    # With fewer degrees of freedom than elements the sample covariance is singular.
    rho = 1.0 if width * dof < n else _shrinkage(X, width)
    inner = rho * np.eye(n) + (1 - rho) * moving_mean(X, width)
    bias = 1 - (1 - rho) * (n**2 - 1) / (n * width * dof)
    smooth = np.asarray((for_weights / bias)[:, None, None] * (L @ inner @ L.mT.conj()))
    return smooth, _self_influence(S, smooth, rho, width, dof)


def _width(n: int, dof: float) -> int:
    """Return the odd number w of lines: 10 n degrees of freedom for n correlated elements, 24 for their power.

    Inverse-variance weights with nu degrees of freedom increase the std of the estimate by sqrt((nu - 1) / (nu - 2)),
    2 % for 24. With 30 degrees of freedom per element no neighbours are needed.
    """
    return 1 if dof >= 30 * n else max(math.ceil(max(10 * n, 24 / n) / dof), 3) // 2 * 2 + 1


def _shrinkage(X: ComplexArray, width: int) -> float:
    """Return rho; X (F, n, n): whitened, with mean diagonal 1."""
    n = X.shape[1]
    if width == 1 or n == 1:
        return 0.0
    neighbours = (width * moving_mean(X, width) - X) / (width - 1)
    rho = np.array(SHRINKAGES)[:, None, None]
    values, vectors = np.linalg.eigh(neighbours)
    values = np.maximum(rho + (1 - rho) * values, 1e-12)
    power = np.einsum("fab,fac,fcb->fb", vectors.conj(), X, vectors, optimize=True).real
    return SHRINKAGES[int(np.argmax(np.sum(-np.log(values) - power / values, axis=(1, 2))))]


def _self_influence(S: ComplexArray, smooth: ComplexArray, rho: float, width: int, dof: float) -> SelfInfluence:
    """Return the influence of a line on its own C~: its fraction of the mean, times the mean ratio of S to C~."""
    F, n = S.shape[:2]
    of_diagonal = np.mean(np.einsum("faa->fa", S).real / np.einsum("faa->fa", smooth).real, axis=1)
    of_matrix = np.einsum("faa->f", np.linalg.solve(smooth, S)).real / n
    variance = (1 + (1 - rho) * (n - 1)) / (n * width) * float(np.mean(of_diagonal))
    matrix = (1 + (1 - rho) * (n**2 - 1)) / (n * width) * float(np.mean(of_matrix))
    return SelfInfluence(*(np.full(F, kappa / max(1 - kappa / dof, 0.1)) for kappa in (variance, matrix)))


def fill_zeros(variance: FloatArray) -> FloatArray:
    """Return the variances (F,) with zeros interpolated from the neighbouring lines."""
    lines = np.flatnonzero(variance)
    return np.interp(np.arange(len(variance)), lines, variance[lines])


def _smooth_power(variance: FloatArray, dof: float, width: int) -> FloatArray:
    """Return c l (F, ...) of sample variances with `dof` degrees of freedom; loud lines keep their own variance."""
    mean = np.exp(moving_mean(np.log(variance), width)) / math.exp(log_moment(1, dof, width))
    # Ratio of a sample variance to its expectation that one line in a thousand exceeds.
    by_chance = chi_square_limit(2 * dof, 1e-3) / (2 * dof) if width > 1 else math.inf
    loud = variance > mean * by_chance
    quiet = np.exp(moving_mean(np.log(np.where(loud, mean, variance)), width))
    return np.where(loud, variance, quiet * math.exp(log_moment(-1, dof, width)))


def smooth_variance(variance: FloatArray, G: ComplexArray, dof: float) -> tuple[FloatArray, FloatArray]:
    r"""Smooth sample variances (F, ...) of FRF elements. Return them and kappa (...), as `smooth_covariance`.

    The noise model is |G|^{2 a} with a in [0, 1] by regression: a = 0 for noise independent of resonances, a = 1 for
    noise proportional to G. Zero variances at single lines are interpolated; elements that are zero remain zero.
    """
    positive = np.any(variance > 0, axis=0)
    variances = np.apply_along_axis(fill_zeros, 0, np.where(positive, variance, 1.0))
    power, width = np.abs(G) ** 2, min(_width(1, dof), len(G))
    log_power = np.log(np.maximum(power, np.maximum(1e-30 * power.max(axis=0), 1e-300)))
    rough_power, log_variance = (log - moving_mean(log, width) for log in (log_power, np.log(variances)))
    a = np.sum(rough_power * log_variance, axis=0) / np.maximum(np.sum(rough_power**2, axis=0), 1e-300)
    model = np.exp(np.clip(a, 0.0, 1.0) * (log_power - log_power.mean(axis=0)))
    smooth = model * _smooth_power(variances / model, dof, width)
    filled = np.mean(variance / smooth, axis=0) / width
    return np.where(positive, smooth, 0.0), np.where(positive, filled / np.maximum(1 - filled / dof, 0.1), 0.0)


def moving_mean(values: Any, width: int) -> Any:
    """Return the mean over the `width` nearest lines, axis 0; at the ends the window stays inside."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    first = np.clip(np.arange(len(values)) - width // 2, 0, len(values) - width)
    return (total[first + width] - total[first]) / width


def log_moment(power: int, dof: float, width: int) -> float:
    """Return ln E[g^power] of the geometric mean g of `width` variables chi^2_{2 dof} / (2 dof); 0 if undefined."""
    step = power / width
    if math.isinf(dof) or dof + step <= 0:
        return 0.0
    return width * (math.lgamma(dof + step) - math.lgamma(dof) - step * math.log(dof))
