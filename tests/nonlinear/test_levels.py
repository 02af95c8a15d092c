"""Levels of friction by regression."""

import numpy as np
import pytest
from scipy.optimize import nnls

from elastid.nonlinear.levels import solve


@pytest.mark.parametrize("seed", range(40))
def test_no_level_is_negative_and_the_sum_of_squares_is_the_least(seed: int) -> None:
    """SciPy's non-negative least squares, of columns of very different size."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 12))
    X, y = rng.standard_normal((n + 6, n)) * np.exp(rng.normal(0, 2, n)), rng.standard_normal(n + 6)
    expected, _ = nnls(X, y)
    found = solve(X.T @ X, X.T @ y)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7 * np.abs(expected).max(initial=1e-9))


def test_shapes_that_are_alike_share_a_level() -> None:
    """Any division between them is a least one; without a pull there is none."""
    x, y = np.ones(5), np.arange(5.0)
    X = np.stack([x, x, -x], axis=1)
    np.testing.assert_allclose(solve(X.T @ X, X.T @ y)[:2].sum(), 2.0, rtol=1e-6)
    assert not solve(np.eye(2), np.array([-1.0, -2.0])).any()
    assert not solve(np.eye(2), np.zeros(2)).any()
