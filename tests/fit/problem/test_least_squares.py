"""Residuals between two responses, and the distance from the end of a solve to the stationary point."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.fit.problem.least_squares import (
    Evaluation,
    ResidualKind,
    difference,
    distance_to_optimum,
    error_gain,
)

G = np.array([1.0 + 2.0j, -3.0 + 0.5j])


@pytest.mark.parametrize("kind", ["complex", "log"])
def test_the_slope_of_a_residual_is_its_difference_quotient(kind: ResidualKind) -> None:
    """s = -de/dG, and the gain of a small error of the measured response is the same."""
    measured, step = 1.3 * G, 1e-7
    e, moved = (difference(kind, measured, model) for model in (G, G + step))
    np.testing.assert_allclose((e - moved) / step, error_gain(kind, G), rtol=1e-6)
    np.testing.assert_allclose(difference(kind, G + step, G) / step, error_gain(kind, G), rtol=1e-6)


def test_the_logarithmic_residual_has_a_wrapped_phase() -> None:
    e = difference("log", np.array([np.exp(3.0j)]), np.array([np.exp(-3.0j)]))
    np.testing.assert_allclose(e, [1j * (6.0 - 2 * np.pi)], atol=1e-12)


def test_the_distance_to_the_optimum_of_a_parabola_is_in_standard_deviations() -> None:
    """V = 4 (x - 3)^2 + dof at x = 5: the standard deviation is 1 / 2, twice that where V is four times its dof."""
    dof, offset = 10, 2.0
    for cost, expected in ((10.0, 4.0), (40.0, 2.0)):
        ending = Evaluation(cost, np.array([8.0 * offset]), np.array([[8.0]]))
        assert distance_to_optimum(ending, dof, np.array([False])) == pytest.approx(expected)
        assert distance_to_optimum(ending, dof, np.array([True])) == 0.0
    assert distance_to_optimum(Evaluation(np.inf, np.zeros(1), np.eye(1)), dof, np.array([False])) == np.inf
