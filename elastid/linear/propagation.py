r"""Uncertainty of the parameters propagated to modes and frequency responses.

.. math:: \frac{d\lambda}{dx} = - \frac{\phi^T (\lambda^2\, dM + \lambda\, dD + dK)\, \phi}
                                        {\phi^T (2 \lambda M + D)\, \phi}, \qquad
          \mathrm{cov}\, y = \frac{dy}{dx}\, \mathrm{cov}\, x\, \frac{dy}{dx}^H

to first order; M, D, K are symmetric, so that left and right eigenvectors are one (Adhikari, JSV 2000, 10).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.linear_model import LinearModel
from elastid.linear.modes import modes
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import checked_frequencies
from elastid.parameters import ParameterSet

# Standard deviation of x, mostly logarithms, that stands for none at all.
UNREACHED_STD = 100.0


@dataclass(frozen=True)
class UncertainModes:
    """Natural frequencies (n_m,) in Hz and damping ratios (n_m,) with their standard deviations."""

    freq_hz: FloatArray
    freq_std: FloatArray
    zeta: FloatArray
    zeta_std: FloatArray


def uncertain_modes(
    model: LinearModel, parameters: ParameterSet, x: FloatArray, covariance: FloatArray
) -> UncertainModes:
    """The oscillating modes at x (n_x,) of covariance (n_x, n_x); infinite deviations where they need infinite ones."""
    where = model.configuration.name
    theta = parameters.expand(x, where)
    found = modes(model, theta)
    omega = 2 * np.pi * found.freq_hz
    poles = omega * (-found.zeta + 1j * np.sqrt(np.maximum(1 - found.zeta**2, 0.0)))
    slopes = _pole_slopes(model, theta, poles, found.shapes) @ parameters.jacobian(x, where)
    # d|lambda| = Re(conj(lambda) dlambda) / |lambda|; zeta = -Re lambda / |lambda|.
    d_omega = (poles.conj()[:, None] * slopes).real / omega[:, None]
    d_zeta = -(slopes.real + found.zeta[:, None] * d_omega) / omega[:, None]
    return UncertainModes(
        found.freq_hz, _deviation(d_omega / (2 * np.pi), covariance), found.zeta, _deviation(d_zeta, covariance)
    )


def response_deviation(
    model: LinearModel, freq_hz: FloatArray, parameters: ParameterSet, x: FloatArray, covariance: FloatArray
) -> tuple[ComplexArray, FloatArray]:
    """G (F, n_y, n_u) and the standard deviation E|dG|^2 ^ 1/2 (F, n_y, n_u) by the covariance of x."""
    G, J = _response_slopes(model, freq_hz, parameters, x)
    flat = J.reshape(len(x), -1).T
    return G, np.hypot(_deviation(flat.real, covariance), _deviation(flat.imag, covariance)).reshape(G.shape)


def response_shifts(
    model: LinearModel, freq_hz: FloatArray, parameters: ParameterSet, x: FloatArray, covariance: FloatArray
) -> ComplexArray:
    """Changes of G (n_x, F, n_y, n_u) by one standard deviation of x in each of n_x independent directions.

    An unreached parameter counts with UNREACHED_STD.
    """
    _, J = _response_slopes(model, freq_hz, parameters, x)
    unreached = np.isinf(np.diag(covariance))
    known = np.where(unreached[:, None] | unreached, 0.0, covariance) + UNREACHED_STD**2 * np.diag(unreached)
    values, vectors = np.linalg.eigh(known)
    return np.asarray(np.tensordot((vectors * np.sqrt(np.maximum(values, 0.0))).T, J, axes=1))


def _response_slopes(
    model: LinearModel, freq_hz: FloatArray, parameters: ParameterSet, x: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """G (F, n_y, n_u) and dG/dx (n_x, F, n_y, n_u); ValueError for a frequency that is not positive."""
    freq_hz = checked_frequencies(freq_hz)
    where = model.configuration.name
    kernel = Kernel(model, freq_hz, parameters.moved(where))
    G, dG = kernel.evaluate(parameters.expand(x, where))
    moved = [parameters.index(name) for name in kernel.wanted]
    return G, np.asarray(np.tensordot(parameters.jacobian(x, where)[moved].T, dG, axes=1))


def _deviation(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    """Standard deviations of y (n,) with slopes dy/dx (n, n_x)."""
    unreached = np.isinf(np.diag(covariance))
    known = np.where(unreached[:, None] | unreached, 0.0, covariance)
    variance = np.einsum("ni,ij,nj->n", slopes, known, slopes)
    felt = np.any(np.abs(slopes[:, unreached]) > 1e-12 * np.abs(slopes).max(initial=1e-300), axis=1)
    return np.where(felt, np.inf, np.sqrt(np.maximum(variance, 0.0)))


def _pole_slopes(model: LinearModel, theta: FloatArray, poles: ComplexArray, shapes: ComplexArray) -> ComplexArray:
    """d lambda / d theta (n_m, n_theta)."""
    M, D, _ = model.matrices(theta)
    slopes = np.zeros((len(poles), len(model.parameters)), complex)
    norm = np.einsum("nm,m,nk,km->m", shapes, 2 * poles, M, shapes) + np.einsum("nm,nk,km->m", shapes, D, shapes)
    for name, slope in model.slopes.items():
        change = np.zeros(len(poles), complex)
        for power, matrix in enumerate((slope.K, slope.D, slope.M)):
            if matrix is not None:
                change += poles**power * np.einsum("nm,nk,km->m", shapes, matrix, shapes)
        slopes[:, model.parameters.index(name)] = -change / norm
    return slopes
