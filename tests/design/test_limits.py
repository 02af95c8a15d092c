"""Movements, reference trajectories, and amplitudes that keep a robot inside its limits."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.notes import said

from elastid.app.cli import run_command
from elastid.base.errors import StudyError
from elastid.design.limit_use import QUANTITIES, LimitUse
from elastid.design.limits import within_limits
from elastid.design.rehearsed_peaks import nearest_run, peaks_of_run
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.movement import check_movement, movement
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.plan.references import references
from elastid.experiment.simulated.closed_loop import closed_loop_of, feed_forward_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, NoiseSpec, SimulatedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.serial import serial
from elastid.report.figures.limits import limit_use as limit_use_figure
from elastid.report.figures.limits import nearest_run_signals
from elastid.robot import Body, Joint, Limits, Motor, Placement, Robot, Spring
from elastid.store import read_peaks, read_plan, read_rehearsal, write_plan

LIMITS = Limits(angle=(-1.5, 1.5), velocity=0.8, torque=1500.0, acceleration=40.0)
EXCITATION = MultisineSpec(rate_hz=500.0, period=1.0, band_hz=(2.0, 60.0), torque_rms="limits")


def arm(limits: Limits = LIMITS) -> Robot:
    """Two elastic axes with friction under gravity."""
    motor = Motor(3e-3, 100, 2e-3, 0.15)
    upper = Joint("1", "z", Spring(3e5, 300), motor, limits=limits)
    lower = Joint("2", "y", Spring(2e5, 200), replace(motor, ratio=-90), limits=limits)
    return Robot(
        "arm",
        (
            Body("turret", joints=(upper,), mass=80, center_of_mass=(0.1, 0, 0.1), inertia=6),
            Body("beam", "turret", Placement((0.1, 0, 0.4)), (lower,), 40, (0.0, 0.02, 0.3), 4),
        ),
    )


def experiment(carrier: CarrierSpec | None = None, **changes: Any) -> ExperimentSpec:
    noise = NoiseSpec(torque_std=0.5, disturbance_std=0.5, encoder_counts=1 << 20)
    simulated = SimulatedSpec(carrier=carrier, noise=noise, substeps=4)
    return replace(ExperimentSpec({"a": (0.2, 0.4)}, 1, simulated=simulated), **changes)


def within(
    carrier: CarrierSpec | None = None, robot: Robot | None = None, **changes: Any
) -> tuple[Plan, LimitUse, SimulatedRig]:
    """Plan, use of the limits, and a rig of another seed that carries it out."""
    machine, spec = robot or arm(), experiment(carrier)
    excitation = replace(EXCITATION, **changes)
    plan, limit_use = within_limits(make_plan(excitation, spec, machine, 1), excitation, spec, machine, 1)
    return plan, limit_use, SimulatedRig(machine, spec, plan, 99)


def largest(rig: SimulatedRig) -> np.ndarray:
    """Peaks (5, n_u) over all experiments."""
    return np.max([peaks_of_run(rig, e, *rig.rehearse(e)) for e in rig.experiments], axis=0)


@given(
    kind=st.sampled_from(["sine", "square", "offset"]),
    ramp=st.sampled_from([0.0, 0.25, 0.6]),
    hold=st.sampled_from([0.0, 0.1]),
    cycles=st.integers(1, 2),
)
@settings(deadline=None, max_examples=24)
def test_a_movement_is_the_integral_of_its_velocity_and_periodic_in_its_periods(
    kind: Any, ramp: float, hold: float, cycles: int
) -> None:
    """Position, velocity, acceleration agree; ends at rest; every period's velocity is the last one's."""
    size: dict[str, Any] = {"amplitude": 0.02} if kind == "sine" else {"velocity": (0.05, -0.1)}
    plan = make_plan(
        replace(EXCITATION, torque_rms=1.0, band_hz=(5.0, 60.0)), experiment(ramp=ramp, hold=hold), arm(), 0
    )
    path = movement(CarrierSpec(cycles=cycles, kind=kind, **size), plan)
    inner = slice(plan.first_sample + 2, plan.run_samples - plan.first_sample - 2)
    for x, dx in ((path.position, path.velocity), (path.velocity, path.acceleration)):
        numeric = np.gradient(x, 1 / plan.rate_hz, axis=0)
        step = np.abs(np.diff(dx, axis=0)).max()
        np.testing.assert_allclose(numeric[inner], dx[inner], atol=step + 1e-9)
        if ramp:
            np.testing.assert_allclose(numeric[1:-1], dx[1:-1], atol=step + 1e-9)
    N = plan.period_samples
    periods = path.velocity[plan.first_sample :][: 3 * N].reshape(3, N, 2)
    np.testing.assert_allclose(periods - periods[0], 0, atol=1e-12)
    if hold and ramp:
        np.testing.assert_array_equal(path.velocity[: plan.hold_samples], 0)
        np.testing.assert_array_equal(path.velocity[-plan.hold_samples + 1 :], 0)
    assert np.all(path.scale[plan.first_sample :][: 3 * N] == 1)


def test_a_square_wave_leaves_the_analysed_lines_free_and_keeps_its_shape() -> None:
    """No power on excited or detection lines; the velocity is near its amplitude for most of the time."""
    excitation = replace(EXCITATION, torque_rms=1.0, period=10.0, band_hz=(0.9, 60.0), grid="odd-random")
    plan = make_plan(excitation, experiment(), arm(), 0)
    carrier = CarrierSpec(kind="square", velocity=0.1, cutoff_hz=2.0)
    velocity = movement(carrier, plan).velocity[plan.first_sample :][: plan.period_samples, 0]
    spectrum = np.abs(np.fft.rfft(velocity)) / len(velocity)
    analysed = np.concatenate([plan.lines, plan.detection])
    assert len(plan.detection) > 50
    assert spectrum[analysed].max() < 1e-12
    assert spectrum[[1, 3, 5, 7]].min() > 1e-3
    assert np.mean(np.abs(velocity) > 0.08) > 0.8


def test_a_constant_velocity_passes_through_the_configuration_in_the_middle() -> None:
    """At the middle of the measured periods, with the sign of its velocity."""
    plan = make_plan(replace(EXCITATION, torque_rms=1.0), experiment(), arm(), 0)
    path = movement(CarrierSpec(kind="offset", velocity=(0.05, -0.1)), plan)
    middle = plan.first_sample + 2 * plan.period_samples
    np.testing.assert_allclose(path.position[middle], 0, atol=1e-12)
    np.testing.assert_allclose(path.position[middle + 50], [0.005, -0.01])


def test_a_carrier_that_leaves_a_joints_limits_in_its_ramps_is_refused() -> None:
    """A constant velocity travels while it is ramped, too; a wrong number of velocities is counted."""
    plan = make_plan(replace(EXCITATION, torque_rms=1.0), experiment(), arm(), 0)
    check_movement(CarrierSpec(kind="offset", velocity=0.4), plan, arm())
    with pytest.raises(StudyError, match=r"1.8 rad about 0.2 rad take joint 1 out of its limits \[-1.5, 1.5\] rad"):
        check_movement(CarrierSpec(kind="offset", velocity=0.8), plan, arm())
    with pytest.raises(StudyError, match="3 velocities for 2 motors"):
        check_movement(CarrierSpec(kind="square", velocity=(0.1, 0.1, 0.1)), plan, arm())


CARRIERS = [
    None,
    CarrierSpec(amplitude=0.02),
    CarrierSpec(kind="square", velocity=0.05),
    CarrierSpec(kind="offset", velocity=0.1),
]


@pytest.mark.parametrize("carrier", CARRIERS, ids=["rest", "sine", "square", "offset"])
def test_amplitudes_fill_the_limits_and_no_peak_is_above_them(carrier: CarrierSpec | None) -> None:
    """Measured with other noise; every motor comes near one of its limits, none beyond, none turns back."""
    _, limit_use, rig = within(carrier)
    used = largest(rig) / limit_use.limit[0]
    assert used.max() < 1
    assert limit_use.used.max() <= 0.9
    assert np.all(limit_use.used[0].max(axis=0) > 0.6)
    if carrier is not None and carrier.kind == "offset":
        plan = rig.plan
        position, _ = rig.rehearse(rig.experiments[0])
        end = plan.run_samples - plan.first_sample
        assert np.all(np.diff(position[end - plan.periods * plan.period_samples : end], axis=0) > 0)


def test_torques_that_are_too_large_are_lowered_with_a_word_and_small_ones_kept() -> None:
    """A number in the study is what is wanted at most."""
    _, limit_use, rig = within(torque_rms=900.0)
    assert np.all(limit_use.factor < 1)
    assert limit_use.factor[0, 0] == limit_use.factor[0, 1]
    assert "configuration a: excitation.torque_rms was lowered to" in said(limit_use.notes)[0]
    assert (largest(rig) / limit_use.limit[0]).max() < 1
    plan, limit_use, _ = within(torque_rms=20.0)
    assert np.all(limit_use.factor == 1)
    assert limit_use.notes == ()
    np.testing.assert_allclose(np.sqrt(np.sum(np.abs(plan.R[0, 0, 0]) ** 2, axis=0) / 2), 20.0)


@pytest.mark.parametrize(
    ("limits", "carrier", "message"),
    [
        (replace(LIMITS, torque=40.0), None, r"limits of joint 2.*\(torque\), the limit is 40 N\*m.*move the config"),
        (replace(LIMITS, angle=(-1.5, 0.41)), CARRIERS[1], r"take joint 2 out of its limits"),
        (replace(LIMITS, velocity=0.05), CarrierSpec(amplitude=0.02), r"\(velocity\), the limit is 0.05 rad/s"),
    ],
    ids=["gravity", "end of the joint", "carrier"],
)
def test_limits_that_leave_no_room_are_refused_with_what_is_in_the_way(
    limits: Limits, carrier: CarrierSpec | None, message: str
) -> None:
    """The robot's weight, its movement: how much it needs, how much there is, what to change."""
    with pytest.raises(StudyError, match=message):
        within(carrier, arm(limits))


