"""Levels of friction by regression."""

import numpy as np

from elastid.nonlinear.levels import solve


def test_shapes_that_are_alike_share_a_level() -> None:
    """Any division between them is a least one; without a pull there is none."""
    x, y = np.ones(5), np.arange(5.0)
    X = np.stack([x, x, -x], axis=1)
    np.testing.assert_allclose(solve(X.T @ X, X.T @ y)[:2].sum(), 2.0, rtol=1e-6)
    assert not solve(np.eye(2), np.array([-1.0, -2.0])).any()
    assert not solve(np.eye(2), np.zeros(2)).any()
