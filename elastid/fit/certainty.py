r"""How sure the estimate is: covariance under the measured noise, widened where the residuals say more.

Around the optimum the estimate follows the data as dx = A^-1 sum_k g_k, A = J^T J, with g_k = J_k^T r_k the pull of
line k. Two estimates of its covariance, of which each parameter gets the larger:

.. math:: \text{noise: } A^{-1} \Big[ \tfrac12 \mathrm{Re} \sum_k J_k^H S_k J_k \Big] A^{-1}, \qquad
          \text{residuals: } \mathrm{var}\, x_i = \tau \tfrac{N}{N - n_x} \sum_k (A^{-1} g_k)_i^2

- noise: S_k is the measured covariance in whitened residuals, correlations between elements included. With
  inverse-variance weights and uncorrelated elements it is A^-1 (Cramer-Rao); with a floor in the weights it is what the
  noise still does to the estimate.
- residuals: what is left over, noise or not. All that one frequency pulls, in all elements and configurations, counts
  as one pull: a wrong model errs in all of them together. tau >= 1 is the correlation length of the residuals over
  neighbouring lines, 1 + 2 sum of the autocorrelation up to the lag where chance could explain it.

For an exact model both agree and the larger of the two is a few per cent wide. What is wrong in the same way at all
lines and in all configurations shows in neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.arrays import BoolArray, ComplexArray, FloatArray
from elastid.fit.elastic import ElasticFit, Part
from elastid.fit.residuals import as_real, error_gain
from elastid.fit.weights import Weights
from elastid.response import FrequencyResponse

# Directions whose scaled singular value is below this share of the largest are not determined by the data.
RANK = 1e-8


@dataclass(frozen=True)
class Certainty:
    """covariance (n_x, n_x) of x, inf where unreached; singular_values of J with columns scaled to unit length.

    unreached (n_x,): parameters in a direction that no data reach.  expected_cost: V that the noise alone would give.
    """

    covariance: FloatArray
    singular_values: FloatArray
    unreached: BoolArray
    expected_cost: float


def certainty(
    fit: ElasticFit, responses: Sequence[FrequencyResponse], weights: Sequence[Weights], x: FloatArray
) -> Certainty:
    """The covariance of x (n_x,), the optimum of `fit`, from the measured noise and from the residuals."""
    n_x = len(x)
    prior = fit.prior_slopes
    R, meat, unknown = np.diag(prior), np.diag(prior**2), np.zeros((n_x, n_x))
    noise_power, unknown_count, cost = float(np.count_nonzero(prior)), 0, 0.0
    pulls: list[tuple[FloatArray, FloatArray]] = []
    residuals: list[ComplexArray] = []
    for part, response, weight, (r, J) in zip(fit.parts, responses, weights, fit.blocks(x), strict=True):
        R = _triangular(np.vstack([R, as_real(J).reshape(n_x, -1).T]))
        pulls.append((response.freq_hz, np.einsum("pfab,fab->pf", J.conj(), r).real))
        residuals.append(r.reshape(len(r), -1))
        cost += float(np.vdot(r, r).real)
        if weight.noise is None:
            unknown += _information(J)
            unknown_count += part.n_residuals
        else:
            S = _whitened_noise(part, weight)
            meat += _meat(J, S)
            noise_power += float(np.einsum("faa->", S).real)
    A_inverse, singular_values, unreached = _inverse_information(R)
    dof = fit.problem.dof
    # Where no noise was measured, the residuals themselves say how large it is.
    level = cost / max(dof, 1)
    meat += level * unknown
    noise_power += level * unknown_count
    noise = A_inverse @ meat @ A_inverse
    spread = (fit.n_residuals / max(dof, 1)) * correlation_length(residuals)
    leftover = spread * np.sum((A_inverse @ _by_frequency(pulls)) ** 2, axis=1)
    covariance = _widened(noise, leftover, A_inverse)
    covariance[unreached] = covariance[:, unreached] = np.nan
    covariance[unreached, unreached] = np.inf
    return Certainty(covariance, singular_values, unreached, noise_power - float(np.trace(A_inverse @ meat)))


def correlation_length(residuals: Sequence[ComplexArray]) -> float:
    r"""tau of whitened residuals (F, n) of each configuration, pooled; 1 for white ones.

    .. math:: \tau = 1 + 2 \sum_{l=1}^{L} \rho(l), \qquad \rho(l) = \mathrm{Re} \sum_k r_k^* r_{k+l} / \sum_k |r_k|^2

    L is the last lag before rho falls to what chance explains, at most a quarter of the lines.
    """
    power = sum(float(np.vdot(r, r).real) for r in residuals)
    count = sum(int(np.count_nonzero(r)) for r in residuals)
    longest = max((len(r) for r in residuals), default=0) // 4
    tau = 1.0
    for lag in range(1, longest + 1):
        rho = sum(float(np.vdot(r[:-lag], r[lag:]).real) for r in residuals) / max(power, 1e-300)
        if rho < np.sqrt(2 / max(count, 1)):  # two standard deviations of rho for white residuals
            break
        tau += 2 * rho
    return tau


def _whitened_noise(part: Part, weights: Weights) -> ComplexArray:
    """S (F, n_y n_u, n_y n_u), E|r|^2 of whitened residuals under the measured noise, vec column-major."""
    assert weights.noise is not None
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = part.gain * error_gain(part.criterion, part.measured) * weights.scale
    t = _vec(np.where(part.gain > 0, gain, 0.0))
    S: ComplexArray = t[:, :, None] * weights.noise.full() * t[:, None, :].conj()
    return S


def _triangular(rows: FloatArray) -> FloatArray:
    """R of rows = Q R."""
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=float)


def _vec(array: ComplexArray) -> ComplexArray:
    """(..., n_y, n_u) as (..., n_y n_u), elements of one input side by side."""
    return np.swapaxes(array, -1, -2).reshape(*array.shape[:-2], -1)


def _meat(J: ComplexArray, S: ComplexArray) -> FloatArray:
    """1/2 Re sum_k J_k^H S_k J_k (n_x, n_x), the covariance of the pull J^T r under the noise S."""
    columns = _vec(J).transpose(1, 2, 0)
    meat: FloatArray = 0.5 * np.sum(columns.conj().transpose(0, 2, 1) @ S @ columns, axis=0).real
    return meat


def _information(J: ComplexArray) -> FloatArray:
    rows = as_real(J).reshape(len(J), -1)
    information: FloatArray = rows @ rows.T
    return information


def _inverse_information(R: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """A^-1 of A = R^T R over the directions that the data reach, singular values, and which parameters lie outside.

    From R and not from A, whose condition number is the square.
    """
    length = np.linalg.norm(R, axis=0)
    length[length == 0] = 1.0
    _, singular_values, Vt = np.linalg.svd(R / length)
    reached = singular_values > RANK * max(singular_values[0], 1e-300)
    half = (Vt[reached] / singular_values[reached, None]) / length
    unreached: BoolArray = np.any(np.abs(Vt[~reached]) > 1e-3, axis=0)
    return half.T @ half, singular_values, unreached


def _by_frequency(pulls: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Pulls (n_x, F) of all configurations, those of one frequency summed up."""
    freq_hz = np.concatenate([freq for freq, _ in pulls])
    each, place = np.unique(freq_hz, return_inverse=True)
    total = np.zeros((len(each), pulls[0][1].shape[0]))
    np.add.at(total, place, np.concatenate([pull for _, pull in pulls], axis=1).T)
    return total.T


def _widened(noise: FloatArray, leftover: FloatArray, A_inverse: FloatArray) -> FloatArray:
    """Variances the larger of noise and leftover (n_x,), correlations those of the noise (or of A^-1 without any)."""
    variance = np.diag(noise)
    shape = noise if np.all(variance > 0) else A_inverse
    wanted = np.sqrt(np.maximum(variance, leftover))
    deviation = np.sqrt(np.diag(shape))
    scale = np.divide(wanted, deviation, out=np.zeros_like(wanted), where=deviation > 0)
    widened: FloatArray = shape * np.outer(scale, scale)
    return widened