def test_a_motor_without_any_limit_cannot_be_scaled_to_it() -> None:
    """The message says which motor, and both ways out."""
    with pytest.raises(StudyError, match=r"limits needs a limit of every motor, and motor 1, motor 2 has none"):
        within(robot=arm(Limits()))


def test_a_constant_velocity_shows_the_linear_robot_in_spite_of_gravity_and_friction() -> None:
    """The planned movement's drift of angle and weight is taken out of the log; 3 % where sliding never stops."""
    plan, _, rig = within(CarrierSpec(kind="offset", velocity=0.1))
    records = [rig.measure(e) for e in rig.experiments]
    G = estimate(records, EstimatorSpec(), plan.lines).G
    model = serial(arm())
    linear = linearise(model, plan.configurations[0], model.theta, model.inputs, "acceleration")
    true = frequency_response(linear, linear.theta_ref, plan.freq_hz)
    error = np.abs(np.einsum("fii->fi", G - true)) / np.abs(np.einsum("fii->fi", true))
    assert np.median(error, axis=0).max() < 0.03


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


def test_the_closed_loop_response_is_what_the_simulation_does() -> None:
    """Without friction and gravity, position and torque at all lines, to aliasing."""
    machine = arm(Limits()).with_parameters({"fm_1": 1e-6, "fm_2": 1e-6})
    bodies = tuple(
        replace(b, joints=tuple(replace(j, motor=replace(j.motor, coulomb=0.0)) for j in b.joints))  # type: ignore[type-var]
        for b in machine.bodies
    )
    machine = replace(machine, bodies=bodies, gravity=(0.0, 0.0, 0.0))
    spec = experiment(simulated=SimulatedSpec(substeps=4), transient_periods=6)
    plan = make_plan(replace(EXCITATION, torque_rms=1.0), spec, machine, 0)
    rig = SimulatedRig(machine, spec, plan, 0)
    loop = closed_loop_of(machine, spec.as_simulated().controller, 500.0)(plan.configurations[0], plan.freq_hz)
    position, torque = rig.rehearse(rig.experiments[1])
    last = slice(plan.first_sample + 6 * 500, plan.first_sample + 7 * 500)
    R = plan.R[0, 0, 1]
    for signal, T in ((position, loop.position), (torque, loop.torque)):
        measured = np.fft.rfft(signal[last], axis=0)[plan.lines] / 250
        expected = np.einsum("foi,fi->fo", T, R)
        assert np.abs(measured - expected).max() < 0.01 * np.abs(expected).max()


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


