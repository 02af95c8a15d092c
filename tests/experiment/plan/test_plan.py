"""Plans: configurations x realisations x experiments, from seed to torque."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plants.limited_arm import EXCITATION as LIMITED
from plants.limited_arm import arm, experiment
from plants.refusals import refused

from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec

EXCITATION = MultisineSpec(rate_hz=500.0, period=2.0, band_hz=(1.0, 60.0), torque_rms=(20.0, 5.0))


def _plan(configurations: dict[str, tuple[float, ...]], realisations: int = 2, seed: int = 1) -> Plan:
    experiment = ExperimentSpec(configurations, realisations, periods=3, simulated=SimulatedSpec())
    return make_plan(EXCITATION, experiment, arm(), seed)


def test_plan_has_n_u_experiments_per_realisation_and_duration() -> None:
    """Q M n_u runs of transient and measured periods between ramps of half a second."""
    plan = _plan({"a": (0.0, 0.0), "b": (0.1, 0.2)})
    assert plan.R.shape == (2, 2, 2, len(plan.lines), 2)
    assert [e.name for e in plan.experiments][:3] == ["a-r0-e0", "a-r0-e1", "a-r1-e0"]
    assert plan.robot_time_s == 8 * ((3 + 1) * 2.0 + 2 * 0.5)
    assert [[float(rms) for rms in row[-1].split(", ")] for row in plan.display.rows] == [[20.0, 5.0], [20.0, 5.0]]
    assert np.all(plan.lines % 2 == 1)
    assert plan.freq_hz[0] >= 1.0
    assert plan.freq_hz[-1] <= 60.0


def test_further_configuration_or_realisation_keeps_the_others() -> None:
    """Phases depend on seed, configuration and realisation alone, and differ between them."""
    small, large = _plan({"a": (0.0, 0.0)}, 2), _plan({"a": (0.0, 0.0), "b": (0.1, 0.2)}, 4)
    np.testing.assert_array_equal(small.R[0], large.R[0, :2])
    sets = large.R.reshape(8, -1)
    correlation = np.abs(sets.conj() @ sets.T) / np.linalg.norm(sets[0]) ** 2
    assert np.max(correlation - np.eye(8)) < 0.4
    assert not np.array_equal(small.R, _plan({"a": (0.0, 0.0)}, 2, seed=2).R)


@pytest.mark.parametrize("flat", ["position", "velocity", "acceleration"])
def test_flat_motion_is_flat_and_low_near_resonance(flat: Any) -> None:
    """Amplitude times the largest response within 10 % is the same at all lines; no line of the motion is above it."""
    machine = arm()
    loop_of = closed_loop_of(machine, SimulatedSpec().controller, 500.0)
    excitation = replace(LIMITED, torque_rms=50.0, flat=flat)
    plan = make_plan(excitation, experiment(), machine, 0, closed_loop=loop_of)

    def motion(factor: float) -> np.ndarray:
        loop = loop_of(plan.configurations[0], factor * plan.freq_hz)
        return np.abs(np.einsum("fii,fi->fi", getattr(loop, flat), plan.R[0, 0, 0]))

    level = np.max([motion(factor) for factor in np.linspace(0.9, 1.1, 9)], axis=0)
    np.testing.assert_allclose(level / level[0], 1, rtol=1e-9)
    assert np.all(motion(1.0) <= level * (1 + 1e-9))
    assert np.all(motion(1.0).max(axis=0) > 0.9 * level[0])


def test_flat_motion_without_closed_loop_response_is_refused() -> None:
    with refused("excitation/power", place="excitation"):
        make_plan(replace(LIMITED, torque_rms=50.0, flat="position"), experiment(), arm(), 0)


def test_a_plan_of_two_amplitudes_has_each_configuration_at_both() -> None:
    """The lines at the second amplitude are a part of those at the first, with phases of their own."""
    excitation = replace(EXCITATION, torque_rms=((20.0, 5.0), (8.0, 1.0)))
    experiment = ExperimentSpec({"a": (0.0, 0.0), "b": (0.1, 0.2)}, 2, simulated=SimulatedSpec(), without_payload=())
    plan = make_plan(excitation, experiment, arm(), 1)
    assert [c.name for c in plan.configurations] == ["a", "a amplitude 2", "b", "b amplitude 2"]
    assert plan.configurations[1].angles == pytest.approx(plan.configurations[0].angles)
    rms = np.sqrt(np.sum(np.abs(plan.R) ** 2, axis=3) / 2)
    np.testing.assert_allclose(rms[1] / rms[0], np.broadcast_to([0.4, 0.2], (2, 2, 2)), rtol=1e-12)
    assert np.abs(np.angle(plan.R[1] / plan.R[0])).max() > 0.1
    one = make_plan(replace(EXCITATION, torque_rms=((20.0, 5.0),)), experiment, arm(), 1)
    np.testing.assert_array_equal(one.R, make_plan(EXCITATION, experiment, arm(), 1).R)
