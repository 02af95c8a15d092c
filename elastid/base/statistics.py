r"""Quantiles and tests that several rooms share, and how far a function of estimated numbers errs.

SciPy is imported where it is used: stages that need the constants alone do not wait for it.

How far a function of estimated numbers errs: by its slopes where they suffice, which draws check, else by draws.

.. math:: \delta y = \sum_k \xi_k\, s_k, \qquad s_k = \tfrac12 [y(x + l_k) - y(x - l_k)], \qquad
          \sum_k l_k l_k^T = \mathrm{cov}\, x

l_k: one standard deviation of x along each principal axis of its covariance, xi_k standard normal.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray

Values = TypeVar("Values", FloatArray, ComplexArray)
# 95 % of a normal distribution lie within so many standard deviations of its mean.
QUANTILE_95 = 1.959964
# And so many above its mean bound it on one side with 95 %.
ONE_SIDED_95 = 1.644854
# False-alarm rate of each residual test of a fit.
FALSE_ALARM_RATE = 1 / 700
# The standard deviation of a normal distribution over its median absolute deviation.
STD_OVER_MAD = 1.4826


def small_sample_factors(dof: FloatArray | float) -> FloatArray:
    """Return the ratio (n,) of 95 % quantiles, Student's t over normal; dof (n,) or scalar, possibly infinite.

    They widen standard deviations that are themselves estimated.

    >>> small_sample_factors(np.array([3.0, 24.0, np.inf])).round(3).tolist()
    [1.624, 1.053, 1.0]
    """
    from scipy.special import ndtri, stdtrit

    return np.where(np.isinf(dof), 1.0, stdtrit(np.minimum(dof, 1e9), 0.975) / ndtri(0.975))


def chi_square_limit(dof: float, tail: float) -> float:
    """Return the value that a chi-square variable of `dof` degrees of freedom exceeds with probability `tail`.

    >>> round(chi_square_limit(1, 0.05), 3)
    3.841
    """
    from scipy.special import chdtri

    return float(chdtri(dof, tail))


def max_cost_ratio(cost_dof: float) -> float:
    """Return the upper limit of V / E[V] for a correct model at the false-alarm rate.

    2 / cost_dof: relative variance of V / E[V], a chi-square variable over its degrees of freedom.
    """
    dof = max(cost_dof, 1.0)
    return chi_square_limit(dof, FALSE_ALARM_RATE) / dof


def exceeds_noise(cost: float, expected_cost: float, cost_dof: float) -> bool:
    """Return True if V exceeds the limit of noise alone (`max_cost_ratio`)."""
    return cost > expected_cost * max_cost_ratio(cost_dof)


def f_test(drop: float, n_added: int, residual: float, dof: float) -> float:
    """Return p of n_added parameters that lower a sum of squares by `drop` to `residual` with `dof` remaining.

    If the sum of squares increases, the p-value is 1.

    >>> round(f_test(4.0, 1, 10.0, 10), 3)
    0.073
    >>> f_test(-1e-9, 1, 10.0, 10)
    1.0
    """
    from scipy.special import fdtrc

    return float(fdtrc(n_added, dof, max(drop, 0.0) / n_added / max(residual / dof, 1e-300)))


def correlation_of(covariance: FloatArray) -> FloatArray:
    """Return the correlations (n, n) of a covariance (n, n); NaN off the diagonal for an infinite or zero variance."""
    std = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.asarray(covariance / np.outer(std, std))
    np.fill_diagonal(correlation, 1.0)
    return correlation


By: TypeAlias = Literal["linearisation", "samples"]


# Numbers of draws, and the error up to which slopes suffice; they state no fault and so have no false alarms.
CHECK_DRAWS = 16  # draws against which the slopes are held
SLOPE_ERROR = 0.15  # rms error of the slopes at these draws, over the rms of the draws
DRAWS = 400  # from which intervals are taken where slopes do not suffice
NORMAL_NUMBERS = 2000  # of normal numbers, for quantiles where slopes do
UNREACHED_STEP = 1e-4  # of x along a direction of which nothing is known
SLOPE_STEP = 0.5  # of x, at most, over which a slope is taken
MAX_DRAW = 2.0  # of x, at most, by which a draw is off: of a logarithm a factor of 7
LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Spread:
    """y (...) at the estimate, its errors (N, ...) as shifts s_k or as draws, and where it is unknown.

    by: method of the errors.  unknown (...): y depends on unconstrained numbers.
    """

    value: Any
    errors: Any
    by: By
    unknown: BoolArray

    @property
    def std(self) -> FloatArray:
        """E|dy|^2 ^ 1/2 (...), infinite where unknown."""
        power = np.sum(np.abs(self.errors) ** 2, axis=0)
        std = np.sqrt(power if self.by == "linearisation" else power / max(len(self.errors), 1))
        return np.where(self.unknown | np.isnan(std), np.inf, std)

    def radii(self, probability: float = LEVEL) -> tuple[FloatArray, FloatArray]:
        """Return distances (F, n_y, n_u) from y (F, n_y, n_u) that include the true value with a probability.

        First at each line by itself, then at all lines of an element together.
        """
        std = self.std
        pointwise, together = np.array(std), np.array(std)
        normal = np.random.default_rng(0).standard_normal((NORMAL_NUMBERS, len(self.errors)))
        for i, j in np.ndindex(std.shape[1:]):
            errors = self.errors[:, :, i, j]
            size = np.where(np.isfinite(std[:, i, j]) & (std[:, i, j] > 0), std[:, i, j], 1.0)
            ratio = np.abs(normal @ errors if self.by == "linearisation" else errors) / size
            if ratio.size:
                pointwise[:, i, j] *= np.quantile(ratio, probability, axis=0)
                together[:, i, j] *= np.quantile(ratio.max(axis=1), probability)
        finite = np.isfinite(std)
        return np.where(finite, pointwise, np.inf), np.where(finite, together, np.inf)


def propagate(function: Callable[[FloatArray], Any], x: FloatArray, covariance: FloatArray) -> Spread:
    """Propagate the covariance (n_x, n_x) of x (n_x,), with infinite variances, to the spread of function(x) (...)."""
    value = np.asarray(function(x))
    is_infinite = np.isinf(np.diag(covariance))
    axes = principal_axes(covariance)
    # An almost unconstrained number has the slope at the estimate, not the slope across absurd robots.
    steps = zip(axes, [min(1.0, SLOPE_STEP / float(np.abs(axis).max())) for axis in axes], strict=True)
    shifts = [(np.asarray(function(x + h * axis)) - function(x - h * axis)) / (2 * h) for axis, h in steps]
    unknown = np.zeros(value.shape, bool)
    size = np.abs(value).max(initial=1e-300)
    for i in np.flatnonzero(is_infinite):
        change = np.abs(function(x + UNREACHED_STEP * np.eye(len(x))[i]) - value)
        unknown |= change > 1e-7 * UNREACHED_STEP * size
    linear = np.array(shifts).reshape(len(axes), *value.shape)
    rng = np.random.default_rng(0)

    def drawn(count: int) -> tuple[FloatArray, Any]:
        normal = rng.standard_normal((count, len(axes)))
        off = np.clip(normal @ axes, -MAX_DRAW, MAX_DRAW)
        return normal, np.array([np.asarray(function(x + error)) - value for error in off])

    if len(axes):
        normal, actual = drawn(CHECK_DRAWS)
        residual = np.abs(actual - np.tensordot(normal, linear, 1))
        if np.sqrt(np.mean(residual**2)) > SLOPE_ERROR * np.sqrt(np.mean(np.abs(actual) ** 2)):
            return Spread(value, drawn(DRAWS)[1], "samples", unknown)
    return Spread(value, linear, "linearisation", unknown)


@dataclass(frozen=True)
class Combination:
    """Identifiable weighted sum of parameters (members) that are not identifiable individually.

    members: indices of the parameters.  weights: of the members; the first is 1.  std: standard deviation of the value.
    """

    members: tuple[int, ...]
    weights: tuple[float, ...]
    value: float
    std: float


# Std of a combination over that of its first member, from which on it is stated; part of a member in its eigenvector.
MAX_COMBINATION_STD, MIN_MEMBER = 0.25, 0.25


def identifiable_combinations(values: FloatArray, covariance: FloatArray, largest: int = 3) -> tuple[Combination, ...]:
    r"""Return combinations of up to `largest` of n correlated values, one per small eigenvalue of the correlation.

    .. math:: c = x_i - C_{iJ} C_{JJ}^{-1} x_J, \qquad \mathrm{var}\, c = w^T C w

    the conditional mean of the member i whose variance the others J explain, with weights of two digits.

    >>> C = np.array([[1.0, -1.99], [-1.99, 4.0]])
    >>> [(c.weights, round(c.std, 2)) for c in identifiable_combinations(np.array([3.0, 1.0]), C)]
    [((1.0, 0.5), 0.1)]
    """
    std = np.sqrt(np.diag(covariance))
    if not np.all(np.isfinite(std)) or not np.all(std > 0):
        return ()
    eigenvalues, vectors = np.linalg.eigh(covariance / np.outer(std, std))
    combinations: dict[tuple[int, ...], Combination] = {}
    for eigenvalue, vector in zip(eigenvalues.tolist(), np.abs(vectors.T), strict=True):
        order = np.argsort(-vector)[:largest]
        members = sorted(order[vector[order] > MIN_MEMBER * vector.max()].tolist())
        if eigenvalue > MAX_COMBINATION_STD or len(members) < 2:
            continue
        i, other_members = members[0], members[1:]
        w = -np.linalg.solve(covariance[np.ix_(other_members, other_members)], covariance[other_members, i])
        weights = np.array([1.0, *(float(f"{x:.2g}") for x in w)])
        of_value = float(np.sqrt(weights @ covariance[np.ix_(members, members)] @ weights))
        if of_value < MAX_COMBINATION_STD * std[i]:
            value = float(weights @ values[members])
            combination = Combination(tuple(members), tuple(weights.tolist()), value, of_value)
            combinations.setdefault(combination.members, combination)
    return tuple(combinations.values())


def runs(flags: BoolArray, min_length: int = 1) -> IntArray:
    """Return first sample and end (k, 2) of runs of at least so many set flags (n,)."""
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]]))).reshape(-1, 2)
    return bounds[bounds[:, 1] - bounds[:, 0] >= min_length]


def smallest_step(x: FloatArray) -> float:
    """Return the smallest difference of two values of x (n,) above rounding, 1e-7 of its range; 0 without any."""
    steps = np.diff(np.unique(x))
    return float(np.min(steps[steps > 1e-7 * np.ptp(x)])) if len(steps) else 0.0


NEIGHBOURS = 9  # lines over which powers and noise are averaged


def mean_of_neighbours(values: Values, width: int = NEIGHBOURS) -> Values:
    """Return the mean (F, ...) of values over `width` rows, an odd number, about each; fewer of them at the ends."""
    F, half = len(values), width // 2
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    first, end = np.maximum(np.arange(F) - half, 0), np.minimum(np.arange(F) + half + 1, F)
    return np.asarray((total[end] - total[first]) / (end - first).reshape(-1, *(1,) * (values.ndim - 1)))


def interpolate(x: FloatArray | IntArray, lines: FloatArray | IntArray, values: Values) -> Values:
    """Interpolate values (F, ...) at lines (F,) linearly to `x` (K,); extrapolate beyond."""
    right = np.clip(np.searchsorted(lines, x), 1, len(lines) - 1)
    fraction = (x - lines[right - 1]) / np.maximum(lines[right] - lines[right - 1], 1e-300)
    fraction = fraction.reshape(-1, *(1,) * (values.ndim - 1))
    return (1 - fraction) * values[right - 1] + fraction * values[right]


def principal_axes(covariance: FloatArray) -> FloatArray:
    """Return one std along each principal axis, l_k (n, n_x); zero for exact and unidentifiable parameters."""
    is_infinite = np.isinf(np.diag(covariance))
    values, vectors = np.linalg.eigh(np.where(is_infinite[:, None] | is_infinite, 0.0, covariance))
    is_moved = values > 1e-24 * values.max(initial=0.0)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))).T[is_moved & (values > 0)])