def test_references_hold_the_robot_up_and_inject_the_plans_torque_under_a_ramp() -> None:
    """Feed-forward is the weight at rest; the injected torque is the period's, at the right sample."""
    spec = experiment(hold=0.1)
    plan = make_plan(replace(EXCITATION, torque_rms=10.0), spec, arm(), 0)
    (one,) = references(plan, None, feed_forward_of(serial(arm())))
    assert one.position.shape == (plan.run_samples, 2)
    np.testing.assert_allclose(one.feed_forward[:, 0], 0, atol=1e-9)
    weight = -9.81 * 40 * 0.3 * math.sin(0.4)  # gravity about the beam's axis; the motor holds against it
    np.testing.assert_allclose(one.feed_forward[:, 1], weight, rtol=1e-3)
    period = plan.torque(plan.experiments[1])
    r = one.injected(period)
    np.testing.assert_array_equal(r[one.first_sample : one.first_sample + 500], period)
    np.testing.assert_array_equal(r[:50], 0)
    assert np.all(np.diff(one.scale[: one.first_sample]) >= 0)


def test_plan_and_peaks_come_back_from_their_file(tmp_path: Path) -> None:
    """plan.h5 holds plan, references and the use of the limits."""
    plan, limit_use, _ = within(CARRIERS[1], grid="odd-random")
    run = nearest_run(plan, limit_use.nearest, experiment(CARRIERS[1]), arm(), 1)
    path = tmp_path / "plan.h5"
    write_plan(
        path,
        plan,
        references=references(plan, CARRIERS[1], feed_forward_of(serial(arm()))),
        peaks=limit_use,
        nearest=run,
    )
    again, found = read_plan(tmp_path / "plan.h5"), read_peaks(tmp_path / "plan.h5")
    for name in ("lines", "detection", "R", "ramp_samples", "hold_samples"):
        np.testing.assert_array_equal(getattr(again, name), getattr(plan, name))
    for name in ("peak", "limit", "factor"):
        np.testing.assert_array_equal(getattr(found, name), getattr(limit_use, name))
    assert found.closest == limit_use.closest
    assert (found.nearest, read_rehearsal(path).experiment.name) == (limit_use.nearest, limit_use.nearest)
    np.testing.assert_array_equal(read_rehearsal(path).signals, run.signals)
    assert len(QUANTITIES) == found.peak.shape[1]


