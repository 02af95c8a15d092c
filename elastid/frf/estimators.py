r"""Estimators of a mean frequency response, and its covariance by the scatter of periods and of realisations (total).

Each estimator uses the mean spectra of all realisations; `errors_in_variables` also uses the covariance C_Z of [Y; U]
in one period. It returns G (F, n_y, n_u) with weights W_m and scale s, so that to first order in the equation error V =
Y - G U

.. math:: \hat G - G = s \sum_m V_m W_m, \quad s \sum_m U_m W_m = 1

(Wernholt and Moberg, LiTH-ISY-R-2827, 2008; Guillaume, Pintelon and Schoukens, IEEE TIM 41(6), 1992.) So

.. math:: cov(vec\, \hat G) = \sum_m (W_m^T diag(1 / P_e)\, W_m^*) \otimes C_V, \quad
          C_V = \Gamma C_Z \Gamma^H, \quad \Gamma = [1, -G]

C_V (n_y, n_y): covariance of V in one period, by the noise of outputs and inputs. The (n_y + n_u) n_u square covariance
of all spectra and its Jacobian are not needed.
(Pintelon and Schoukens, System Identification, 2nd ed., section 2.7, for the equation error.)

Degrees of freedom are complex: a variance with dof of them has the relative std 1 / sqrt(dof).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import ComplexArray, mean_of_neighbours
from elastid.base.errors import DataError
from elastid.base.matrices import added_cross_products, added_error_products, added_products, power, squared_magnitude
from elastid.frf.experiment_blocks import MeanSpectra
from elastid.response import Covariance

MIN_CORRELATION_POWER = 7.0  # |rho|^2 over its expectation for white errors, which one in a thousand exceeds


@dataclass(frozen=True)
class Estimate:
    """G (F, n_y, n_u) and the weights s W_m, W_m (F, E_m, n_u), of every block's equation error."""

    G: ComplexArray
    W: tuple[ComplexArray, ...]
    scale: float = 1.0

    @cached_property
    def input_factor(self) -> ComplexArray:
        """s^2 sum_m W_m^T W_m^* (F, n_u, n_u): the input factor, where all errors V have the same covariance."""
        W = [W_m.mT for W_m in self.W]
        return self.scale**2 * added_cross_products(W, W)


def arithmetic(data: MeanSpectra) -> Estimate:
    """Return G = (1/M) sum_m G_m,  G_m = Y_m U_m^-1, the arithmetic mean over realisations."""
    W, weight = tuple(block.W for block in data.blocks), 1 / len(data.blocks)
    return Estimate(weight * added_products(data.Y, W), W, scale=weight)


def h1(data: MeanSpectra) -> Estimate:
    """Return G = (sum Y U^H)(sum U U^H)^-1: least squares with all noise on the outputs, biased in closed loop."""
    return _instrumental(data, data.U)


def joint(data: MeanSpectra) -> Estimate:
    """Return G = (sum Y R^H)(sum U R^H)^-1, the ratio of the responses to the injected torque; DataError without it."""
    R = [block.R for block in data.blocks if block.R is not None]
    if len(R) < len(data.blocks):
        raise DataError(
            "frf/method",
            (
                "estimator.method joint needs the injected torque r of every record. Log r, or set estimator.method "
                "arithmetic"
            ),
        )
    return _instrumental(data, R)


def errors_in_variables(data: MeanSpectra) -> Estimate:
    r"""Return the maximum likelihood estimate with noise of inputs and outputs: generalised total least squares.

    .. math:: \hat G = \arg\min_G \sum_e P_e\, V_e^H (\Gamma C_Z \Gamma^H)^{-1} V_e, \quad \Gamma = [1, -G]

    Whitened by C_Z, [Y; U] spans the n_u strongest directions Q: G = Q_y Q_u^-1.
    (Pintelon and Schoukens, System Identification, 2nd ed., chapter 9, for a nonparametric G.)
    """
    Y, U = data.all_experiments.Y, data.all_experiments.U
    n_y, n_u = Y.shape[1], U.shape[1]
    Z = np.concatenate([Y, U], axis=1) * np.sqrt(data.periods)
    rms = np.sqrt(np.mean(np.abs(Z) ** 2, axis=2))
    rms[rms == 0] = 1.0
    Z, noise = Z / rms[:, :, None], data.S_Z / data.dof / (rms[:, :, None] * rms[:, None, :])
    L = np.linalg.cholesky(noise + 1e-14 * np.eye(n_y + n_u))  # regular for exact data, too
    white = np.linalg.solve(L, Z)
    Q = rms[:, :, None] * (L @ np.linalg.eigh(white @ white.mT.conj())[1][:, :, -n_u:])
    return replace(h1(data), G=Q[:, :n_y] @ np.linalg.inv(Q[:, n_y:]))


METHODS = {"arithmetic": arithmetic, "h1": h1, "joint": joint, "errors_in_variables": errors_in_variables}


def _instrumental(data: MeanSpectra, instruments: Sequence[ComplexArray]) -> Estimate:
    """Return G = (sum Y A^H)(sum U A^H)^-1, W = A^H (sum U A^H)^-1."""
    of_inputs = np.linalg.inv(np.sum([U @ A.mT.conj() for U, A in zip(data.U, instruments, strict=True)], axis=0))
    W = tuple(A.mT.conj() @ of_inputs for A in instruments)
    G: ComplexArray = np.sum([Y @ W_m for Y, W_m in zip(data.Y, W, strict=True)], axis=0)
    return Estimate(G, W)


