r"""Covariance of a mean frequency response: from the scatter of periods (noise) and of realisations (total).

To first order every estimator has the error sum_m V_m W_m with the equation error V = Y - G U and U W = 1, so

.. math:: cov(vec\, \hat G) = \sum_m (W_m^T diag(1 / P_e)\, W_m^*) \otimes C_V, \quad
          C_V = \Gamma C_Z \Gamma^H, \quad \Gamma = [1, -G]

with C_V the covariance (n_y, n_y) of V in one period: it holds the noise of outputs and inputs together, so that
neither the (n_y + n_u) n_u square covariance of all spectra nor its Jacobian is ever formed.
(Pintelon and Schoukens, System Identification, 2nd ed., section 2.7, in the form of the equation error.)

Degrees of freedom are complex: a variance with dof of them scatters by 1 / sqrt(dof) of itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray
from elastid.base.statistics import mean_of_neighbours
from elastid.frf.experiment_blocks import MeanSpectra
from elastid.frf.matrices import added_error_products, adjoint, positive, power, squared_magnitude
from elastid.frf.methods import Estimate
from elastid.response import Covariance

LEVEL_WIDTH = 9  # lines whose mean square is the level of an error in the middle
MIN_LEVEL_POWER = 7.0  # |rho|^2 of white errors in its expectation, which one in a thousand exceeds


def equation_error(data: MeanSpectra, G: ComplexArray) -> ComplexArray:
    """C_V (F, n_y, n_y) = Gamma C_Z Gamma^H, Gamma = [1, -G]."""
    n_y, S, B = G.shape[1], data.S_Z, adjoint(G)
    cross = S[:, :n_y, n_y:] @ B
    return np.asarray((S[:, :n_y, :n_y] - cross - adjoint(cross) + G @ (S[:, n_y:, n_y:] @ B)) / data.dof)


def noise_covariance(data: MeanSpectra, estimate: Estimate, C_V: ComplexArray) -> Covariance:
    """Covariance of vec G by the disturbing noise: sum_m (W_m^T diag(1/P) W_m^*) (x) C_V."""
    P = data.periods
    if np.ptp(P) == 0:
        return kronecker(estimate.left / P[0], C_V, data.dof)
    weighted = [W / np.sqrt(block.periods[:, None]) for block, W in zip(data.blocks, estimate.W, strict=True)]
    return kronecker(replace(estimate, W=tuple(weighted)).left, C_V, data.dof)


def total_error(data: MeanSpectra, estimate: Estimate) -> tuple[ComplexArray, int] | None:
    r"""C_T (F, n_y, n_y) of one experiment from the scatter of K experiments about the mean, and its dof.

    With D = Y - G U of all of them, U and W side by side,

    .. math:: C_T = \frac{D D^H}{K - 2 n_u + tr(W^H W\, U U^H)}

    The denominator is K - n_u where all have one excitation and makes C_T unbiased where they do not.  None for one
    realisation, or where no experiment is left over when G is fitted.
    """
    n_u = estimate.G.shape[2]
    K = len(data.periods)
    if len(data.blocks) < 2 or n_u >= K:
        return None
    expected = K - 2 * n_u + np.einsum("fba,fba->f", estimate.left, data.UU).real
    D_squared = added_error_products(data.Y, estimate.G, data.U)
    D_squared /= expected[:, None, None]
    return D_squared, K - n_u


def total_covariance(data: MeanSpectra, estimate: Estimate, C_T: ComplexArray, dof: float) -> Covariance:
    """Covariance of vec G by noise and stochastic nonlinear distortion together: sum_m (W_m^T W_m^*) (x) C_T.

    The sample covariance where the realisations alone give twice as many degrees of freedom as vec G has elements: it
    does not assume the same disturbance in every experiment.  With fewer its inverse is useless.
    """
    _, n_y, n_u = estimate.G.shape
    M = len(data.blocks)
    if n_u == 1 or 2 * n_y * n_u > M - 1 or any(U.shape[2] < n_u for U in data.U):
        return kronecker(estimate.left, C_T, dof)
    D = np.stack([block.Y @ block.W for block in data.blocks])
    D = D - D.mean(axis=0)
    vec = D.transpose(1, 3, 2, 0).reshape(len(estimate.G), -1, M)
    return full_covariance(vec @ adjoint(vec) / (M - 1) / M, estimate.G.shape, M - 1)


def distortion_covariance(noise: Covariance, total: Covariance, M: int) -> Covariance:
    """Covariance of one realisation's vec G by stochastic nonlinear distortion: M (total - noise), no less than zero.

    Negative eigenvalues of the difference, which occur by chance where noise dominates, are set to zero.
    """
    if total.left is not None and total.right is not None and noise.left is not None and noise.right is not None:
        share = np.einsum("fii->f", noise.left).real / np.einsum("fii->f", total.left).real
        of_total, of_noise, weight = M * total.right, noise.right, M * share[:, None, None]
        of_total -= weight * of_noise
        return kronecker(total.left, positive(of_total), total.dof)
    if total.matrix is not None:
        matrix = M * positive(total.matrix - noise.full())
        return full_covariance(matrix, total.variance.shape, total.dof)
    return Covariance(M * np.maximum(total.variance - noise.variance, 0.0), total.dof)


def kronecker(left: ComplexArray, right: ComplexArray, dof: float) -> Covariance:
    """left (x) right; fewer degrees of freedom than outputs leave right singular, until it is smoothed over lines."""
    variance = power(right)[:, :, None] * power(left)[:, None, :]
    for array in (left, right, variance):
        array.flags.writeable = False  # so that no copy is needed
    return Covariance(variance, dof, left, right)


def level_lines(V: ComplexArray, G: ComplexArray) -> float:
    r"""Lines over which the errors V (K, F, n_y) of K experiments or periods have one level by chance.

    .. math:: 1 + 2 \sum_l (1 - l / F) |\rho(l)|^2, \qquad \rho(l) = \text{autocorrelation of } G^+ V

    the largest over inputs, up to the first lag without any.

    A torque that wanders through a period leaks into all lines with one amplitude, which turns the phases of G by those
    of the excitation: errors of G at neighbouring lines are uncorrelated, their squares are not.  G (F, n_y, n_u).
    """
    F = len(G)
    torque = (V.swapaxes(0, 1) @ np.linalg.pinv(G).swapaxes(1, 2)).swapaxes(0, 1)
    level = mean_of_neighbours(np.mean(squared_magnitude(torque), axis=0), LEVEL_WIDTH)
    torque = np.divide(torque, np.sqrt(level), out=np.zeros_like(torque), where=level > 0)
    spectrum = np.sum(squared_magnitude(np.fft.fft(torque, 2 * F, axis=1)), axis=0)
    R = np.abs(np.fft.ifft(spectrum, axis=0)[: F // 2]) ** 2
    lag = np.arange(1, len(R))[:, None]
    squared = R[1:] / np.maximum(R[0], 1e-300) * (F / (F - lag)) ** 2
    counts = np.cumprod(squared > MIN_LEVEL_POWER / (len(V) * F), axis=0)
    return float(np.max(1 + 2 * np.sum((1 - lag / F) * counts * squared, axis=0)))


def full_covariance(matrix: ComplexArray, shape: tuple[int, ...], dof: float) -> Covariance:
    """A covariance of vec G (F, n_y n_u, n_y n_u) with its variances in the shape (F, n_y, n_u) of G."""
    F, n_y, n_u = shape
    variance = power(matrix).reshape(F, n_u, n_y).transpose(0, 2, 1)
    return Covariance(variance, dof, matrix=matrix)
