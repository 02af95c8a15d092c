"""Errors of a twin's signals over time."""

import math

import numpy as np
import pytest

from elastid.validation.twin import MOTION, twin_signal


def waves(*amplitudes: float) -> np.ndarray:
    """At 3, 6 and 20 Hz."""
    t = np.arange(2000) / 200.0
    return np.sum([a * np.sin(2 * np.pi * f * t) for a, f in zip(amplitudes, (3.0, 6.0, 20.0), strict=True)], axis=0)


def test_errors_are_over_the_signal_about_its_mean() -> None:
    """10 % off at 6 Hz, all of 20 Hz missing; without friction off by half at 3 Hz too."""
    three = waves(4, 2, 1) + 7.0, waves(4, 1.8, 0) + 7.0, waves(2, 1.8, 0) + 7.0
    signal = twin_signal(MOTION, "motor 1", "rad", *three)
    assert signal.error == pytest.approx(math.sqrt((0.2**2 + 1) / 21))
    assert signal.error_without_friction == pytest.approx(math.sqrt((2**2 + 0.2**2 + 1) / 21))
