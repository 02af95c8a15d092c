"""Closed forms of MAC, phase collinearity, and mode indicators."""

import numpy as np
import pytest

from elastid.modal.modes import mac, phase_collinearity


def test_mac_ignores_factors_and_sees_angles() -> None:
    """The MAC of real shapes at an angle of 30 degrees is its cosine squared."""
    first = np.array([[1.0], [0.0]])
    second = np.array([[np.sqrt(3) / 2], [0.5]]) * (2 - 3j)
    np.testing.assert_allclose(mac(first, second), 0.75)
    with pytest.raises(ValueError, match="same outputs"):
        mac(first, np.ones((3, 1)))


def test_a_real_shape_is_collinear_whatever_its_phase() -> None:
    shape = np.array([[1.0, 1.0], [-2.0, 2j], [0.5, -1.0]])
    np.testing.assert_allclose(phase_collinearity(shape * np.exp(0.7j))[0], 1)
    assert phase_collinearity(shape)[1] < 0.5
