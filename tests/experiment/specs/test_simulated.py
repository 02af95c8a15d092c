"""The section `simulated`: carriers and controllers."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.experiment.specs.simulated import ColoredNoiseSpec, ControllerSpec, NoiseSpec


def test_integral_time_below_the_limit_of_routh_is_refused() -> None:
    assert ControllerSpec(kind="cascade").velocity_integral_time == pytest.approx(3 / (2 * np.pi * 1.5))
    with pytest.raises(ValueError, match="the loop is stable above"):
        ControllerSpec(kind="cascade", damping_ratio=0.2, integral_time=0.01)


def test_colored_noise_has_its_power_over_the_band_and_falls_behind_its_corner() -> None:
    noise = NoiseSpec(colored=(ColoredNoiseSpec("torque", 0.5, corner_hz=0.2, slope=-20.0),))
    freq_hz = np.linspace(0, 50, 10_001)[1:]
    variance = noise.variances("torque", freq_hz, 100.0)
    assert np.mean(variance) == pytest.approx(0.25)
    assert 10 * np.log10(variance[-1] / variance[999]) == pytest.approx(-20.0, abs=0.2)
    assert not noise.variances("angle", freq_hz, 100.0).any()
