"""The sections of an experiment: one rig, channels of a quantity that goes with them, controllers and noise."""

from __future__ import annotations

import numpy as np
import pytest
from plants.refusals import refused

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec, ToolSpec
from elastid.experiment.specs.recorded import ResponseFileSpec, ResponsesSpec
from elastid.experiment.specs.simulated import ColoredNoiseSpec, NoiseSpec, SimulatedSpec
from elastid.simulation.spec import ControllerSpec


def test_exactly_one_rig_with_its_kind() -> None:
    spec = ExperimentSpec(simulated=SimulatedSpec())
    assert (spec.kind, spec.channels, spec.runs(3)) == ("simulated", (), 3)
    with refused("study/stage", place="experiment"):
        spec.as_recorded()
    with pytest.raises(ValueError, match="exactly one"):
        ExperimentSpec()


@pytest.mark.parametrize("name", ["stiffness", "damping"])
def test_a_drive_that_pushes_away_is_refused(name: str) -> None:
    """A sign that was turned would make an unstable robot, whose response has no error that shows it."""
    responses = ResponsesSpec(files=(ResponseFileSpec(path="tap.csv", configuration="a"),))
    gains = {"stiffness": (40.0,), "damping": (0.1,)}
    with pytest.raises(ValueError, match=name):
        ToolSpec(responses, "controlled", **(gains | {name: (-1.0,)}))


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


def test_a_motion_is_no_input() -> None:
    with pytest.raises(ValueError, match="role u does not go with quantity position"):
        ChannelSpec("u", "motor 1", "q", quantity="position")
