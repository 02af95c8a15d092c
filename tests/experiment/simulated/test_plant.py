"""The predicted closed loop and the references that a plan is given."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from plants.limited_arm import EXCITATION, arm, experiment

from elastid.experiment.plan.movement import reference
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.plant import closed_loop_of, feed_forward_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.model.formulation import serial
from elastid.robot import Limits
from elastid.robot.simplified import without_dry_friction
from elastid.study import load


def test_the_closed_loop_response_is_what_the_simulation_does() -> None:
    """Without friction and gravity, position and torque at all lines, to aliasing."""
    machine = arm(Limits()).with_parameters({"fm_1": 1e-6, "fm_2": 1e-6})
    machine = replace(without_dry_friction(machine), gravity=(0.0, 0.0, 0.0))
    spec = experiment(simulated=SimulatedSpec(substeps=4), transient_periods=6)
    plan = make_plan(replace(EXCITATION, torque_rms=1.0), spec, machine, 0)
    rig = SimulatedRig(machine, spec, plan, 0)
    loop = closed_loop_of(machine, spec.as_simulated().controller, 500.0)(plan.configurations[0], plan.freq_hz)
    rehearsal = rig.rehearse(rig.experiments[1])
    position, torque = rehearsal.position, rehearsal.torque
    last = slice(plan.first_sample + 6 * 500, plan.first_sample + 7 * 500)
    R = plan.R[0, 0, 1]
    for signal, T in ((position, loop.position), (torque, loop.torque)):
        measured = np.fft.rfft(signal[last], axis=0)[plan.lines] / 250
        expected = np.einsum("foi,fi->fo", T, R)
        assert np.abs(measured - expected).max() < 0.01 * np.abs(expected).max()


def test_references_hold_the_robot_up_and_inject_the_plans_torque_under_a_ramp() -> None:
    """Feed-forward is the weight at rest; the injected torque is the period's, at the right sample."""
    spec = experiment(hold=0.1)
    plan = make_plan(replace(EXCITATION, torque_rms=10.0), spec, arm(), 0)
    one = reference(plan, None, feed_forward_of(serial(arm())), plan.configurations[0])
    assert one.position.shape == (plan.run_samples, 2)
    np.testing.assert_allclose(one.feed_forward[:, 0], 0, atol=1e-9)
    weight = -9.81 * 40 * 0.3 * math.sin(0.4)  # gravity about the beam's axis; the motor holds against it
    np.testing.assert_allclose(one.feed_forward[:, 1], weight, rtol=1e-3)
    period = plan.torque(plan.experiments[1])
    r = one.injected(period)
    np.testing.assert_array_equal(r[one.first_sample : one.first_sample + 500], period)
    np.testing.assert_array_equal(r[:50], 0)
    assert np.all(np.diff(one.scale[: one.first_sample]) >= 0)


def test_steps_that_nobody_gives_are_right_up_to_the_end_of_the_band(tiny: Path) -> None:
    """A mode at 55 Hz, at 500 Hz: of the motion at most 3e-6 differs from that by ten steps, of one step 3e-5."""
    study = load(tiny, ["experiment.configurations={a: [0]}", "excitation.band_hz=[5, 70]"]).study
    robot, spec = study.as_robot(), study.experiment
    plan = make_plan(study.excitation, spec, robot, 1)

    def moved(substeps: int | None) -> np.ndarray:
        rig = SimulatedRig(robot, replace(spec, simulated=SimulatedSpec(substeps=substeps)), plan, 1)
        return rig.rehearse(rig.experiments[0]).position

    exact = moved(10)
    one, found = (float(np.linalg.norm(moved(n) - exact) / np.linalg.norm(exact)) for n in (1, None))
    assert found < 3e-6 < 3e-5 < one