def equation_error(data: MeanSpectra, G: ComplexArray) -> ComplexArray:
    """Return C_V (F, n_y, n_y) = Gamma C_Z Gamma^H, Gamma = [1, -G]."""
    n_y, S = G.shape[1], data.S_Z
    cross, of_inputs = (added_cross_products([S[:, rows, n_y:]], [G]) for rows in (slice(n_y), slice(n_y, None)))
    C_V = added_products([G], [of_inputs])
    C_V += S[:, :n_y, :n_y]
    C_V -= cross
    C_V -= cross.mT.conj()
    C_V /= data.dof
    return C_V


def noise_covariance(data: MeanSpectra, estimate: Estimate, C_V: ComplexArray) -> Covariance:
    """Return covariance of vec G by noise: sum_m (W_m^T diag(1/P) W_m^*) (x) C_V.  C_V (F, n_y, n_y): in one period."""
    P = data.periods
    if np.ptp(P) == 0:
        return kronecker(estimate.input_factor / P[0], C_V, data.dof)
    weighted = [W / np.sqrt(block.periods[:, None]) for block, W in zip(data.blocks, estimate.W, strict=True)]
    return kronecker(replace(estimate, W=tuple(weighted)).input_factor, C_V, data.dof)


def total_error(data: MeanSpectra, estimate: Estimate) -> tuple[ComplexArray, int] | None:
    r"""Return C_T (F, n_y, n_y) of one experiment from the scatter of K experiments about the mean, and its dof.

    With D = Y - G U, U and W of all experiments,

    .. math:: C_T = \frac{D D^H}{K - 2 n_u + tr(W^H W\, U U^H)}

    The denominator makes C_T unbiased; it is K - n_u for equal excitations.  None for one realisation, or if the number
    of experiments does not exceed the number of inputs.
    """
    n_u = estimate.G.shape[2]
    K = len(data.periods)
    if len(data.blocks) < 2 or n_u >= K:
        return None
    expected_power = K - 2 * n_u + np.einsum("fba,fba->f", estimate.input_factor, data.UU).real
    D_squared = added_error_products(data.Y, estimate.G, data.U)
    D_squared /= expected_power[:, None, None]
    return D_squared, K - n_u


def total_covariance(data: MeanSpectra, estimate: Estimate, C_T: ComplexArray, dof: float) -> Covariance:
    """Return covariance of vec G by noise and stochastic nonlinear distortion together: sum_m (W_m^T W_m^*) (x) C_T.

    The sample covariance, if the realisations have at least twice as many degrees of freedom as vec G has elements: it
    allows different disturbances in each experiment.  With fewer its inverse is too inaccurate.
    """
    _, n_y, n_u = estimate.G.shape
    M = len(data.blocks)
    if n_u == 1 or 2 * n_y * n_u > M - 1 or any(U.shape[2] < n_u for U in data.U):
        return kronecker(estimate.input_factor, C_T, dof)
    D = np.stack([block.Y @ block.W for block in data.blocks])
    D = D - D.mean(axis=0)
    vec = D.transpose(1, 3, 2, 0).reshape(len(estimate.G), -1, M)
    return full_covariance(vec @ vec.mT.conj() / (M - 1) / M, estimate.G.shape, M - 1)


def kronecker(left: ComplexArray, right: ComplexArray, dof: float) -> Covariance:
    """Return the covariance left (F, n_u, n_u) (x) right (F, n_y, n_y); singular for dof < n_y without smoothing."""
    variance = power(right)[:, :, None] * power(left)[:, None, :]
    for array in (left, right, variance):
        array.flags.writeable = False  # so that no copy is needed
    return Covariance(variance, dof, left, right)


def averaging_lines(V: ComplexArray, G: ComplexArray) -> float:
    r"""Return the number of neighbouring lines with correlated power of the errors V (K, F, n_y) of K experiments.

    .. math:: 1 + 2 \sum_l (1 - l / F) |\rho(l)|^2, \qquad \rho(l) = \text{autocorrelation of } G^+ V

    the largest over inputs, summed up to the first lag without correlation.  G (F, n_y, n_u).

    A torque that drifts within a period leaks into all lines with one amplitude. The random phases of the excitation
    make the errors of G at neighbouring lines uncorrelated, but not their squares.
    """
    F = len(G)
    torque = (V.swapaxes(0, 1) @ np.linalg.pinv(G).swapaxes(1, 2)).swapaxes(0, 1)
    mean_power = mean_of_neighbours(np.mean(squared_magnitude(torque), axis=0))
    torque = np.divide(torque, np.sqrt(mean_power), out=np.zeros_like(torque), where=mean_power > 0)
    spectrum = np.sum(squared_magnitude(np.fft.fft(torque, 2 * F, axis=1)), axis=0)
    R = np.abs(np.fft.ifft(spectrum, axis=0)[: max(1, F // 2)]) ** 2
    lag = np.arange(1, len(R))[:, None]
    correlation = R[1:] / np.maximum(R[0], 1e-300) * (F / (F - lag)) ** 2
    counts = np.cumprod(correlation > MIN_CORRELATION_POWER / (len(V) * F), axis=0)
    return float(np.max(1 + 2 * np.sum((1 - lag / F) * counts * correlation, axis=0)))


def full_covariance(matrix: ComplexArray, shape: tuple[int, ...], dof: float) -> Covariance:
    """Return a covariance of vec G (F, n_y n_u, n_y n_u) with its variances in the shape (F, n_y, n_u) of G."""
    F, n_y, n_u = shape
    return Covariance(power(matrix).reshape(F, n_u, n_y).transpose(0, 2, 1), dof, matrix=matrix)
