"""Weights of the elements of a measured response: variances, or the full covariance of a line."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from typing import Any

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen, frozen_value, quotient
from elastid.base.errors import DataError, Note, StudyError, did_you_mean
from elastid.base.matrices import inverse
from elastid.base.messages import WorkerConstant
from elastid.base.names import posture_of
from elastid.covariance import kronecker
from elastid.fit.problem.smoothed_noise import SmoothedNoise, smooth_noise
from elastid.fit.spec import TYPICAL_MODEL_ERROR, FactorSpec, FitSpec, find_unknown_names
from elastid.response import Covariance, Response


@dataclass(frozen=True, eq=False)
class Whitening(WorkerConstant):
    """Whitening of errors relative to sigma (F, n_y, n_u), inf for excluded elements.

    noise: C~.  model_error: relative to |G| (F, n_y, n_u).  The matrices are not stored, to save memory.
    """

    noise: Covariance
    model_error: float
    G: ComplexArray
    sigma: FloatArray

    @property
    def matrix(self) -> ComplexArray:
        """L^-1 (F, n_y n_u, n_y n_u) of C~ relative to sigma, elements in the order of G; computed at every call."""
        F, n_y, n_u = self.sigma.shape
        is_used = np.isfinite(self.sigma)
        s = np.where(is_used, self.sigma, 1.0).reshape(F, 1, -1)
        factors = kronecker_factors(self.noise, is_used, is_split=self.model_error == 0)
        self.noise.release()
        if len(factors) == 2:
            return inverse_cholesky(factors[::-1]) * s
        diagonal = np.arange(n_y * n_u)
        row_by_row = diagonal.reshape(n_u, n_y).T.ravel()
        C = factors[0][:, row_by_row[:, None], row_by_row]
        C[:, diagonal, diagonal] += (self.model_error * np.abs(self.G)).reshape(F, -1) ** 2
        return inverse_cholesky([C / (s.mT * s)])

    def lines(self, rows: BoolArray | slice) -> "Whitening":
        """Return the whitening on a subset of lines; rows: mask (F,) or slice."""
        mask = np.zeros(len(self.sigma), dtype=np.bool_)
        mask[rows] = True
        noise = self.noise.lines(mask)
        self.noise.release()
        return Whitening(noise, self.model_error, self.G[rows], self.sigma[rows])


def kronecker_factors(noise: Covariance, is_used: BoolArray, is_split: bool = True) -> tuple[ComplexArray, ...]:
    """Return (left, right) if split, else (cov(vec G),); identity for elements not in `is_used` (F, n_y, n_u)."""
    flat = vec(is_used)
    lines = flat.all(axis=1)
    if is_split and noise.left is not None and noise.right is not None and np.array_equal(lines, flat.any(axis=1)):
        return tuple(np.where(lines[:, None, None], part, np.eye(part.shape[1])) for part in (noise.left, noise.right))
    C = np.where(flat[:, :, None] & flat[:, None, :], noise.full(), 0.0)
    C[:, range(C.shape[1]), range(C.shape[1])] += ~flat
    return (C,)


def inverse_cholesky(factors: Sequence[ComplexArray]) -> ComplexArray:
    """Return L^-1 (F, n, n) of C = L L^H from the Cholesky factors of the Kronecker factors of C.

    Raises LinAlgError where C is singular.
    """
    return reduce(kronecker, [inverse(np.asarray(np.linalg.cholesky(C))) for C in factors])


def _is_singular(noise: Covariance, sigma: FloatArray) -> bool:
    ends = np.ones((len(sigma), 2))  # least and largest eigenvalue of each line
    for C in kronecker_factors(noise, np.isfinite(sigma)):
        deviation = np.sqrt(np.einsum("faa->fa", C).real)
        ends *= np.linalg.eigvalsh(C / (deviation[:, :, None] * deviation[:, None, :]))[:, [0, -1]]
    return bool(np.any(ends[:, 0] < 1e-10 * ends[:, 1]))  # rounding


@frozen_value
class Weights(WorkerConstant):
    """Weights of one response: inverse variances factor / sigma^2 of its elements, or a covariance per line.

    sigma (F, n_y, n_u): standard deviation E|dG|^2 ^ 1/2, inf for excluded elements.  factor (F, n_y, n_u): of the
    study. noise: of the response, None if unknown.  scale (F, n_y, n_u): scale_a S_ab scale_b corrects the measured
    covariance S for its own influence on the weights.  model_error: relative to |G|.  notes: excluded elements, with
    the reason. correlated: noise covariance if the elements of a line are weighted jointly; None for single variances.
    """

    sigma: FloatArray
    noise: SmoothedNoise | None
    scale: FloatArray
    model_error: float
    notes: tuple[Note, ...]
    factor: FloatArray
    correlated: Covariance | None = None

    @property
    def is_used(self) -> BoolArray:
        """True for used elements (F, n_y, n_u)."""
        return np.isfinite(self.sigma)

    def noise_covariance(self) -> ComplexArray | None:
        """Return the measured cov(vec G) (F, n_y n_u, n_y n_u), for sums over lines; None if unknown."""
        if self.noise is None:
            return None
        t = vec(self.scale)
        scaled = np.asarray(t[:, :, None] * self.noise.measured.full() * t[:, None, :])
        self.noise.measured.release()
        return scaled


def weigh(response: Response, spec: FitSpec) -> Weights:
    """Return the weights of one measured response for the study's band, model error, smoothing and factors.

    Default of the model error: 0 if all elements have noise, else `TYPICAL_MODEL_ERROR`.
    Raises DataError if the response has no variance and the model error is 0.
    """
    name, measured, model_error = response.configuration.name, response.uncertainty, spec.weights.model_error
    if model_error is None:
        is_noisy = measured is not None and not np.any((measured.variance == 0) & (response.G != 0))
        model_error = 0.0 if is_noisy else TYPICAL_MODEL_ERROR
    if measured is None and model_error == 0:
        raise DataError(
            "fit/weights",
            "no variance is known (that takes two periods or two realisations) and "
            "fit.weights.model_error is 0; set it, for example to 0.01",
            f"configuration {name}",
        )
    noise = smooth_noise(response)
    variance = np.zeros(response.G.shape) if noise is None else noise.variance
    sigma = np.sqrt(variance + (model_error * np.abs(response.G)) ** 2)
    factor = _factors(response, spec.weights.factors)
    is_used = (factor > 0) & _is_in_band(response.freq_hz, spec.band_hz or (-np.inf, np.inf))[:, None, None]
    texts = list[str]()
    if measured is None:
        texts.append(f"no variance is known; the model error of {model_error:g} determines the weights")
    mute = _is_below_noise(response, variance, is_used)
    if mute.any():
        names = ", ".join(f"{response.outputs[i]} from {response.inputs[j]}" for i, j in np.argwhere(mute))
        texts.append(f"FRF elements without a significant response are not fitted: {names}")
    is_used &= ~mute
    if silent := int((is_used & (sigma == 0)).sum()):
        texts.append(f"{silent} elements are not fitted: their variance and the model error are zero")
    sigma = np.where(is_used & (sigma != 0), sigma, np.inf)
    correlated = None  # C~ if the elements of a line are weighted jointly
    if noise is not None:
        is_full = noise.smooth.form != "diagonal" and spec.criterion == "complex" and spec.weights.covariance == "auto"
        if is_full and (model_error > 0 or not _is_singular(noise.smooth, sigma)):
            correlated = noise.smooth
        noise.measured.release()
    scale = _scale(noise, np.square(model_error * np.abs(response.G)), correlated is not None)
    notes = tuple(Note("fit/weights", text, f"configuration {name}") for text in texts)
    return Weights(sigma, noise, scale, model_error, notes, factor, correlated)


def with_model_error(spec: FitSpec, model_error: float | None) -> FitSpec:
    """Return the spec with a relative model error."""
    return replace(spec, weights=replace(spec.weights, model_error=model_error))


def vec(array: BoolArray | FloatArray | ComplexArray) -> Any:
    """Return (..., n_y, n_u) as (..., n_y n_u), elements of one input side by side."""
    return array.mT.reshape(*array.shape[:-2], -1)


def _factors(response: Response, factors: Sequence[FactorSpec]) -> FloatArray:
    """Return the study's factors (F, n_y, n_u) of the weights; a factor applies to elements that match all its keys."""
    if not factors:
        return _ones(response.G.shape)
    product = np.ones(response.G.shape)
    for factor in factors:
        name = response.configuration.name
        if not factor.configurations or {name, posture_of(name)} & set(factor.configurations):
            lines = _is_in_band(response.freq_hz, factor.band_hz or (-np.inf, np.inf))
            outputs = np.array([factor.output in ("", name) for name in response.outputs])
            inputs = np.array([factor.input in ("", name) for name in response.inputs])
            product[lines[:, None, None] & outputs[:, None] & inputs] *= factor.factor
    return product


