r"""Natural frequencies, damping, mode shapes and strain energies of a LinearModel.

.. math:: (\lambda^2 M + \lambda D + K)\, \phi = 0, \qquad f = |\lambda| / 2\pi, \quad
          \zeta = -\mathrm{Re}\,\lambda / |\lambda|

.. math:: w_s = \frac{c_s |b_s \phi|^2}{\phi^H K \phi}, \qquad w_g = 1 - \sum_s w_s, \qquad
          K = \partial^2 (V + \lambda_0^T \varphi) / \partial q^2

c_s, b_s: `ElasticModel.strain`. w_g: fraction of gravity, compensators and geometric stiffness; negative if these
soften the mode, like the weight of an upright arm.
"""

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.linear.equilibrium import OperatingPoint
from elastid.linear.linear_model import LinearModel
from elastid.model.elastic import ElasticModel

RIGID_RATE = 1e-6  # largest |lambda| of a rigid-body mode over the largest |lambda|: rounding splits a double zero


@frozen_value
class Modes:
    """Oscillating modes by rising frequency: freq_hz (n_m,), damping ratio zeta (n_m,), shapes (n, n_m).

    The largest entry of a shape is 1.  real_poles: lambda in 1/s of rigid-body modes (0) and overdamped modes, by
    magnitude; positive if gravity makes the configuration unstable with free motors.
    """

    freq_hz: FloatArray
    zeta: FloatArray
    shapes: ComplexArray
    real_poles: FloatArray

    @property
    def poles(self) -> ComplexArray:
        """lambda (n_m,) in 1/s of each mode, with positive imaginary part."""
        return 2 * np.pi * self.freq_hz * (1j * np.sqrt(np.maximum(1 - self.zeta**2, 0.0)) - self.zeta)


def modes(model: LinearModel, theta: FloatArray) -> Modes:
    """Return modes with the motors free, at theta (n_theta,): the poles of the frequency response."""
    poles, shapes, real = oscillations(*model.matrices(theta))
    poles, decaying = poles[~np.isnan(poles)], real[~np.isnan(real)]
    freq_hz, zeta = np.abs(poles) / (2 * np.pi), -poles.real / np.abs(poles)
    return Modes(freq_hz, zeta, normalise(shapes[:, : len(poles)]), decaying[np.argsort(np.abs(decaying))])


def oscillations(M: FloatArray, D: FloatArray, K: FloatArray) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """Solve (lambda^2 M + lambda D + K) phi = 0 for M, D, K (..., n, n).

    Return lambda (..., n) of oscillations by increasing frequency, then NaN, their phi (..., n, n), and the real lambda
    (..., 2 n), NaN for others.
    """
    n = M.shape[-1]
    # In a frequency unit that brings M^-1 K and M^-1 D to order one.
    rate = np.sqrt(np.abs(K).max((-2, -1), initial=0.0) / np.abs(M).max((-2, -1), initial=1e-300))[..., None, None]
    rate = np.where(rate > 0, rate, 1.0)
    A = np.zeros((*M.shape[:-2], 2 * n, 2 * n))
    A[..., :n, n:] = np.eye(n)
    A[..., n:, :] = np.linalg.solve(M, np.concatenate([-K / rate**2, -D / rate], axis=-1))
    values, shapes = np.linalg.eig(A)
    scale = np.abs(values).max(axis=-1, keepdims=True, initial=0.0)
    poles = np.where(np.abs(values) <= RIGID_RATE * scale, 0.0, values * rate[..., 0])
    is_real = np.abs(values.imag) <= RIGID_RATE * scale
    is_oscillation = ~is_real & (poles.imag > 0)
    order = np.argsort(np.where(is_oscillation, np.abs(poles), np.inf), axis=-1, kind="stable")[..., :n]
    sorted_poles = np.take_along_axis(np.where(is_oscillation, poles, np.nan), order, -1).astype(complex)
    shapes = np.take_along_axis(shapes[..., :n, :], order[..., None, :], -1).astype(complex)
    return sorted_poles, shapes, np.where(is_real, poles.real, np.nan)


def robot_shapes(model: LinearModel, shapes: ComplexArray) -> ComplexArray:
    """Return the shapes (n, n_m) of a model in all coordinates of the robot (n_q, n_m), with largest entry 1."""
    return normalise(model.Z @ shapes)


def normalise(shapes: ComplexArray) -> ComplexArray:
    """Scale the columns of shapes (n, n_m) to a largest entry of 1."""
    if not shapes.size:
        return shapes
    return shapes / np.take_along_axis(shapes, np.abs(shapes).argmax(axis=0)[None], axis=0)


@frozen_value
class StrainEnergy:
    """Strain energy of modes.

    springs: names k_... of the parameters.  fraction (n_s, n_m): w_s of each spring.  load (n_m,): w_g.
    """

    springs: tuple[str, ...]
    fraction: FloatArray
    load: FloatArray


def strain_energy(model: ElasticModel, theta: FloatArray, point: OperatingPoint, shapes: ComplexArray) -> StrainEnergy:
    """Return the energy of mode shapes (n_q, n_m) about an operating point; theta (n_theta,): model.parameters, SI.

    Independent of the length and phase of a shape.  NaN for a motion without potential energy (rigid-body mode).
    """
    c, b = (matrix.full() for matrix in model.strain(point.q, theta))
    K = model.stiffness(point.q, point.lambda_, theta).full()
    energy = np.einsum("im,ij,jm->m", shapes.conj(), K, shapes).real
    size = np.einsum("im,ij,jm->m", np.abs(shapes), np.abs(K), np.abs(shapes))
    energy = np.where(np.abs(energy) > 1e-12 * size, energy, np.nan)
    fraction = c * np.abs(b @ shapes) ** 2 / energy
    return StrainEnergy(model.springs, fraction, 1.0 - fraction.sum(axis=0))
