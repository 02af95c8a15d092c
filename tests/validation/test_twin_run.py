"""Errors of a twin's signals over time and by octave, and what is said of them."""

import math

import numpy as np
import pytest

from elastid.validation.twin_run import MOTION, TwinRun, twin_signal

RATE_HZ, N = 200.0, 2000


def waves(*amplitudes: float) -> np.ndarray:
    """At 3, 6 and 20 Hz."""
    t = np.arange(N) / RATE_HZ
    return np.sum([a * np.sin(2 * np.pi * f * t) for a, f in zip(amplitudes, (3.0, 6.0, 20.0), strict=True)], axis=0)


def run(**changes: object) -> TwinRun:
    """10 % off at 6 Hz, all of 20 Hz missing; without friction off by half at 3 Hz too."""
    three = waves(4, 2, 1) + 7.0, waves(4, 1.8, 0) + 7.0, waves(2, 1.8, 0) + 7.0
    signals = (twin_signal(MOTION, "motor 1", "rad", three, RATE_HZ, (0.0, 32.0)),)
    return TwinRun("log", "torque", 0.5, 10.0, RATE_HZ, **{"signals": signals, **changes})  # type: ignore[arg-type]


def test_errors_are_over_the_signal_about_its_mean_and_by_octave() -> None:
    signal = run().signals[0]
    assert signal.error == pytest.approx(math.sqrt((0.2**2 + 1) / 21))
    assert signal.error_without_friction == pytest.approx(math.sqrt((2**2 + 0.2**2 + 1) / 21))
    bands = {(band.low_hz, band.high_hz): band for band in signal.bands}
    assert bands[2.0, 4.0].error == pytest.approx(0.0, abs=1e-6)
    assert bands[2.0, 4.0].error_without_friction == pytest.approx(0.5, rel=1e-3)
    assert bands[4.0, 8.0].error == pytest.approx(0.1, rel=1e-3)
    assert bands[16.0, 32.0].error == pytest.approx(1.0, rel=1e-3)
    assert bands[16.0, 32.0].power == pytest.approx(1 / 21, rel=1e-3)
    assert signal.worst is bands[16.0, 32.0]
