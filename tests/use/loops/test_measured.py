"""Records show the sensitivity and the margins of their loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.predicted_arm import result, robot

from elastid.base.errors import DataError
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import ControllerSpec, GainsSpec, NoiseSpec, SimulatedSpec
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration
from elastid.simulation.controller import filters_of
from elastid.use.loops.plants import PostureFamily
from elastid.use.loops.result import assess
from elastid.use.loops.sensitivity import measured_loops, refusal

RATE_HZ = 250.0


@pytest.mark.slow
def test_records_show_their_peak_and_their_margins() -> None:
    """Of a noisy rig with a cascade and a delay: the peak of the model within four deviations, margins to 3 %."""
    spec = ControllerSpec(4.0, kind="cascade", delay_samples=1)
    simulated = SimulatedSpec(controller=spec, noise=NoiseSpec(torque_std=0.3, angle_std=1e-7))
    experiment = ExperimentSpec(configurations={"a": (0.3, 0.5)}, realisations=2, simulated=simulated)
    excitation = MultisineSpec(rate_hz=RATE_HZ, period=4.0, band_hz=(0.5, 110.0), torque_rms=20.0)
    plan = make_plan(excitation, experiment, robot(), seed=1)
    rig = SimulatedRig(robot(), experiment, plan, seed=1)
    records = [rig.measure(each) for each in rig.experiments]
    own = PostureFamily.of(result(), (Configuration("a", np.array([0.3, 0.5])),), RATE_HZ)
    plants = own.estimate()
    found = measured_loops(records, EstimatorSpec(), plants.inertia[0])
    truth = rig._prepared(rig.experiments[0]).gains
    state = assess("own", plants, None, truth, filters_of(("1", "2"), spec, RATE_HZ), own.names, ("1", "2"),
                   (own.modes(0),))  # fmt: skip
    assert not found.at_edge
    assert found.peak_db == pytest.approx(float(state.peak_db[0]), abs=4 * found.peak_std + 0.05)
    np.testing.assert_allclose(found.margins.phase, state.margins.phase, rtol=0.03)
    np.testing.assert_allclose(found.margins.rise, state.margins.rise, rtol=0.03)
    assert "holds no injected torque" in refusal([replace(record, r=None) for record in records])


@pytest.mark.slow
def test_unstable_gains_lose_a_motor_and_are_named() -> None:
    """With what to do about it."""
    gains = GainsSpec(40.0, (3e5, 2e4))
    simulated = SimulatedSpec(controller=ControllerSpec(kind="cascade", gains=gains, delay_samples=2))
    experiment = ExperimentSpec(configurations={"a": (0.3, 0.5)}, simulated=simulated)
    plan = make_plan(
        MultisineSpec(rate_hz=RATE_HZ, period=2.0, band_hz=(2, 50), torque_rms=20.0), experiment, robot(), 1
    )
    rig = SimulatedRig(robot(), experiment, plan, seed=1)
    with pytest.raises(
        DataError, match=r"motor . is lost .* may be unstable with experiment.simulated.controller.gains: leave"
    ):
        rig.measure(rig.experiments[0])