def test_the_run_nearest_to_a_limit_is_drawn_between_the_limits() -> None:
    """Its largest signal is the largest peak of the plan; the panels show it whole, with limits on both sides."""
    plan, limit_use, _ = within(CARRIERS[0])
    run = nearest_run(plan, limit_use.nearest, experiment(CARRIERS[0]), arm(), 1)
    used = np.abs(run.signals).max(axis=1) / limit_use.limit[0, :4]
    assert used.max() == pytest.approx(limit_use.used.max(), rel=1e-9)
    panels = np.reshape(nearest_run_signals(run, limit_use, plan).axes, (2, 4))
    for (i, kind), axes in np.ndenumerate(panels):
        signal, *limits = axes.get_lines()
        drawn = np.asarray(signal.get_ydata())
        assert np.abs(drawn).max() == pytest.approx(used[kind, i] * limit_use.limit[0, kind, i])
        assert [abs(line.get_ydata()[0]) for line in limits] in ([], [limit_use.limit[0, kind, i]] * 2)
        assert bool(limits) == (used[kind, i] > 0.2)
    texts = [text.get_text() for axes in limit_use_figure(limit_use).axes for text in axes.texts]
    assert texts == [f"{100 * value:.0f}" for kind in limit_use.used[0, :4] for value in kind]


def test_design_leaves_references_for_a_robot_controller(tiny: Path, tmp_path: Path) -> None:
    """A movement for each configuration, a torque for each experiment, time 0 where the periods begin."""
    assert run_command(["design", str(tiny), "--run", str(tmp_path / "run"), "-q", "--jobs", "1"]) == 0
    folder = tmp_path / "run" / "references"
    with (folder / "b-movement.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0][:3] == ["time_s", "torque scale", "position of motor 1 (rad, link side)"]
    assert [float(rows[1][0]), float(rows[251][0])] == [-0.5, 0.0]
    assert float(rows[1][2]) == pytest.approx(math.radians(30))
    assert len(rows) == 1 + 250 + 3 * 500 + 250
    assert len(list(folder.glob("*-r*-e*.csv"))) == 4


@pytest.mark.slow
def test_no_simulated_peak_is_above_any_limit_in_random_studies() -> None:
    """scripts/studies/limits.py draws them; here twenty."""
    from importlib.util import module_from_spec, spec_from_file_location

    path = Path(__file__).parents[2] / "scripts" / "studies" / "limits.py"
    found = spec_from_file_location("limits_study", path)
    assert found is not None
    module = module_from_spec(found)
    assert found.loader is not None
    found.loader.exec_module(module)
    outcomes = [module.studied(0.1, seed) for seed in range(20)]
    assert sum(not o.refused for o in outcomes) > 10
    assert max(o.measured.max() for o in outcomes) < 1
