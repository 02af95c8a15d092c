r"""Least squares of friction laws: nonlinear search, covariance and F test; regression jointly with a rigid body.

A nonlinear search with residuals of variance 1 ends at :class:`Optimum`. Regressions of friction parameters jointly
with rigid-body parameters have coloured residuals:

.. math:: y_j(t) = X_j(t)\, \beta + R_j(t)\, \pi + e_j(t)

for the torques of m joints in one log or several. R has all columns that are not friction. It is projected out of X and
y first (Frisch and Waugh, Econometrica 1, 1933), so that its parameters need not be identifiable. Joints are weighted
by the residuals of their torques. The covariance of beta is robust to correlation over time and between joints: it is
computed from the slowest B cosines of the scores of each log (Lazarus, Lewis, Stock and Watson, J. Business & Economic
Statistics 36, 2018), and includes Student's quantile. A parameter has B degrees of freedom if the whole log informs it,
and fewer if a few moments do, such as the ramps of trapezoids for an inertia (Satterthwaite, Biometrics 2, 1946; Bell
and McCaffrey, Survey Methodology 28, 2002).

Model errors repeat with the state, not with time: a repeated motion repeats them. Therefore a second covariance is
computed from the scores in the order of a state (angle, velocity). It applies to each parameter for which it is
significantly larger.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, starmap
from typing import Any

import numpy as np
from scipy.fft import dct
from scipy.interpolate import make_interp_spline
from scipy.optimize import least_squares
from scipy.special import fdtri, stdtr

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.statistics import f_test, small_sample_factors
from elastid.friction_study.motion_signals import PIECE

# Chance that a term is taken into a law that does not have it, or a scatter for larger than chance makes it.
FALSE_ALARM = 0.01
# Highest frequency of the cosines of a covariance, below that of motions, and their least number in all logs.
_HIGHEST_HZ, _TERMS = 0.2, 8
# Cosines over a state, and the chance from which on a larger covariance over a state is none.
_STATE_CHANCE = 0.05
# Least mean of such a variance over the truth: that of columns which change no faster than the cosines is all but zero.
_LEAST_MEAN = 0.1
# Directions of R below this share of its largest are zero.
RANK_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Optimum:
    """Unknowns x (n,) of the least sum of squares `cost` of residuals, which there are r (m,), of Jacobian J (m, n)."""

    x: FloatArray
    cost: float
    J: FloatArray
    r: FloatArray

    @property
    def dof(self) -> int:
        """Residuals more than unknowns."""
        return len(self.J) - len(self.x)

    @property
    def covariance(self) -> FloatArray:
        """Covariance of x (n, n) for residuals of variance 1; larger by their reduced chi-square if this exceeds 1."""
        return inverse_normal(self.J) * max(1.0, self.cost / max(1, self.dof))

    def robust_covariance(self, correlation: FloatArray, min_variance: FloatArray) -> FloatArray:
        r"""Return the robust covariance (n, n) of x for a variance factor c (m,) and a minimum variance v (m,).

        .. math:: A^{-1} J^T \mathrm{diag}\left(\max\left(\frac{c\, r^2}{(1 - h)^2}, v\right)\right) J A^{-1},
                  \quad A = J^T J, \quad h = \mathrm{diag}(J A^{-1} J^T)

        (HC3 of MacKinnon and White, J. Econometrics 29, 1985.)
        """
        J, inverse = self.J, inverse_normal(self.J)
        leverage = np.minimum(np.sum((J @ inverse) * J, axis=1), 1 - 1e-9)
        variance = np.maximum(correlation * (self.r / (1 - leverage)) ** 2, min_variance)
        influence = inverse @ J.T
        return np.asarray((influence * variance) @ influence.T)


def minimise(
    residual: Callable[[FloatArray], FloatArray], starts: Iterable[FloatArray], **settings: Any
) -> tuple[Optimum, ...]:
    """Return the optima from several starts (n_x,), without failed searches; settings: of SciPy's `least_squares`."""
    ends = []
    for start in starts:
        try:
            end = least_squares(residual, start, **settings)
        except (ValueError, np.linalg.LinAlgError):
            continue
        ends.append(Optimum(end.x, 2 * float(end.cost), end.jac, end.fun))
    return tuple(ends)


