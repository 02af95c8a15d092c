r"""Losses that grow slower than the square, as weights that the fit takes again and again (IRLS).

.. math:: \text{huber: } w = \min(1, c s / z), \qquad \text{soft L1: } w = (1 + (z / c s)^2)^{-1/2}, \qquad
          z = \sqrt 2 |e| / \sigma

z has the Rayleigh distribution where the model is right. s >= 1 is the median of z beside that of noise alone, so that
a model error that all lines share is no reason to leave any of them behind. (Huber, Robust Statistics, 1981, 7.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.arrays import FloatArray
from elastid.fit.elastic import ElasticFit
from elastid.fit.residuals import RESIDUALS
from elastid.fit.spec import WeightSpec
from elastid.fit.weights import Weights

# Of the Rayleigh distribution with two components of unit variance.
MEDIAN = np.sqrt(2 * np.log(2))


def robust_factors(
    fit: ElasticFit, weights: Sequence[Weights], x: FloatArray, spec: WeightSpec
) -> tuple[FloatArray, ...]:
    """w (F, n_y, n_u) of each configuration at x (n_x,), 1 where an element is left out."""
    distances = []
    for part, weight in zip(fit.parts, weights, strict=True):
        e, _ = RESIDUALS[part.criterion](part.measured, part.kernel.response(fit.theta(part, x)))
        used = part.gain > 0
        gain = np.divide(part.gain, np.sqrt(weight.factor), out=np.zeros_like(part.gain), where=used)
        distances.append(np.where(used, gain * np.abs(np.where(used, e, 0.0)), 0.0))
    every = np.concatenate([z[part.gain > 0] for z, part in zip(distances, fit.parts, strict=True)])
    reach = spec.loss_scale * max(1.0, float(np.median(every)) / MEDIAN)
    if spec.loss == "huber":
        return tuple(np.minimum(1.0, reach / np.maximum(z, 1e-300)) for z in distances)
    return tuple(1 / np.sqrt(1 + (z / reach) ** 2) for z in distances)
