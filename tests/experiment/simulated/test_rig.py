"""What the simulated rig logs is what theory says of the robot that it simulates."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused
from plants.template_arm import TEMPLATE
from scipy.signal import cont2discrete

from elastid.experiment.plan.plan import Plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import NoiseSpec, SimulatedSpec
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.record import Configuration, Record
from elastid.robot import Body, Frame, Joint, Limits, Motor, Placement, Robot, Spring
from elastid.robot.simplified import with_joints, without_dry_friction
from elastid.simulation.spec import ControllerSpec
from elastid.study import load_robot

POSTURE = (0.2, 0.5, -0.6)
WEIGHT = (0.0, 0.0, -9.81)
NOISE = NoiseSpec(torque_std=1.0, angle_std=1e-6, disturbance_std=2.0, encoder_counts=8192)


def robot(gravity: tuple[float, float, float] = WEIGHT, limits: Limits = Limits()) -> Robot:  # noqa: B008
    """Three driven axes and four more elastic rotations without dry friction."""
    smooth = replace(without_dry_friction(load_robot(TEMPLATE)), gravity=gravity)
    return with_joints(smooth, lambda joint: joint if joint.motor is None else replace(joint, limits=limits))


def plan(motors: tuple[str, ...], angles: tuple[float, ...], rms: float, transient: int = 1) -> Plan:
    """One configuration, one realisation, as many orthogonal experiments as motors; odd lines from 1.5 to 60 Hz."""
    n_u, lines, random = len(motors), np.arange(3, 120, 2), np.random.default_rng(7)
    F = len(lines)
    dft = np.exp(2j * np.pi * np.outer(np.arange(n_u), np.arange(n_u)) / n_u)
    phases = np.exp(2j * np.pi * random.random((2, F, n_u)))
    R = np.einsum("fu,ue,fe->efu", rms * math.sqrt(2 / F) * phases[0], dft, phases[1])[None, None]
    return Plan((Configuration("c1", np.array(angles)),), motors, 1000.0, 2000, 2, transient, lines, R)


def rig(machine: Robot, spec: SimulatedSpec, design: Plan) -> SimulatedRig:
    study = ExperimentSpec({c.name: tuple(c.angles) for c in design.configurations}, simulated=spec)
    return SimulatedRig(machine, study, design, 1)


def three_axes(spec: SimulatedSpec = SimulatedSpec(), rms: float = 50.0, **changes: object) -> SimulatedRig:  # noqa: B008
    machine = robot(**changes)
    return rig(machine, spec, plan(machine.motor_locations, POSTURE, rms))


def measured_response(simulated: SimulatedRig) -> tuple[np.ndarray, Record]:
    """Y U^-1 (F, n_y, n_u) by plain DFT over all experiments, and the last record."""
    records = [simulated.measure(experiment) for experiment in simulated.experiments]

    def spectra(signal: str) -> np.ndarray:
        periods = [getattr(r, signal).reshape(r.n_periods, r.period_samples, -1).mean(axis=0) for r in records]
        return np.stack([np.fft.rfft(period, axis=0)[simulated.plan.lines] for period in periods], axis=-1)

    return spectra("y") @ np.linalg.inv(spectra("u")), records[-1]


@pytest.mark.slow
def test_the_closed_loop_measures_the_linear_plant_exactly() -> None:
    """Without gravity, friction and noise Y U^-1 is the plant behind its zero-order hold, as SciPy has it, to 2e-6."""
    machine = robot(gravity=(0.0, 0.0, 0.0))
    spec = SimulatedSpec(outputs=(*machine.motor_locations, "joint 3", "body upper_arm y"), substeps=4)
    simulated = rig(machine, spec, plan(machine.motor_locations, POSTURE, 1.0, transient=8))
    G, model, rate_hz = measured_response(simulated)[0], serial(machine), simulated.plan.rate_hz
    q0 = equilibrium(model, model.theta, simulated.plan.configurations[0]).q
    forms = model.mass(q0, model.theta), model.damping(q0, model.theta), model.stiffness(q0, [], model.theta)
    M, D, K = (form.full() for form in forms)
    zero, one, C = np.zeros_like(M), np.eye(len(M)), model.output_jacobian(q0, simulated.outputs)
    A = np.block([[zero, one], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    B = np.vstack([np.zeros_like(model.B), np.linalg.solve(M, model.B)])
    A, B, C, _, _ = cont2discrete((A, B, np.hstack([C, 0 * C]), np.zeros(G.shape[1:])), 1 / rate_hz)
    z = np.exp(2j * np.pi * simulated.plan.freq_hz / rate_hz)[:, None, None]
    expected = C @ np.linalg.solve(z * np.eye(len(A)) - A, B.astype(complex))
    assert (np.abs(G - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))).max() < 2e-6


def test_acceleration_of_point_contains_stated_images() -> None:
    """Behind an elastic joint that gravity tilts: as the model has it to 1e-5, and by 7e-4 without them."""
    arm = Body(
        "arm", joints=(Joint("1", "z", Spring(2000, 4), Motor(1e-3, 30)),), mass=5.0, center_of_mass=(0.2, 0, 0),
        inertia=0.1,
    )  # fmt: skip
    machine = Robot("one axis", (arm,), frames=(Frame("tool", "arm", Placement((0.5, 0, 0))),), gravity=(0, -9.81, 0))
    spec = SimulatedSpec(outputs=("motor 1", "accelerometer tool y"), substeps=6)
    lines = replace(plan(("motor 1",), (0.3,), 0.1, transient=8), rate_hz=400.0, period_samples=800)
    G, record = measured_response(rig(machine, spec, lines))
    freq_hz = lines.freq_hz
    G = G / record.hold_response(freq_hz)[:, None]
    G[:, 0] *= -((2 * np.pi * freq_hz) ** 2)[:, None]
    model = serial(machine)
    linear = linearise(model, record.configuration, model.theta, record.outputs, "acceleration")
    theta = np.append(model.theta, 0.0)  # no delay
    sampled = frequency_response(replace(linear, hold=record.images), theta, freq_hz)
    np.testing.assert_allclose(G, sampled, rtol=1e-5)
    assert np.abs(frequency_response(linear, theta, freq_hz) / G - 1)[:, 1].max() > 7e-4
    assert abs(record.y[:, 1].mean()) < 1e-3


def test_encoders_count_motor_turns() -> None:
    """A reading is a whole number of counts per motor turn times the ratio, on the link side."""
    simulated = three_axes(SimulatedSpec(noise=NoiseSpec(encoder_counts=4096)))
    counts = simulated.measure(simulated.experiments[0]).y / (2 * math.pi / (4096 * np.array([121, 125, 110])))
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)


def test_limits_of_torque_and_speed_are_reported() -> None:
    """The simulation does not clip; the record says which motor went how far."""
    simulated = three_axes(rms=300.0, limits=Limits(velocity=0.01, torque=100.0))
    notes = simulated.measure(simulated.experiments[0]).notes
    assert [note.code for note in notes] == 6 * ["experiment/limits"]
    assert {note.place.rpartition(", ")[2] for note in notes} == {"motor 1", "motor 2", "motor 3"}


def test_a_lost_robot_is_reported_with_configuration_motor_and_time() -> None:
    """A torque that throws a joint out of its limits is an error that says what to change."""
    simulated = three_axes(rms=3000.0, limits=Limits(angle=(-0.62, 0.6)))
    with refused("experiment/diverged"):
        simulated.measure(simulated.experiments[0])
    loop = three_axes(SimulatedSpec(controller=ControllerSpec(bandwidth_hz=200.0)))
    with refused("experiment/diverged"):
        loop.measure(loop.experiments[0])


def test_long_steps_are_refused_with_required_number_and_joint() -> None:
    """A stiff light joint or strong friction would make the integrator diverge; the study is refused before."""
    simulated = three_axes(SimulatedSpec(substeps=1, truth={"k_3x": 2e8}))
    with refused("experiment/simulated", place="experiment.simulated.substeps", holds="joint 3x"):
        simulated.measure(simulated.experiments[0])


def test_log_of_whole_run_contains_record_in_measured_periods() -> None:
    """To the last bit, noise included."""
    simulated = three_axes(SimulatedSpec(noise=NOISE))
    run = simulated.experiments[0]
    r, u, y = simulated.log(run)
    record = simulated.measure(run)
    assert len(r) == len(u) == len(y) == simulated.plan.run_samples
    np.testing.assert_array_equal(u[simulated.plan.measured], record.u)
    np.testing.assert_array_equal(y[simulated.plan.measured], record.y)
    np.testing.assert_allclose(r[simulated.plan.measured], record.r, atol=1e-12)
