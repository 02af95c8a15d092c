"""The simulated rig's hardware does what its numbers say."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.marks import slow
from plants.notes import said
from plants.refusals import refused
from scipy.signal import butter, freqs, welch

from elastid.experiment.plan.plan import Plan
from elastid.experiment.simulated.hardware import draw_noise, loads_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, ColoredNoiseSpec, NoiseSpec, SimulatedSpec, TorqueRippleSpec
from elastid.friction.robot_friction import frictions
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import state_space
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Body, Chain, Channel, Friction, Joint, Limits, LuGre, Motor, Placement, Robot, Spring
from elastid.simulation.contacts import contacts
from elastid.simulation.spec import ControllerSpec

ARM = (0.3,)


def arm(
    limits: Limits = Limits(),  # noqa: B008
    friction: Friction | None = None,
) -> Robot:
    """One link in a vertical plane on an elastic gear: a mode at 11 Hz."""
    joint = Joint("1", "y", Spring(4e4, 20.0), Motor(2e-3, 80.0, 1e-3, friction=friction), limits=limits)
    body = Body("upper", joints=(joint,), mass=30.0, center_of_mass=(0.4, 0, 0), inertia=1.5)
    return Robot("arm", (body,))


def plan(rms: float, runs: int = 1, seed: int = 7, period: int = 2, shape: float = 0.0) -> Plan:
    """One configuration, so many realisations; odd lines from 1.5 to 60 Hz, falling or rising with frequency."""
    lines = np.arange(2 * period - 1, 60 * period, 2)
    phases = np.exp(2j * np.pi * np.random.default_rng(seed).random((runs, len(lines))))
    amplitude = (lines / lines.max()) ** shape
    R = (rms * math.sqrt(2) / np.linalg.norm(amplitude) * amplitude * phases)[None, :, None, :, None]
    return Plan((Configuration("c1", np.array(ARM)),), ("motor 1",), 1000.0, 1000 * period, 2, 2, lines, R)


def rig(robot: Robot, spec: SimulatedSpec = SimulatedSpec(), rms: float = 100.0, **changes: int) -> SimulatedRig:  # noqa: B008
    return SimulatedRig(robot, ExperimentSpec({"c1": ARM}, simulated=spec), plan(rms, **changes), 1)


def response(simulated: SimulatedRig) -> np.ndarray:
    """Y / U (F,) over all runs, the hold taken out."""
    ratios = []
    for run in simulated.experiments:
        record = simulated.measure(run)
        u, y = (
            np.fft.rfft(part.reshape(-1, record.period_samples).mean(axis=0))[simulated.plan.lines]
            for part in (record.u[:, 0], record.y[:, 0])
        )
        ratios.append(y / u / record.hold_response(simulated.plan.freq_hz)[:, 0])
    return np.mean(ratios, axis=0)


def linear(robot: Robot, freq_hz: np.ndarray) -> np.ndarray:
    model = serial(robot)
    point = linearise(model, Configuration("c1", np.array(ARM)), model.theta, ("motor 1",), "position")
    return frequency_response(point, point.theta_ref, freq_hz)[:, 0, 0]


@pytest.mark.parametrize(("kind", "left"), [("pd", 1.0), ("cascade", 0.0)])
def test_cascade_removes_load_error_and_pd_leaves_torque_over_kp(kind: str, left: float) -> None:
    """A ripple so slow that it is a constant torque pushes; the velocity loop's integral takes it up."""
    push = 3.0
    ripple = TorqueRippleSpec(push / 80.0, 1, phase=math.pi / 2 - 80 * ARM[0])
    spec = SimulatedSpec(controller=ControllerSpec(2.0, kind=kind), torque_ripple=(ripple,))
    simulated = rig(arm(), spec, rms=1e-6)
    record = simulated.measure(simulated.experiments[0])
    model = serial(arm())
    from elastid.simulation.controller import tune

    kp = tune(model, equilibrium(model, model.theta, simulated.plan.configurations[0]).q, 2.0, 0.8).kp[0]
    # The motor turns by push / kp rad, 80 times as much on its own side, where the ripple's cosine has hardly fallen.
    np.testing.assert_allclose((record.y[-1, 0] - ARM[0]) * kp / push, left, atol=0.03)


