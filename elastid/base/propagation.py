r"""Propagation of a covariance through a function: linearised if samples confirm the slopes, else by samples.

.. math:: \delta y = \sum_k \xi_k\, s_k, \qquad s_k = \tfrac12 [y(x + l_k) - y(x - l_k)], \qquad
          \sum_k l_k l_k^T = \mathrm{cov}\, x

l_k: one standard deviation of x along each principal axis of its covariance, xi_k standard normal.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray

ErrorMethod: TypeAlias = Literal["linearisation", "samples"]

# Linearisation and samples differ in accuracy only: these numbers cause no false alarms.
CHECK_SAMPLES = 16  # samples that check the linearisation
MAX_SLOPE_ERROR = 0.15  # rms error of the linearisation at these samples, over their rms
SAMPLES = 400  # samples for intervals if the linearisation fails the check
NORMAL_NUMBERS = 2000  # normal numbers for quantiles of the linearisation
UNREACHED_STEP = 1e-4  # step of x along a direction of infinite variance
SLOPE_STEP = 0.5  # largest step of x over which a slope is computed
MAX_DEVIATION = 2.0  # largest deviation of a sample of x, a factor of 7 for the logarithm of a number
PROBABILITY = 0.95  # of an interval


@dataclass(frozen=True, eq=False)
class Spread:
    """y (...) at the estimate with its errors (N, ...): shifts s_k (linearisation) or samples.

    unknown (...): True if y depends on a number of infinite variance.
    """

    value: Any
    errors: Any
    by: ErrorMethod
    unknown: BoolArray

    @property
    def std(self) -> FloatArray:
        """Standard deviation (E|dy|^2)^(1/2) (...), infinite where y is unknown."""
        power = np.sum(np.abs(self.errors) ** 2, axis=0)
        std = np.sqrt(power if self.by == "linearisation" else power / max(len(self.errors), 1))
        return np.where(self.unknown | np.isnan(std), np.inf, std)

    def radii(self, probability: float = PROBABILITY) -> tuple[FloatArray, FloatArray]:
        """Return radii (F, n_y, n_u) about y (F, n_y, n_u) that include the true value with a probability.

        The first radii hold at each line alone, the second ones at all lines of an element simultaneously.
        """
        std = self.std
        pointwise, simultaneous = np.array(std), np.array(std)
        normal = np.random.default_rng(0).standard_normal((NORMAL_NUMBERS, len(self.errors)))
        for i, j in np.ndindex(std.shape[1:]):
            errors = self.errors[:, :, i, j]
            size = np.where(np.isfinite(std[:, i, j]) & (std[:, i, j] > 0), std[:, i, j], 1.0)
            ratio = np.abs(normal @ errors if self.by == "linearisation" else errors) / size
            if ratio.size:
                pointwise[:, i, j] *= np.quantile(ratio, probability, axis=0)
                simultaneous[:, i, j] *= np.quantile(ratio.max(axis=1), probability)
        finite = np.isfinite(std)
        return np.where(finite, pointwise, np.inf), np.where(finite, simultaneous, np.inf)


def propagate(function: Callable[[FloatArray], Any], x: FloatArray, covariance: FloatArray) -> Spread:
    """Propagate the covariance (n_x, n_x) of x (n_x,), which may have infinite variances, to function(x) (...)."""
    value = np.asarray(function(x))
    axes = principal_axes(covariance)
    # The slope along an almost unconstrained direction is the slope at the estimate, not between distant robots.
    steps = zip(axes, [min(1.0, SLOPE_STEP / float(np.abs(axis).max())) for axis in axes], strict=True)
    shifts = [(np.asarray(function(x + h * axis)) - function(x - h * axis)) / (2 * h) for axis, h in steps]
    unknown = np.zeros(value.shape, bool)
    for i in np.flatnonzero(np.isinf(np.diag(covariance))):
        change = np.abs(function(x + UNREACHED_STEP * np.eye(len(x))[i]) - value)
        unknown |= change > 1e-7 * UNREACHED_STEP * np.abs(value).max(initial=1e-300)
    linear = np.array(shifts).reshape(len(axes), *value.shape)
    rng = np.random.default_rng(0)

    def sample_errors(count: int) -> tuple[FloatArray, Any]:
        """Return normal numbers (count, n) along the principal axes, and the errors (count, ...) that they cause."""
        normal = rng.standard_normal((count, len(axes)))
        deviations = np.clip(normal @ axes, -MAX_DEVIATION, MAX_DEVIATION)
        return normal, np.array([np.asarray(function(x + deviation)) - value for deviation in deviations])

    if len(axes):
        normal, errors = sample_errors(CHECK_SAMPLES)
        residual = np.abs(errors - np.tensordot(normal, linear, 1))
        if np.sqrt(np.mean(residual**2)) > MAX_SLOPE_ERROR * np.sqrt(np.mean(np.abs(errors) ** 2)):
            return Spread(value, sample_errors(SAMPLES)[1], "samples", unknown)
    return Spread(value, linear, "linearisation", unknown)


def principal_axes(covariance: FloatArray) -> FloatArray:
    """Return one standard deviation along each principal axis, l_k (n, n_x); zero for exact and unknown numbers."""
    is_infinite = np.isinf(np.diag(covariance))
    variances, vectors = np.linalg.eigh(np.where(is_infinite[:, None] | is_infinite, 0.0, covariance))
    is_positive = (variances > 1e-24 * variances.max(initial=0.0)) & (variances > 0)
    return np.asarray((vectors * np.sqrt(np.maximum(variances, 0.0))).T[is_positive])
