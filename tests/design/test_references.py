"""References whose acting torque is the planned one: path, spectrum, limits with other gains, files to be played."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.limited_arm import EXCITATION, arm, experiment
from plants.marks import slow
from plants.refusals import refused
from ruamel.yaml import YAML
from scipy.interpolate import CubicHermiteSpline

from elastid.app import scaffold
from elastid.app.cli import run_command
from elastid.app.overview import overview
from elastid.app.stages.design import problem_of
from elastid.design.limits import expected_use, limits_of, peaks_of_run, within_limits
from elastid.excitation.spec import Injected
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.plan.reference_trajectory import references
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, NoiseSpec, SimulatedSpec
from elastid.robot import Limits, Robot
from elastid.robot.simplified import without_dry_friction
from elastid.simulation.reference_path import ReferencePath
from elastid.simulation.spec import ControllerSpec, ReferencePathSpec
from elastid.store.plan import read_peaks
from elastid.store.trajectory import write_references
from elastid.study import load

CYCLE = 0.004
GAINS = {"position_gain": 20.0, "velocity_gain": (3000.0, 1500.0), "integral_time": 0.06}


@pytest.mark.parametrize("kind", ["hold", "linear", "spline"])
def test_the_played_reference_is_that_of_an_interpolator(kind: Any) -> None:
    """Steps; lines that arrive one cycle late; cubics by central differences, which pass every reference in time."""
    rows, n = np.cumsum(np.random.default_rng(1).normal(size=(40, 2)), axis=0), 4
    rows[:2], rows[-2:] = rows[1], rows[-2]  # at rest at both ends
    played = ReferencePath(ReferencePathSpec(CYCLE, kind), 1000.0).played(rows)
    t, fine = np.arange(len(rows)) * n, np.arange(len(rows) * n)
    slopes = np.gradient(rows, n, axis=0)
    expected = {
        "hold": np.repeat(rows, n, axis=0),
        "linear": np.column_stack([np.interp(fine - n + 1, t, x) for x in rows.T]),
        "spline": CubicHermiteSpline(t, rows, slopes)(np.minimum(fine, t[-1])),
    }
    np.testing.assert_allclose(played, expected[kind], atol=1e-12)


def test_filters_have_their_response_at_every_line() -> None:
    """A periodic reference, played until it is steady, has the spectrum F_r times its own."""
    spec = ReferencePathSpec(CYCLE, "linear", filter_hz=15.0, filter_order=2, moving_average=0.01)
    path, N, lines = ReferencePath(spec, 1000.0), 1000, np.array([3, 17, 60])
    period = np.fft.irfft(np.isin(np.arange(N // 2 + 1), lines) * 1.0j, N)[:, None]
    played = path.played(np.tile(period, (4, 1))[:: spec.cycle_samples(1000.0)])[-N:]
    ratio = np.fft.rfft(played, axis=0)[lines, 0] / np.fft.rfft(period, axis=0)[lines, 0]
    np.testing.assert_allclose(ratio, path.response(lines.astype(float)), rtol=1e-6)


def planned(inject: Injected, controller: ControllerSpec, robot: Robot, spec: ExperimentSpec) -> tuple[Plan, Any]:
    """A plan of 1 Nm rms, and the closed loop in its configuration."""
    excitation = replace(EXCITATION, torque_rms=1.0, inject=inject)
    loop = closed_loop_of(robot, controller, excitation.rate_hz, inject)
    plan = make_plan(excitation, spec, robot, 0, closed_loop=loop)
    return plan, loop(plan.configurations[0], plan.freq_hz)


@pytest.mark.parametrize("inject", ["position", "velocity"])
@pytest.mark.parametrize(
    ("path", "controller"),
    [
        ({"interpolation": "hold"}, {"bandwidth_hz": 4.0}),
        ({"filter_hz": 20.0, "filter_order": 2}, {"kind": "cascade", "gains": GAINS, "delay_samples": 1}),
        ({"interpolation": "spline", "velocity_feedforward": 0.5, "moving_average": 0.01}, {"kind": "cascade"}),
    ],
    ids=["hold", "filtered", "spline"],
)
def test_the_acting_torque_has_the_planned_spectrum(inject: Injected, path: Any, controller: Any) -> None:
    """In the nonlinear simulation, without friction and gravity, line by line to 0.1 %; 1 Nm rms of each motor."""
    machine = arm(Limits()).with_parameters({"fm_1": 1e-6, "fm_2": 1e-6})
    machine = replace(without_dry_friction(machine), gravity=(0.0, 0.0, 0.0))
    driven = ControllerSpec(**controller, reference=ReferencePathSpec(CYCLE, **path))
    spec = experiment(simulated=SimulatedSpec(substeps=4, controller=driven), transient_periods=4)
    plan, loop = planned(inject, driven, machine, spec)
    rig = SimulatedRig(machine, spec, plan, 0)
    U = np.fft.rfft(rig.rehearse(rig.experiments[1]).torque[plan.measured][-500:], axis=0)[plan.lines] / 250
    expected = np.einsum("foi,fi->fo", loop.torque, plan.R[0, 0, 1])
    assert np.abs(U - expected).max() < 1e-3 * np.abs(expected).max()
    np.testing.assert_allclose(np.sqrt(np.sum(np.abs(U) ** 2, axis=0) / 2), 1.0, rtol=1e-3)


@cache
def limited(torque_rms: Any = 120.0) -> tuple[SimulatedRig, Any]:
    """A rig with its plan within the limits, and their use."""
    driven = ControllerSpec(kind="cascade", gains=GAINS, reference=ReferencePathSpec(CYCLE))
    noise = NoiseSpec(torque_std=0.5, disturbance_std=0.5, encoder_counts=1 << 20)
    simulated = SimulatedSpec(substeps=4, controller=driven, noise=noise, carrier=CarrierSpec(amplitude=0.02))
    spec, machine = experiment(simulated=simulated), arm()
    excitation = replace(EXCITATION, torque_rms=torque_rms, inject="position")
    plan = make_plan(excitation, spec, machine, 1, closed_loop=closed_loop_of(machine, driven, 500.0, "position"))
    plan, use = within_limits(SimulatedRig(machine, spec, plan, 1), excitation)
    return SimulatedRig(machine, spec, plan, 99), use


@pytest.mark.parametrize("torque_rms", [slow(5000.0), "limits"])
def test_movement_keeps_limits_with_gains_30_percent_off(torque_rms: Any) -> None:
    rig, use = limited(torque_rms)
    assert 0.8 < use.used.max() <= 0.9
    limit = limits_of(rig, rig.plan.configurations[0])
    for gains in ((1.0, 1.0), (1.3, 1.3), (0.7, 0.7), (1.3, 0.7), (0.7, 1.3)):
        off = rig.with_gains(*gains)
        peaks = np.max([peaks_of_run(off, off.rehearse(e)) for e in off.experiments], axis=0)
        assert np.all(peaks[5:] > 0)
        assert (peaks / limit).max() < 1


def test_gains_that_are_off_change_the_torque_by_no_more() -> None:
    """K_p by 30 %: 5 %; K_v, to which the torque above the loop's bandwidth is proportional: 30 %."""
    rig, _ = limited()
    trial, ratios = rig.experiments[0], {}
    for gains in ((1.0, 1.0), (1.3, 1.0), (0.7, 1.0), (1.0, 1.3), (1.0, 0.7)):
        rehearsal = rig.with_gains(*gains).rehearse(trial)
        U = np.fft.rfft(rehearsal.torque[rig.plan.measured], axis=0)[rig.plan.periods * rig.plan.lines]
        ratios[gains] = np.sqrt(np.sum(np.abs(U) ** 2, axis=0))
    for (_, velocity), rms in ratios.items():
        assert np.all(np.abs(rms / ratios[1.0, 1.0] - 1) < (0.05 if velocity == 1 else 0.3))