def test_torque_is_clipped_at_limit_and_counted() -> None:
    """Gravity takes 112 Nm; with 40 Nm rms of multisine a limit of 180 Nm is met now and then, and never exceeded."""
    limits = Limits(torque=180.0)
    record = rig(arm(limits), SimulatedSpec(saturation=True), rms=40.0).measure(plan(40.0).experiments[0])
    assert np.abs(record.u).max() == 180.0
    share = np.mean(np.abs(record.u) == 180.0)
    assert 0 < share < 0.5
    (note,) = said(record.notes)
    assert f"180 N*m in {share:.2%}" in note
    assert np.abs(rig(arm(limits), rms=40.0).measure(plan(40.0).experiments[0]).u).max() > 180.0


def test_a_drive_that_is_always_at_its_limit_is_refused() -> None:
    """Where gravity takes more than the motor has, the run ends in words; so does clipping without limits."""
    simulated = rig(arm(Limits(torque=60.0, angle=(-3.0, 3.0))), SimulatedSpec(saturation=True), rms=1.0)
    with refused("experiment/diverged"):
        simulated.measure(simulated.experiments[0])
    simulated = rig(arm(), SimulatedSpec(saturation=True))
    with refused("experiment/simulated", place="experiment.simulated.saturation"):
        simulated.measure(simulated.experiments[0])


def test_noise_has_the_power_that_its_section_states() -> None:
    """At every frequency; the sum has the stated deviation, and no mean of what is colored alone."""
    colored = (
        ColoredNoiseSpec("disturbance", 2.0, corner_hz=5.0, slope=-40.0),
        ColoredNoiseSpec("torque", 3.0, corner_hz=50.0, slope=20.0),
        ColoredNoiseSpec("angle", 1.0, corner_hz=100.0, slope=-20.0),
    )
    spec = NoiseSpec(1.0, 0.5, acceleration_std=2.5, colored=colored)
    noise = draw_noise(spec, 60_000, 1000.0, 1, ("motor 1", "accelerometer tool x"), (1,))
    angles = np.hstack([noise.reading, noise.outputs[:, :1]])
    signals = {"disturbance": noise.disturbance, "torque": noise.torque, "angle": angles}
    for (signal, x), std in zip(signals.items(), (2.0, math.sqrt(10.0), math.sqrt(1.25)), strict=True):
        np.testing.assert_allclose(x.std(axis=0), std, rtol=0.05)
        freq_hz, power = welch(x, 1000.0, nperseg=1024, axis=0)
        stated = spec.variances(signal, freq_hz[2:-1], 1000.0)
        assert np.all(np.abs(np.log(500 * power[2:-1].T / stated)) < 0.5)
    np.testing.assert_allclose(noise.outputs[:, 1].std(), 2.5, rtol=0.02)
    assert abs(noise.disturbance.mean()) < 1e-9
    levels = spec.variances("disturbance", np.array([50.0, 500.0]), 1000.0)
    np.testing.assert_allclose(10 * np.log10(levels[1] / levels[0]), -40.0, atol=0.2)


def departure(robot: Robot, rms: float, reference: np.ndarray | None, **spec: object) -> tuple[np.ndarray, float]:
    """The response of the rig, and its rms relative distance from a reference response."""
    G = response(rig(robot, SimulatedSpec(**spec), rms=rms, runs=2))
    return G, 0.0 if reference is None else float(np.sqrt(np.mean(np.abs(G / reference - 1) ** 2)))


