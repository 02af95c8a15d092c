"""Regressions of friction jointly with a rigid body, and searches of laws."""

import numpy as np
import pytest
from scipy.stats import norm, t

from elastid.friction_study.least_squares import (
    Equations,
    Optimum,
    Regression,
    inverse_normal,
    minimise,
    solve,
    terms_p_value,
)

RATE_HZ = 50.0


def log(rng: np.random.Generator, seconds: float, correlation: float) -> Equations:
    """One joint: two columns of friction, gravity beside them, and noise of a first-order filter with that pole."""
    n = round(seconds * RATE_HZ)
    t = np.arange(n) / RATE_HZ
    v = np.sin(2 * np.pi * 0.37 * t + rng.uniform(0, 6)) + 0.4 * np.sin(2 * np.pi * 1.1 * t + rng.uniform(0, 6))
    noise = np.zeros(n)
    for i, white in enumerate(rng.standard_normal(n)):
        noise[i] = correlation * noise[i - 1] + white
    X = np.stack([v, np.sign(v)], axis=1)
    R = np.cos(2 * np.pi * 0.1 * t)[:, None]
    y = X @ [3.0, 2.0] + 5 * R[:, 0] + 0.2 * noise
    return Equations(X[:, None, :], R[:, None, :], y[:, None], np.zeros((n, 0)))


def bursts(rng: np.random.Generator) -> Equations:
    """A column that is zero but for six moments of a minute, as accelerations of few moves, and white noise."""
    t = np.arange(round(60 * RATE_HZ)) / RATE_HZ
    column = np.where(t % 10 < 0.3, np.sin(2 * np.pi * (t % 10) / 0.3), 0.0)
    y = 3.0 * column + 0.2 * rng.standard_normal(len(t))
    return Equations(column[:, None, None], np.zeros((len(t), 1, 0)), y[:, None], np.zeros((len(t), 0)))


@pytest.mark.slow
def test_number_learnt_in_few_moments_has_few_dof() -> None:
    """Six moments against a minute of 24 cosines; 95 % of the intervals of 1000 draws hold the truth."""
    rng = np.random.default_rng(1)
    fits = [solve([bursts(rng)], RATE_HZ) for _ in range(1000)]
    assert 4.0 < fits[0].dof[0] < 7.0
    assert np.all(solve([log(rng, 60.0, 0.0)], RATE_HZ).dof > 18)
    error = np.array([(fit.beta[0] - 3.0) / np.sqrt(fit.covariance[0, 0]) for fit in fits])
    assert 0.93 < np.mean(np.abs(error) < 1.96) < 0.97


@pytest.mark.slow
@pytest.mark.parametrize(("logs", "seconds"), [(1, 60.0), (4, 12.0)])
@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_intervals_hold_the_truth_whatever_the_correlation(logs: int, seconds: float, correlation: float) -> None:
    """95 % of them, of 300 draws of two numbers, by one log or several; the std by the spread to a fifth."""
    rng = np.random.default_rng(0)
    fits = [solve([log(rng, seconds, correlation) for _ in range(logs)], RATE_HZ) for _ in range(300)]
    error = np.array([fit.beta for fit in fits]) - [3.0, 2.0]
    std = np.array([np.sqrt(np.diag(fit.covariance)) for fit in fits])
    covered = np.abs(error) < 1.96 * std
    assert 0.925 < covered.mean() < 0.98
    assert np.abs(error.mean(axis=0)).max() < 4 * np.max(error.std(axis=0)) / np.sqrt(len(fits))
    np.testing.assert_allclose(np.sqrt(np.mean(std**2, axis=0)), error.std(axis=0), rtol=0.25)


def test_search_reaches_optimum_of_each_start() -> None:
    """Rosenbrock's valley; a start at which the residual is not finite is passed over."""

    def residual(x: np.ndarray) -> np.ndarray:
        return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    ends = minimise(residual, [np.array([-1.2, 1.0]), np.array([np.nan, 0.0])])
    assert len(ends) == 1
    np.testing.assert_allclose(ends[0].x, [1, 1], rtol=1e-6)


