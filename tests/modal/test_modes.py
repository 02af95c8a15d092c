"""Closed forms of MAC, phase collinearity, and mode indicators."""

import numpy as np

from elastid.modal.modes import mac


def test_mac_ignores_factors_and_sees_angles() -> None:
    """The MAC of real shapes at an angle of 30 degrees is its cosine squared."""
    first = np.array([[1.0], [0.0]])
    second = np.array([[np.sqrt(3) / 2], [0.5]]) * (2 - 3j)
    np.testing.assert_allclose(mac(first, second), 0.75)
