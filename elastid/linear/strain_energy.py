r"""Potential energy of a mode: the share of every spring, and that of weight and preload.

.. math:: w_s = \frac{c_s |b_s \phi|^2}{\phi^H K \phi}, \qquad w_g = 1 - \sum_s w_s, \qquad
          K = \partial^2 (V + \lambda_0^T \varphi) / \partial q^2

c_s, b_s: `ElasticModel.strain`. w_g: gravity, compensators and the turning of the torques at rest; negative where these
soften the mode, as the weight of an upright arm does.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.linear.equilibrium import OperatingPoint
from elastid.model.elastic import ElasticModel


@frozen_value
class StrainEnergy:
    """springs: names k_... of the parameters.  share (n_s, n_m) of each in each mode.  load (n_m,): w_g, the rest."""

    springs: tuple[str, ...]
    share: FloatArray
    load: FloatArray


def strain_energy(model: ElasticModel, theta: FloatArray, point: OperatingPoint, shapes: ComplexArray) -> StrainEnergy:
    """Of mode shapes (n_q, n_m) in all coordinates about an operating point; theta (n_theta,): model.parameters, SI.

    Neither the length nor the phase of a shape matters. NaN for a motion without potential energy, as that of a rigid
    body is.
    """
    c, b = (part.full() for part in model.strain(point.q, theta))
    K = model.stiffness(point.q, point.lambda_, theta).full()
    energy = np.einsum("im,ij,jm->m", shapes.conj(), K, shapes).real
    size = np.einsum("im,ij,jm->m", np.abs(shapes), np.abs(K), np.abs(shapes))
    energy = np.where(np.abs(energy) > 1e-12 * size, energy, np.nan)
    share = c * np.abs(b @ shapes) ** 2 / energy
    return StrainEnergy(model.springs, share, 1.0 - share.sum(axis=0))