def test_the_chain_and_a_constant_velocity_leave_the_linear_response() -> None:
    """Behind a lag of second order and Butterworth's filter as scipy has them, times gains; as state space, too."""
    gains = (Channel("u", "motor 1", 1.6), Channel("y", "motor 1", 0.8))
    chain = Chain(2e-3, 2, 0.6, 1 / (2 * np.pi * 40.0), 3, channels=gains)
    carrier = CarrierSpec(kind="offset", velocity=0.1)
    robot = replace(arm(), gravity=(0.0, 0.0, 0.0))
    G, _ = departure(replace(robot, chain=chain), 20.0, None, carrier=carrier)
    freq_hz = plan(1.0).freq_hz
    s = 2j * np.pi * freq_hz
    b, a = butter(3, 2 * np.pi * 40.0, analog=True)
    lags = freqs(b, a, 2 * np.pi * freq_hz)[1] / (1 + 2 * 0.6 * 2e-3 * s + (2e-3 * s) ** 2)
    expected = 0.5 * lags * linear(robot, freq_hz)
    np.testing.assert_allclose(G, expected, rtol=3e-3)
    model = serial(replace(robot, chain=chain))
    point = linearise(model, Configuration("c1", np.array(ARM)), model.theta, ("motor 1",), "position")
    space = state_space(point, point.theta_ref).response(freq_hz)
    np.testing.assert_allclose(space[:, 0, 0], expected, rtol=1e-9)


def test_friction_is_loaded_by_what_its_joint_holds() -> None:
    """A motor by the torque that lifts both links, a spring behind it by its own: m g r of what it carries."""
    rubbing = Friction(1.0)
    far = Joint("2", "y", Spring(4e4), friction=rubbing)
    near = Joint("1", "y", motor=Motor(2e-3, 80.0), friction=rubbing)
    upper = Body("upper", joints=(near,), mass=30.0, center_of_mass=(0.4, 0, 0), inertia=1.5)
    fore = Body("fore", "upper", Placement((0.8, 0, 0)), (far,), 10.0, (0.3, 0, 0), 0.5)
    robot = Robot("arm", (upper, fore))
    model = serial(robot)
    point = equilibrium(model, model.theta, Configuration("c1", np.array([0.0])))
    sliding = contacts(model, frictions(robot))
    expected = {"joint 1": 9.81 * (30 * 0.4 + 10 * 1.1), "joint 2": 9.81 * 10 * 0.3}
    loads = loads_of(sliding, robot, point)
    np.testing.assert_allclose(loads, [expected[law.place] for law in sliding.laws], rtol=1e-3)


def test_response_without_friction_converges_with_square_of_amplitude() -> None:
    """Gravity bends with the angle; what is even in it misses the odd lines, so the error falls as amplitude^2."""
    least, _ = departure(arm(), 2.0, None)
    errors = [departure(arm(), rms, least)[1] for rms in (800.0, 400.0, 200.0)]
    np.testing.assert_allclose(-np.diff(np.log2(errors)), 2.0, atol=0.15)
    freq_hz = plan(1.0).freq_hz
    np.testing.assert_allclose(least, linear(arm(), freq_hz), rtol=2e-3)


@pytest.mark.parametrize("kind", ["coulomb", slow("lugre")])
def test_response_with_friction_converges_with_friction_over_amplitude(kind: str) -> None:
    """A joint that slides under its carrier: half the friction is half the error, for static and dynamic friction."""

    def robot(level: float) -> Robot:
        bristles = LuGre(40 * level, 0.02 * level, 5.0) if kind == "lugre" else None
        return arm(friction=Friction(level, lugre=bristles))

    carrier = CarrierSpec(0.02, cycles=1)
    none, _ = departure(arm(), 60.0, None, carrier=carrier, substeps=4)
    errors = [departure(robot(level), 60.0, none, carrier=carrier, substeps=4)[1] for level in (0.02, 0.01, 0.005)]
    np.testing.assert_allclose(-np.diff(np.log2(errors)), 1.0, atol=0.25)
