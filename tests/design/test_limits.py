"""Amplitudes that keep a robot inside its limits."""

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.limited_arm import CARRIERS, EXCITATION, LIMITS, arm, experiment
from plants.refusals import refused

from elastid.app.cli import run_command
from elastid.design.limit_use import LimitUse
from elastid.design.limits import limits_of, peaks_of_movement, peaks_of_run, power_costs, within_limits
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.robot import Limits, Robot
from elastid.robot.simplified import without_dry_friction


def within(
    carrier: CarrierSpec | None = None, robot: Robot | None = None, **changes: Any
) -> tuple[Plan, LimitUse, SimulatedRig]:
    """Plan, use of the limits, and a rig of another seed that carries it out."""
    machine, spec = robot or arm(), experiment(carrier)
    excitation = replace(EXCITATION, **changes)
    plan, limit_use = within_limits(SimulatedRig(machine, spec, make_plan(excitation, spec, machine, 1), 1), excitation)
    return plan, limit_use, SimulatedRig(machine, spec, plan, 99)


def largest(rig: SimulatedRig) -> np.ndarray:
    """Peaks (8, n_u) over all experiments."""
    return np.max([peaks_of_run(rig, rig.rehearse(e)) for e in rig.experiments], axis=0)


@pytest.mark.parametrize("carrier", CARRIERS, ids=["rest", "sine", "square", "offset"])
def test_amplitudes_fill_the_limits_and_no_peak_is_above_them(carrier: CarrierSpec | None) -> None:
    """Measured with other noise; every motor comes near one of its limits, none beyond, none turns back."""
    _, limit_use, rig = within(carrier)
    used = largest(rig) / limit_use.limit[0]
    assert used.max() < 1
    assert 0.84 < limit_use.used.max() <= 0.9
    assert np.all(limit_use.used[0].max(axis=0) > 0.6)
    if carrier is not None and carrier.kind == "offset":
        plan = rig.plan
        position = rig.rehearse(rig.experiments[0]).position
        end = plan.run_samples - plan.first_sample
        assert np.all(np.diff(position[end - plan.periods * plan.period_samples : end], axis=0) > 0)


def test_large_torques_are_lowered_with_note_small_ones_kept() -> None:
    """A number in the study is what is wanted at most."""
    _, limit_use, rig = within(torque_rms=900.0)
    assert np.all(limit_use.factor < 1)
    assert limit_use.factor[0, 0] == limit_use.factor[0, 1]
    assert (limit_use.notes[0].code, limit_use.notes[0].place) == ("design/limits", "configuration a")
    assert (largest(rig) / limit_use.limit[0]).max() < 1
    plan, limit_use, _ = within(torque_rms=20.0)
    assert np.all(limit_use.factor == 1)
    assert limit_use.notes == ()
    np.testing.assert_allclose(np.sqrt(np.sum(np.abs(plan.R[0, 0, 0]) ** 2, axis=0) / 2), 20.0)


@pytest.mark.parametrize(
    ("limits", "carrier", "code", "place"),
    [
        (replace(LIMITS, torque=40.0), None, "design/limits", "configuration a"),
        (replace(LIMITS, angle=(-1.5, 0.41)), CARRIERS[1], "experiment/simulated", "experiment.simulated.carrier"),
        (replace(LIMITS, velocity=0.05), CarrierSpec(amplitude=0.02), "design/limits", "configuration a"),
    ],
    ids=["gravity", "end of the joint", "carrier"],
)
def test_limits_without_room_are_refused_with_their_cause(
    limits: Limits, carrier: CarrierSpec | None, code: str, place: str
) -> None:
    """The robot's weight, its movement: how much it needs, how much there is, what to change."""
    with refused(code, place=place):
        within(carrier, arm(limits))


def test_motor_without_limit_moves_but_cannot_be_scaled() -> None:
    peaks = []
    for robot in (without_dry_friction(arm()), arm(Limits())):
        spec = experiment(CARRIERS[1])
        rig = SimulatedRig(robot, spec, make_plan(replace(EXCITATION, torque_rms=1.0), spec, robot, 1), 1)
        peaks.append(peaks_of_movement(rig, rig.experiments[0]))
    np.testing.assert_allclose(*peaks, rtol=0.03)
    with refused("design/limits", place="excitation.torque_rms"):
        within(robot=arm(Limits()))


def test_constant_velocity_shows_linear_robot_despite_gravity_and_friction() -> None:
    """The planned movement's drift of angle and weight is taken out of the log; 3 % where sliding never stops."""
    plan, _, rig = within(CarrierSpec(kind="offset", velocity=0.1))
    G = estimate([rig.measure(e) for e in rig.experiments], EstimatorSpec(), plan.lines).G
    model = serial(arm())
    linear = linearise(model, plan.configurations[0], model.theta, model.inputs, "acceleration")
    true = frequency_response(linear, linear.theta_ref, plan.freq_hz)
    error = np.abs(np.einsum("fii->fi", G - true)) / np.abs(np.einsum("fii->fi", true))
    assert np.median(error, axis=0).max() < 0.03


def test_power_costs_are_squared_peaks_over_limits() -> None:
    """sum c P = kappa^2 rms^2 / room^2 with kappa^2 = 2 ln (2 F E M), of the closed loop; 1 for torque_rms."""
    machine, spec = arm(), experiment()
    excitation = replace(EXCITATION, torque_rms=(30.0, 20.0))
    plan = make_plan(excitation, spec, machine, 1)
    rig = SimulatedRig(machine, spec, plan, 1)
    (cost,) = power_costs(rig, excitation)
    P = np.sum(np.abs(plan.R[0, 0]) ** 2, axis=0)
    used = np.einsum("ofl,fl->o", cost, P)
    np.testing.assert_allclose(used[:2], 1.0)
    base = peaks_of_movement(rig, plan.experiments[0])
    room = 0.9 * limits_of(rig, plan.configurations[0]) - base
    loop = closed_loop_of(machine, spec.as_simulated().controller, 500.0)(plan.configurations[0], plan.freq_hz)
    S = np.einsum("foi,efi->eof", loop.stacked(("torque", "position", "velocity", "acceleration")), plan.R[0, 0])
    mean_square = (np.sum(np.abs(S) ** 2, axis=2) / 2).mean(axis=0)
    kappa_squared = 2 * math.log(2 * len(plan.lines) * 2)
    np.testing.assert_allclose(used[2:], kappa_squared * mean_square / room[:4].ravel() ** 2, rtol=1e-9)


def test_design_leaves_references_for_a_robot_controller(tiny: Path, tmp_path: Path) -> None:
    """A movement for each configuration, a torque for each experiment, time 0 where the periods begin."""
    assert run_command(["run", str(tiny), "design", "--run", str(tmp_path / "run"), "-q", "--jobs", "1"]) == 0
    folder = tmp_path / "run" / "references"
    with (folder / "b-movement.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0][:3] == ["time_s", "torque scale", "position of motor 1 (rad, link side)"]
    assert [float(rows[1][0]), float(rows[251][0])] == [-0.5, 0.0]
    assert float(rows[1][2]) == pytest.approx(math.radians(30))
    assert len(rows) == 1 + 250 + 3 * 500 + 250
    assert len(list(folder.glob("*-r*-e*.csv"))) == 4
