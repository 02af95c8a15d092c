"""The noise of a measured response as it weighs: its sample covariance smoothed over lines, in the form it came in."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import fdtr, gammainc

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.fit.weights.noise_components import NoiseShapes, noise_model
from elastid.fit.weights.smoothed_covariance import smooth_covariance
from elastid.fit.weights.smoothed_variance import smooth_variance
from elastid.response import Covariance, FrequencyResponse

# The total variance counts as below the noise, which is part of it, where chance puts it there once in so many times.
BELOW_NOISE_PROBABILITY = 1e-3


@frozen_value
class SmoothedNoise:
    """measured: the sample covariance taken; smooth: of neighbouring lines, so that weights 1 / v are unbiased.

    Both in the same form: matrices of all elements are worked out where they are needed and not kept.
    own_variance, own_matrix (F,): kappa, how much of variance and matrix is the line's own (`smooth_covariance`).
    """

    measured: Covariance
    smooth: Covariance
    own_variance: FloatArray
    own_matrix: FloatArray

    @property
    def variance(self) -> FloatArray:
        """The smooth variance v~ (F, n_y, n_u)."""
        return self.smooth.variance

    @property
    def is_diagonal(self) -> bool:
        """Whether variances alone are known."""
        return self.smooth.form == "diagonal"

    @property
    def covariance(self) -> ComplexArray:
        """The smooth covariance of vec G (F, n_y n_u, n_y n_u), diagonal where variances alone are known."""
        return self.smooth.full()

    @property
    def repeats(self) -> float:
        """Variance of sum tr(C~^-1 S) over that of the power of the errors themselves, each over its mean."""
        n_u = self.variance.shape[2] if self.measured.form == "kronecker" else 1
        return n_u / self.measured.dof


def smooth_noise(response: FrequencyResponse, width: int = 0) -> SmoothedNoise | None:
    """The smooth noise of a response: of the total covariance, or of the noise where the total lies below it.

    width: lines; 0 chooses it from the degrees of freedom.  None where no uncertainty is known.
    """
    known = _larger(response)
    if known is None:
        return None
    F, n_y, n_u = response.G.shape
    if known.form == "diagonal":
        variance, own = np.zeros(response.G.shape), np.zeros(F)
        for i, j in np.ndindex(n_y, n_u):
            variance[:, i, j], _, w = smooth_variance(known.variance[:, i, j], response.G[:, i, j], known.dof, width)
            own = np.full(F, 1 / w)
        return SmoothedNoise(known, Covariance(variance, known.dof), own, own)
    S = known.matrix if known.left is None or known.right is None else known.right
    assert S is not None
    if math.isinf(known.dof):
        return SmoothedNoise(known, known, np.zeros(F), np.zeros(F))
    found = smooth_covariance(S, _model(response, known, S), known.dof, width)
    power = np.einsum("faa->fa", found.covariance).real
    if known.left is None:
        smooth = Covariance(power.reshape(F, n_u, n_y).swapaxes(1, 2), known.dof, matrix=found.covariance)
    else:
        variance = power[:, :, None] * np.einsum("faa->fa", known.left).real[:, None, :]
        smooth = Covariance(variance, known.dof, known.left, found.covariance)
    return SmoothedNoise(known, smooth, found.own_variance, found.own)


def _model(response: FrequencyResponse, known: Covariance, S: ComplexArray) -> ComplexArray:
    """The model of S: of the outputs in the Kronecker form, else input by input."""
    if known.left is not None:
        weakness = np.mean(np.einsum("faa->fa", known.left).real, axis=1)
        return noise_model(S, NoiseShapes.of(response.freq_hz, response.G, response.quantity, weakness))
    shapes = NoiseShapes.of(response.freq_hz, response.G, response.quantity, None)
    _, n_y, n_u = response.G.shape
    model = np.zeros_like(S)
    for place in (slice(j * n_y, (j + 1) * n_y) for j in range(n_u)):
        model[:, place, place] = noise_model(S[:, place, place], shapes)
    return model


def _larger(response: FrequencyResponse) -> Covariance | None:
    """The total covariance, which holds the noise, or the noise where the total is smaller by more than chance.

    Their ratio, the geometric mean over lines and elements, is held against the F distribution of one line: errors of
    elements may be one error, and realisations that share their noise do so at all lines.
    """
    total, noise = response.total, response.noise
    if total is None or noise is None:
        return response.uncertainty
    both = (total.variance > 0) & (noise.variance > 0)
    if not both.any() or math.isinf(total.dof):
        return total
    ratio = math.exp(float(np.mean(np.log(total.variance[both] / noise.variance[both]))))
    far = gammainc(total.dof, total.dof * ratio) if math.isinf(noise.dof) else fdtr(2 * total.dof, 2 * noise.dof, ratio)
    return noise if far < BELOW_NOISE_PROBABILITY else total