@pytest.mark.parametrize("carrier", [None, CarrierSpec(amplitude=0.02), CarrierSpec(kind="offset", velocity=0.1)])
def test_run_file_is_complete_and_starts_at_rest(carrier: CarrierSpec | None) -> None:
    """Approach, P + 1 periods without a gap, return: one row a cycle."""
    driven = ControllerSpec(reference=ReferencePathSpec(CYCLE))
    spec = experiment(simulated=SimulatedSpec(substeps=4, controller=driven, carrier=carrier))
    plan, _ = planned("position", driven, arm(), spec)
    rows = references(plan, carrier, plan.experiments[0])
    n, first, N = plan.run_samples // 2, plan.first_sample // 2, plan.period_samples // 2
    assert rows.shape == (n, 2)
    np.testing.assert_array_equal(rows[0], rows[1])
    np.testing.assert_array_equal(rows[-1], rows[-2])
    periods = np.diff(rows[first : first + 3 * N], axis=0, prepend=rows[first - 1 : first])[1:]
    periods = np.vstack([periods, periods[-1:]]).reshape(3, N, 2)[:, :-1]
    np.testing.assert_allclose(periods - periods[0], 0, atol=1e-9)
    assert plan.periods + plan.transient_periods == 3


@cache
def plan_of_spline(inject: Injected) -> Plan:
    driven = ControllerSpec(reference=ReferencePathSpec(CYCLE, "spline"))
    return planned(inject, driven, arm(), experiment(simulated=SimulatedSpec(substeps=4, controller=driven)))[0]