def inverse_normal(J: FloatArray) -> FloatArray:
    """Return (J^T J)^-1 (n, n) by columns of unit length; infinite variances where the data do not reach."""
    size = np.linalg.norm(J, axis=0)
    size[size < 1e-100] = 1.0  # the square of such a column underflows
    _, s, Vt = np.linalg.svd(J / size, full_matrices=False)
    is_identified = s > 1e-12 * s.max()
    inverse = (Vt[is_identified].T / s[is_identified] ** 2) @ Vt[is_identified]
    is_infinite = np.sum(Vt[~is_identified] ** 2, axis=0) > 1e-6
    inverse[is_infinite, is_infinite] = np.inf
    return np.asarray(inverse / np.outer(size, size))


def terms_p_value(cost_without: float, cost_with: float, n_terms: int, dof: int) -> float:
    """Return the p-value of the F test for n_terms terms: costs without and with them, dof with them."""
    return f_test(cost_without - cost_with, n_terms, max(cost_with, dof), dof)


@dataclass(frozen=True)
class Equations:
    """Equations of one log at n instants: friction X (n, m, n_x), all else R (n, m, n_r), torque y (n, m); not copied.

    Rows that are not used are zero.  states (n, n_s): with which errors of the model may repeat; none of them: (n, 0).
    names: joint and name of each number of friction.
    """

    X: FloatArray
    R: FloatArray
    y: FloatArray
    states: FloatArray
    names: tuple[tuple[str, str], ...] = ()