@lru_cache(maxsize=8)
def _ones(shape: tuple[int, ...]) -> FloatArray:
    return frozen(np.ones(shape))


def _scale(noise: SmoothedNoise | None, error_variance: FloatArray, is_joint: bool) -> FloatArray:
    r"""Return (1 - \kappa s / \nu)^{-1/2} (F, n_y, n_u), s: noise fraction of the variance of an element's weight.

    error_variance (F, n_y, n_u): by the model error.  is_joint: True if the elements of a line are weighted jointly.
    """
    if noise is None or math.isinf(noise.measured.dof):
        return _ones(error_variance.shape)
    influence = noise.influence.matrix if is_joint else noise.influence.variance
    v = noise.variance
    fraction = quotient(v, v + error_variance)
    # The limit avoids a factor without expectation, for a variance of one degree of freedom without smoothing.
    return 1 / np.sqrt(np.maximum(1 - influence[:, None, None] * fraction / noise.measured.dof, 0.1))


def _is_in_band(freq_hz: FloatArray, band_hz: tuple[float, float]) -> BoolArray:
    return (freq_hz >= band_hz[0]) & (freq_hz <= band_hz[1])


def _is_below_noise(response: Response, variance: FloatArray, is_used: BoolArray) -> BoolArray:
    """Flag elements (n_y, n_u) with less signal than noise on their lines, mean |G|^2 / v < 2, or all zero.

    A weak element with a few lines above its noise is used: each line is weighted by its own variance.
    """
    power = np.abs(response.G) ** 2
    ratio = np.divide(power, variance, out=np.where(power > 0, np.inf, 0.0), where=variance > 0)
    return np.asarray(np.where(is_used, ratio, 0.0).sum(axis=0) < 2 * is_used.sum(axis=0))


def check_factors(responses: Sequence[Response], spec: FitSpec) -> None:
    """Raise StudyError for a factor with a name that was not measured; the message lists the measured names."""
    measured = {
        "configurations": {r.configuration.name for r in responses},
        "output": {name for r in responses for name in r.outputs},
        "input": {name for r in responses for name in r.inputs},
    }
    for i, factor in enumerate(spec.weights.factors):
        for path, noun, name in find_unknown_names(factor, measured):
            advice = did_you_mean(name, sorted(measured[str(path[0])]))
            raise StudyError("study/invalid", f"no {noun} '{name}' was measured; {advice}", f"fit.weights.factors[{i}]")