@pytest.mark.parametrize(
    ("unit", "side", "inject", "heading"),
    [
        ("rad", "link", "position", "position of motor 2 (rad, link side)"),
        ("deg", "motor", "position", "position of motor 2 (deg, motor side)"),
        ("increments", "link", "position", "position of motor 2 (increments, motor side)"),
        ("deg", "link", "velocity", "velocity of motor 2 (deg/s, link side)"),
    ],
)
def test_files_have_unit_and_side_of_study(unit: Any, side: Any, inject: Any, heading: str, tmp_path: Path) -> None:
    spec = ReferencePathSpec(CYCLE, "spline", unit=unit, side=side)
    driven, machine = ControllerSpec(reference=spec), arm()
    simulated = SimulatedSpec(substeps=4, controller=driven, noise=NoiseSpec(encoder_counts=4096))
    plan = plan_of_spline(inject)
    rows, path = references(plan, None, plan.experiments[0]), tmp_path / "a.csv"
    write_references(path, plan, plan.experiments[0], simulated, machine)
    (_, *headings), *lines = csv.reader(path.read_text().splitlines())
    numbers = np.array(lines, float)
    factor = {"rad": 1.0, "deg": 180 / np.pi, "increments": 4096 / 2 / np.pi}[unit]
    ratio = -90 if side == "motor" or unit == "increments" else 1
    assert headings[1] == heading
    error = 0.5 + 1e-6 if unit == "increments" else 1e-9
    np.testing.assert_allclose(numbers[:, 2], factor * ratio * rows[:, 1], atol=error)
    np.testing.assert_allclose(np.diff(numbers[:, 0]), CYCLE)
    assert (tmp_path / "a.yaml").exists() == (inject == "position")
    if inject == "position":
        points = YAML(typ="safe").load(tmp_path / "a.yaml")["points"]
        np.testing.assert_array_equal([point["positions"] for point in points], rows)
        middle = (rows[2:] - rows[:-2]) / (2 * CYCLE)
        np.testing.assert_allclose([point["velocities"] for point in points[1:-1]], middle, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ("excitation.inject=torque", "experiment.simulated.controller.reference"),
        ("experiment.simulated.controller.reference=null", "experiment.simulated.controller.reference"),
        ("experiment.simulated.controller.reference.cycle=4.5 ms", "experiment.simulated.controller.reference.cycle"),
        ("experiment.simulated.controller.reference.cycle=20 ms", "experiment.simulated.controller.reference.cycle"),
    ],
)
def test_paths_that_do_not_fit_are_refused_at_their_key(change: str, place: str, tmp_path: Path) -> None:
    study = scaffold.new(tmp_path, "position-reference")
    with refused("study/invalid", holds=(place,)):
        load(study, [change])


def test_the_template_plans_references_and_check_foretells_their_margin(tmp_path: Path) -> None:
    """Degrees at 4 ms; the run of a plan of a tenth of the size is written as the study says."""
    study = scaffold.new(tmp_path, "position-reference")
    small = ["experiment.configurations={a: [0, 20 deg]}", "experiment.realisations=1", "excitation.period=2 s"]
    small_study = load(study, small).study
    problem = problem_of(small_study)
    plan = problem.plan(small_study.experiment)
    expected = expected_use(problem.rig(plan), 0.1).used.max()
    assert f"({100 * expected:.0f} %)" in overview(small_study)
    assert f"{plan.freq_hz[0]:g} to {plan.freq_hz[-1]:g} Hz" in overview(small_study)
    command = ["run", str(study), "design", "--run", str(tmp_path / "run"), "-q", "--jobs", "1"]
    assert run_command([*command, *(word for change in small for word in ("--set", change))]) == 0
    assert sorted(path.name for path in (tmp_path / "run" / "references").iterdir()) == [
        f"a-r0-e{i}.{end}" for i in range(2) for end in ("csv", "yaml")
    ]
    rows = np.loadtxt(tmp_path / "run" / "references" / "a-r0-e0.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[[0, 1, -2, -1], 1:], [[0, 20]] * 4, atol=1e-9)
    assert len(rows) == 2 + 250 + 3 * 500 + 250 + 2
    assert read_peaks(tmp_path / "run" / "plan.h5").used.max() == pytest.approx(expected, abs=0.1)
