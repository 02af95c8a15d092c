"""Levels of friction by regression."""

import numpy as np
import pytest

from elastid.nonlinear.levels import find_levels, solve
from elastid.nonlinear.spectra import ConfigurationSpectra


def test_shapes_that_are_alike_share_a_level() -> None:
    """Any division between them is a least one; without a pull there is none."""
    x, y = np.ones(5), np.arange(5.0)
    X = np.stack([x, x, -x], axis=1)
    np.testing.assert_allclose(solve(X.T @ X, X.T @ y)[:2].sum(), 2.0, rtol=1e-6)
    assert not solve(np.eye(2), np.array([-1.0, -2.0])).any()
    assert not solve(np.eye(2), np.zeros(2)).any()


@pytest.mark.parametrize("noise", [0.0, 0.3, 0.5])
def test_noise_of_shapes_does_not_lower_their_level(noise: float) -> None:
    """Of a level of 5 a regression finds 5 / (1 + noise^2) where the shape's noise is not known, 5 where it is."""
    rng = np.random.default_rng(3)

    def white(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)

    lines, K = np.arange(1, 301), 8
    Phi, r = white(300, 1, K), 20 * white(300, 1, K)
    of_halves = noise * np.stack([white(300, 1, K), white(300, 1, K)])
    X, of_mean = Phi + of_halves.sum(axis=0) / np.sqrt(2), (of_halves[0] - of_halves[1]) / np.sqrt(2)
    U = r + 5 * Phi + 0.1 * white(300, 1, K)
    quiet = 0 * U, 0 * U
    levels = []
    for of_shapes in (0 * of_mean, of_mean):
        data = ConfigurationSpectra(
            lines, lines / 1.0, np.ones(300, bool), U, r / 9, X, *quiet, of_shapes, np.arange(K), np.zeros(1)
        )
        levels.append(find_levels([data], np.array([0]))[0][0])
    assert levels[0] == pytest.approx(5 / (1 + noise**2), rel=0.04)
    assert levels[1] == pytest.approx(5, rel=0.04)