def test_chance_of_terms_is_uniform_where_they_are_not_there() -> None:
    """One term more in a fit of 40 residuals of white noise, 400 times: below 5 % in 5 % +- 3 %."""
    rng = np.random.default_rng(0)
    chances = []
    for _ in range(400):
        X, y = rng.standard_normal((40, 3)), rng.standard_normal(40)
        costs = [float(np.sum((y - X[:, :k] @ np.linalg.lstsq(X[:, :k], y, rcond=None)[0]) ** 2)) for k in (2, 3)]
        chances.append(terms_p_value(*costs, 1, 37))
    assert 0.02 < np.mean(np.array(chances) < 0.05) < 0.08


def test_robust_covariance_needs_no_variances() -> None:
    """Weights wrong by factors up to three: the std of a slope is its spread over 300 draws to 5 %."""
    rng = np.random.default_rng(5)
    x, factor = np.linspace(-1.0, 1.0, 200), np.exp(np.linspace(-1.0, 1.0, 200))
    ends = []
    for _ in range(300):
        y = factor * rng.standard_normal(200)
        ends += minimise(lambda slope, y=y: (y - slope * x) / factor**2, [np.zeros(1)], method="lm")
    spread = np.std([end.x[0] for end in ends])
    none, correlated = np.zeros(200), np.ones(200)
    stds = [np.sqrt(end.robust_covariance(correlated, none)[0, 0]) for end in ends]
    assert np.sqrt(np.mean(np.square(stds))) == pytest.approx(spread, rel=0.05)
    assert np.sqrt(ends[0].covariance[0, 0]) != pytest.approx(spread, rel=0.2)


@pytest.mark.parametrize("size", [0.1, 5.0])
def test_covariances_of_an_optimum_are_the_formulas(size: float) -> None:
    """(J^T J)^-1 times the residual variance, at least 1, and HC3; infinite for a parameter without effect."""
    rng = np.random.default_rng(0)
    J, r = rng.standard_normal((12, 3)) * [1, 1e3, 1e-3], size * rng.standard_normal(12)
    optimum, A = Optimum(np.zeros(3), float(r @ r), J, r), np.linalg.inv(J.T @ J)
    np.testing.assert_allclose(optimum.covariance, A * max(1.0, r @ r / 9))
    variance = np.maximum(2 * (r / (1 - np.diag(J @ A @ J.T))) ** 2, 0.3)
    expected = A @ J.T @ np.diag(variance) @ J @ A
    np.testing.assert_allclose(optimum.robust_covariance(np.full(12, 2.0), np.full(12, 0.3)), expected)
    idle = inverse_normal(J * [1, 0, 1])
    np.testing.assert_allclose(idle[np.ix_([0, 2], [0, 2])], np.linalg.inv(J[:, [0, 2]].T @ J[:, [0, 2]]))
    assert idle[1, 1] == np.inf


@pytest.mark.parametrize("dof", [4.0, np.inf])
def test_sums_and_chances_of_a_regression_follow_student(dof: float) -> None:
    """The std includes the factor of Student's quantile, which `chance` removes."""
    C = np.array([[0.04, 0.01], [0.01, 0.09]])
    own = Regression(("a", "b"), np.array([0.5, -0.2]), C, 0.1, 1.0, 20.0, np.array([9.0, dof]), 1.0)
    value, std = own.combination({"b": 2.0, "a": -1.0})
    assert (value, std) == pytest.approx((-0.9, np.sqrt(0.04 + 4 * 0.09 - 4 * 0.01)))
    ratio = -0.2 / 0.3 * (1.0 if np.isinf(dof) else t.ppf(0.975, dof) / norm.ppf(0.975))
    assert own.chance("b", 0) == pytest.approx(2 * t.sf(abs(ratio), dof))
    assert own.chance("b", 1) == pytest.approx(t.sf(ratio, dof))
    assert own.chance("b", -1) == pytest.approx(t.cdf(ratio, dof))
    np.testing.assert_allclose(own.widened(np.array([0.1, 0.2])).covariance, C + np.outer([0.1, 0.2], [0.1, 0.2]))
