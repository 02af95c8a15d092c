"""Torque spectra: the quantity that is flat, the noise, and sets that lines or realisations do not allow."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plants.limited_arm import EXCITATION, arm, experiment

from elastid.base.errors import StudyError
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.specs.disturbances import NoiseSpec
from elastid.experiment.specs.simulated import SimulatedSpec


@pytest.mark.parametrize("flat", ["position", "velocity", "acceleration"])
def test_a_motion_that_is_to_be_flat_is_flat_and_low_where_a_resonance_may_be(flat: Any) -> None:
    """Amplitude times the largest response within 10 % is the same at all lines; no line of the motion is above it."""
    machine = arm()
    loop_of = closed_loop_of(machine, SimulatedSpec().controller, 500.0)
    excitation = replace(EXCITATION, torque_rms=50.0, flat=flat)
    plan = make_plan(excitation, experiment(), machine, 0, closed_loop=loop_of)

    def motion(factor: float) -> np.ndarray:
        loop = loop_of(plan.configurations[0], factor * plan.freq_hz)
        return np.abs(np.einsum("fii,fi->fi", getattr(loop, flat), plan.R[0, 0, 0]))

    level = np.max([motion(factor) for factor in np.linspace(0.9, 1.1, 9)], axis=0)
    np.testing.assert_allclose(level / level[0], 1, rtol=1e-9)
    assert np.all(motion(1.0) <= level * (1 + 1e-9))
    assert np.all(motion(1.0).max(axis=0) > 0.9 * level[0])


def test_precision_puts_torque_where_angle_noise_would_hide_the_response() -> None:
    """With noise of the angle alone the torque rises as the angle falls; without any noise it is refused."""
    noise = NoiseSpec(angle_std=1e-5)
    spec = experiment(simulated=SimulatedSpec(noise=noise))
    excitation = replace(EXCITATION, torque_rms=50.0, flat="precision")
    loop_of = closed_loop_of(arm(), SimulatedSpec().controller, 500.0)
    plan = make_plan(excitation, spec, arm(), 0, closed_loop=loop_of)
    loop = loop_of(plan.configurations[0], plan.freq_hz)
    position = np.abs(np.einsum("fii,fi->fi", loop.position, plan.R[0, 0, 0]))
    np.testing.assert_allclose(position / position[0], 1, rtol=1e-9)
    with pytest.raises(StudyError, match="precision needs the expected noise"):
        make_plan(excitation, experiment(simulated=SimulatedSpec()), arm(), 0, closed_loop=loop_of)
    with pytest.raises(StudyError, match=r"flat: precision.*needs the robot's closed-loop response"):
        make_plan(excitation, spec, arm(), 0)


def test_a_plan_refuses_sets_that_its_lines_or_realisations_do_not_allow() -> None:
    """Fewer lines than motors; two realisations of one signal; no Hadamard matrix is needed for two motors."""
    few = replace(EXCITATION, torque_rms=1.0, band_hz=(2.5, 3.5))
    with pytest.raises(StudyError, match="excitation: 1 lines for 2 motors; take a period at least 2 times as long"):
        make_plan(few, experiment(), arm(), 0)
    twice = replace(EXCITATION, torque_rms=1.0, phases="schroeder")
    with pytest.raises(StudyError, match="schroeder gives the same signal in each of 2 realisations"):
        make_plan(twice, experiment(realisations=2), arm(), 0)
    assert make_plan(replace(twice, orthogonal="hadamard"), experiment(), arm(), 0).R.shape[1] == 1
