"""Quantiles and tests as SciPy's distributions and the definitions have them."""

import re

import numpy as np
import pytest
from hypothesis import given, strategies

from elastid.base.arrays import interpolate, mean_of_neighbours, smallest_step, true_runs
from elastid.base.propagation import principal_axes, propagate
from elastid.base.statistics import correlation_of, f_test, identifiable_combinations


def test_f_test_rejects_null_column_at_stated_rate() -> None:
    """Of 4000 regressions on noise 5 % have a p-value below 0.05."""
    rng = np.random.default_rng(0)
    J, y = rng.standard_normal((30, 3)), 5 * rng.standard_normal((30, 4000))
    left = [np.sum((y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) ** 2, axis=0) for A in (J[:, :2], J)]
    p = np.array([f_test(before - after, 1, after, 27) for before, after in zip(*left, strict=True)])
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.012)


def test_propagation_uses_slopes_or_draws_by_nonlinearity() -> None:
    """exp(x) with std 0.01 against std 1, whose own std is known: e^(1/2) (e - 1)^(1/2)."""
    x = np.zeros(1)
    narrow = propagate(np.exp, x, np.array([[1e-4]]))
    assert narrow.by == "linearisation"
    np.testing.assert_allclose(narrow.std, 0.01, rtol=1e-3)
    wide = propagate(np.exp, x, np.array([[1.0]]))
    assert wide.by == "samples"
    assert 1.3 < wide.std[0] < 4.0
    assert propagate(lambda x: 1e4 * np.exp(x), x, np.array([[1.0]])).by == "samples"


def test_what_depends_on_a_number_that_nothing_constrains_is_unknown() -> None:
    spread = propagate(lambda x: np.array([x[0], x[1]]), np.ones(2), np.diag([0.04, np.inf]))
    np.testing.assert_allclose(spread.std, [0.2, np.inf])


def test_bands_hold_so_often_as_they_say() -> None:
    """Pointwise at each line, simultaneous at all of them, of errors that draws of x make."""
    rng, lines = np.random.default_rng(1), np.linspace(0, 1, 30)
    waves = np.array([np.exp(2j * np.pi * k * lines) for k in range(1, 6)])

    def response(x: np.ndarray) -> np.ndarray:
        return (x @ waves)[:, None, None]

    pointwise, together = propagate(response, np.zeros(5), np.eye(5)).radii()
    errors = np.abs(np.array([response(x) for x in rng.standard_normal((2000, 5))]))
    assert 0.93 < np.mean(errors <= pointwise) < 0.97
    assert 0.93 < np.mean(np.all(errors <= together, axis=(1, 2, 3))) < 0.97


def test_correlated_parameters_have_an_identifiable_combination() -> None:
    """x_0 + x_2 / 2 has variance 0.01, its members 1 and 4; x_1 and uncorrelated parameters have no combination."""
    C = np.array([[1.0, 0.02, -1.99], [0.02, 0.25, 0.0], [-1.99, 0.0, 4.0]])
    np.testing.assert_allclose(correlation_of(C), [[1, 0.04, -0.995], [0.04, 1, 0], [-0.995, 0, 1]])
    (combination,) = identifiable_combinations(np.array([3.0, 7.0, 1.0]), C)
    assert (combination.members, combination.weights, combination.value) == ((0, 2), (1.0, 0.5), 3.5)
    assert combination.std == pytest.approx(0.1)
    for covariance in (np.eye(3), np.diag([1.0, 0.0, 1.0]), np.diag([1.0, np.inf, 1.0])):
        assert identifiable_combinations(np.ones(3), covariance) == ()
    axes = principal_axes(C)
    np.testing.assert_allclose(axes.T @ axes, C, atol=1e-12)
    assert principal_axes(np.diag([4.0, np.inf, 0.0])).tolist() == [[2, 0, 0]]


def test_smallest_step_is_above_rounding() -> None:
    assert smallest_step(np.array([3.0, 1.0, 1.0 + 1e-12, 2.5, 3.0])) == 0.5
    assert smallest_step(np.ones(3)) == 0


@given(strategies.integers(0, 2**32 - 1), strategies.integers(2, 20), strategies.integers(0, 4))
def test_runs_means_and_interpolation_equal_definitions(seed: int, n: int, half: int) -> None:
    rng = np.random.default_rng(seed)
    flags, x = rng.random(n) < 0.6, rng.standard_normal((n, 3)) + 1j * rng.standard_normal((n, 3))
    spans = [match.span() for match in re.finditer("x+", "".join(" x"[flag] for flag in flags.astype(int)))]
    assert true_runs(flags, half).tolist() == [[first, end] for first, end in spans if end - first >= half]
    means = [x[max(0, i - half) : i + half + 1].mean(axis=0) for i in range(n)]
    np.testing.assert_allclose(mean_of_neighbours(x, 2 * half + 1), means, atol=1e-12)
    lines = np.cumsum(0.1 + rng.random(n))
    wanted = rng.uniform(lines[0], lines[-1], 5)
    between = [np.interp(wanted, lines, part) for part in x.T]
    np.testing.assert_allclose(interpolate(wanted, lines, x), np.transpose(between), atol=1e-12)