@frozen_value
class Estimate:
    """Parameters of a joint: names and values (n_x,) with their covariance (n_x, n_x)."""

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.names.index(name)])

    def std(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        return self.combination({name: 1.0})[1]

    def combination(self, weights: Mapping[str, float]) -> tuple[float, float]:
        """Return the weighted sum of parameters, and its standard deviation."""
        indices, a = [self.names.index(name) for name in weights], np.array([*weights.values()])
        return float(a @ self.values[indices]), float(np.sqrt(a @ self.covariance[np.ix_(indices, indices)] @ a))


@dataclass(frozen=True)
class Regression(Estimate):
    """An estimate by regression; relative_error: norm of its residual over the norm of the torque.

    independent: effective number of independent residuals.  dof (n_x,): degrees of freedom of the variances.
    widening: largest factor by which model errors that repeat with a state widen a std.
    """

    relative_error: float
    sum_of_squares: float
    independent: float
    dof: FloatArray
    widening: float

    def widened(self, change: FloatArray) -> "Regression":
        """Return regression with a possible change of its numbers (n_x,) in the covariance."""
        return replace(self, covariance=self.covariance + np.outer(change, change))

    def chance(self, name: str, sign: int) -> float:
        """Return chance of a number as far from zero on the side of the sign, or on either for 0, where it is zero."""
        dof = self.dof[self.names.index(name)]
        t = self[name] / max(self.std(name), 1e-300) * small_sample_factors(dof)  # of the std, which has it, too
        return float(stdtr(dof, -sign * t) if sign else 2 * stdtr(dof, -abs(t)))


@dataclass(frozen=True)
class Solution:
    """beta (n_x,), pi (n_r,) and its std, covariance of beta (n_x, n_x), and of the joints (m,) fields of Regression.

    pi_std: of residuals with as many independent ones as their correlation leaves.  widening (n_x,): by errors of the
    model that repeat with a state, and is in the covariance.  influences (n, n_x): of each log, the parts that its
    instants have in the error of beta.
    """

    names: tuple[tuple[str, str], ...]
    beta: FloatArray
    pi: FloatArray
    pi_std: FloatArray
    covariance: FloatArray
    relative_error: FloatArray
    sum_of_squares: FloatArray
    independent: FloatArray
    dof: FloatArray
    widening: FloatArray
    influences: tuple[FloatArray, ...]

    def at(self, joint: str) -> Regression:
        """Return the numbers of a joint."""
        mask, i = [name[0] == joint for name in self.names], [*dict(self.names)].index(joint)
        error, squares, independent = self.relative_error[i], self.sum_of_squares[i], self.independent[i]
        return Regression(
            tuple(name for of, name in self.names if of == joint), self.beta[mask], self.covariance[np.ix_(mask, mask)],
            float(error), float(squares), float(independent), self.dof[mask], float(self.widening[mask].max())
        )  # fmt: skip


def solve(logs: Sequence[Equations], rate_hz: float) -> Solution:
    """Return parameters common to all logs; rate_hz of the samples."""
    stacks = [[getattr(log, name) for log in logs] for name in ("X", "R", "y", "states")]
    X, R, y, states = (parts[0] if len(parts) == 1 else np.concatenate(parts) for parts in stacks)
    (n, m), n_x = y.shape, X.shape[2]
    weight, n_used = np.ones(m), np.any(X, axis=2).sum(axis=0)
    for _ in range(5 if m > 1 else 1):  # weights, then the solution
        flat_X, flat_R = ((weight[:, None] * columns).reshape(n * m, -1) for columns in (X, R))
        flat_y = (weight * y).ravel()
        basis, inverse_R = _basis(flat_R)
        free_X, free_y = (columns - basis @ (basis.T @ columns) for columns in (flat_X, flat_y))
        size = np.linalg.norm(free_X, axis=0)
        size[size == 0] = 1.0
        beta = np.linalg.lstsq(free_X / size, free_y, rcond=None)[0] / size
        e = (free_y - free_X @ beta).reshape(n, m)
        weight = weight / np.maximum(np.sqrt(np.sum(e**2, axis=0) / n_used), 1e-300)
    scores = np.einsum("nmx,nm->nx", (free_X / size).reshape(n, m, n_x), e)
    ends = np.cumsum([len(log.y) for log in logs])[:-1]
    parts = np.split(scores, ends)
    terms = [cosine_count(len(block) / rate_hz, len(parts)) for block in parts]
    bread = np.linalg.pinv((free_X / size).T @ (free_X / size))
    meat = sum(starmap(long_run, zip(parts, terms, strict=True)))
    error_influence = (free_X / size @ bread).reshape(n, m, n_x)
    bases = [np.split(columns.reshape(n, m, -1), ends) for columns in (basis, _basis(free_X)[0])]
    shrinkage, dof = _variance_moments(np.split(error_influence, ends), [*zip(*bases, strict=True)], terms)
    covariance = bread @ meat @ bread / np.sqrt(np.outer(shrinkage, shrinkage))
    student = small_sample_factors(dof)
    widening = state_widening(bread, scores, states, np.diag(covariance) * student**2, dof)
    # Of hardly any degree of freedom it is without bound, and its square would overflow.
    wider = np.minimum(widening * student / size, 1e100)
    covariance *= np.outer(wider, wider)
    correlation = np.clip(np.sum(e[1:] * e[:-1], axis=0) / np.maximum(np.sum(e**2, axis=0), 1e-300), 0, 0.999)
    independent = n_used * (1 - correlation) / (1 + correlation)
    pi = inverse_R @ (basis.T @ (flat_y - flat_X @ beta))
    normal = inverse_normal(_triangle(flat_X, flat_R))[n_x:, n_x:]
    # The numbers take degrees of freedom from the independent residuals.
    pi_std = np.sqrt(np.diag(normal) * n * m / max(1.0, float(independent.sum()) - n_x - basis.shape[1]))
    squares = np.sum((y - X @ beta - R @ pi) ** 2, axis=0)
    relative = np.sqrt(squares / np.maximum(np.sum(y**2, axis=0), 1e-300))
    return Solution(
        logs[0].names, beta, pi, pi_std, covariance, relative, squares, independent, dof, widening,
        tuple(block @ bread / size for block in parts)
    )  # fmt: skip


def with_delays(log: Equations, all_instants: Equations, solution: Solution, rate_hz: float) -> Equations:
    """Add a column for the torque delay of each joint, s, to the equations of a log; all_instants: without omissions.

    The column of a delay is the time derivative of the torque that the solution explains.
    """
    instants, torque = np.arange(len(all_instants.y)), all_instants.X @ solution.beta + all_instants.R @ solution.pi
    rates = make_interp_spline(instants, torque, 5).derivative()(instants) * rate_hz * np.any(log.X, axis=2)
    delays = rates[:, :, None] * np.eye(rates.shape[1])
    names = tuple((joint, "delay") for joint in dict(log.names))
    return replace(log, X=np.concatenate([log.X, delays], axis=2), names=(*log.names, *names))


def shift_between(first: Solution, second: Solution, rate_hz: float) -> dict[tuple[str, str], tuple[float, float]]:
    """Return the difference of the second from the first estimate, and its std, by joint and name.

    Both estimates are from the same instants of the same logs, so that their residuals are correlated.
    """
    pairs = list(zip(first.influences, second.influences, strict=True))
    terms = [cosine_count(len(low) / rate_hz, len(pairs)) for low, _ in pairs]
    differences = [high - low for low, high in pairs]
    variance = sum(np.diag(long_run(block, count)) for block, count in zip(differences, terms, strict=True))
    std = np.maximum(np.sqrt(variance) * small_sample_factors(sum(terms)), 1e-300)
    return dict(zip(first.names, zip((second.beta - first.beta).tolist(), std.tolist(), strict=True), strict=True))


def _variance_moments(
    error_influence: Sequence[FloatArray], bases: Sequence[Sequence[FloatArray]], terms: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    r"""Return E V over the true variance (n_x,), and dof 2 (E V)^2 / var V, of variances V by cosines for white errors.

    error_influence (n, m, n_x): influence of each log's errors on the errors of the parameters.  bases: blocks of
    orthonormal columns (n, m, r) of all numbers, which the residuals lack, so that these are smaller than the errors,
    most if the columns change as slowly as the cosines (Bell and McCaffrey, 2002).  For a log's cosines C of
    B terms,

    .. math:: V = \frac{2}{B} \mathrm{tr}\, C D (I - Q Q^T) D C^T, \quad D = \mathrm{diag}(w), \quad Q Q^T: explained
    """
    n_x = error_influence[0].shape[2]
    true_variance, mean, variance = np.zeros(n_x), np.zeros(n_x), np.zeros(n_x)
    for e, columns, count in zip(error_influence, bases, terms, strict=True):
        squares = np.sum(e**2, axis=1)
        # cos a cos b = (cos(a - b) + cos(a + b)) / 2
        cosines = np.concatenate([squares.sum(axis=0)[None], dct(squares, axis=0)[1 : 2 * count + 1] / 2])
        j, k = np.indices((count, count)) + 1
        starts = np.linspace(0, len(e), min(len(e), 16 * count), endpoint=False).astype(int)  # sixteen a half wave
        ranges = [*pairwise([*starts.tolist(), len(e)])]
        sums = np.concatenate(
            [[np.tensordot(e[i:j], basis[i:j], ((0, 1), (0, 1))) for i, j in ranges] for basis in columns], axis=2
        )
        projections = dct(sums, axis=0)[1 : count + 1] / 2
        M = (cosines[np.abs(j - k)] + cosines[j + k]) / 2 - np.einsum("jxr,kxr->jkx", projections, projections)
        true_variance += squares.sum(axis=0)
        mean += 2 / count * np.einsum("jjx->x", M)
        variance += (2 / count) ** 2 * np.einsum("jkx,jkx->x", M, M)
    return np.maximum(mean / np.maximum(true_variance, 1e-300), _LEAST_MEAN), mean**2 / np.maximum(variance, 1e-300)


def state_widening(
    bread: FloatArray, scores: FloatArray, states: FloatArray, variance: FloatArray, dof: FloatArray
) -> FloatArray:
    """Return factors (n_x,) of the std by the covariances over states (n, n_s), 1 where chance explains them."""
    is_used, widening, student = np.any(scores, axis=1), np.ones(len(bread)), small_sample_factors(_TERMS)
    limit = fdtri(_TERMS, dof, 1 - _STATE_CHANCE) * (student / small_sample_factors(dof)) ** 2
    for state in states.T if is_used.any() else ():
        by_states = np.diag(bread @ long_run(scores[is_used][np.argsort(state[is_used])], _TERMS) @ bread) * student**2
        ratio = by_states / np.maximum(variance, 1e-300)
        widening = np.maximum(widening, np.sqrt(np.where(ratio > limit, ratio, 1.0)))
    return widening


def cosine_count(duration_s: float, logs: int) -> int:
    """Return cosines of a log of that duration, one of so many: few enough that the residuals are white over them."""
    return max(round(duration_s * _HIGHEST_HZ * 2), -(-_TERMS // logs))


def long_run(scores: FloatArray, terms: int) -> FloatArray:
    """Return the covariance (n_x, n_x) of the sum of scores (n, n_x) over time."""
    cosines = dct(scores, axis=0)[1 : terms + 1] / 2
    return np.asarray(2 / terms * cosines.T @ cosines)


def _triangle(*blocks: FloatArray) -> FloatArray:
    """Return upper triangle (k, k) of the QR decomposition of blocks (n, .) next to each other, k columns in all."""
    triangle = np.zeros((0, sum(block.shape[1] for block in blocks)))
    for i in range(0, len(blocks[0]), PIECE):
        rows = np.hstack([block[i : i + PIECE] for block in blocks])
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, rows]), mode="r"))
    return triangle


def _basis(R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return an orthonormal basis (n, rank) of the columns of R (n, n_r), and the inverse (n_r, rank): its numbers."""
    size = np.linalg.norm(R, axis=0)
    if not size.any():
        return np.zeros((len(R), 0)), np.zeros((R.shape[1], 0))
    size = np.where(size > 0, size, np.inf)
    _, s, Vt = np.linalg.svd(_triangle(R) / size, full_matrices=False)
    is_significant = s > RANK_TOLERANCE * s[0]
    inverse = (Vt[is_significant] / s[is_significant, None] / size).T
    return R @ inverse, inverse
