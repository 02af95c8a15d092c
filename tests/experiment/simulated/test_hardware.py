"""The simulated rig's hardware does what its numbers say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from plants.notes import said
from plants.refusals import refused
from scipy.integrate import solve_ivp
from scipy.signal import butter, freqs, welch

from elastid.experiment.plan.plan import Plan
from elastid.experiment.simulated.hardware import draw_noise
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, ColoredNoiseSpec, NoiseSpec, SimulatedSpec, TorqueRippleSpec
from elastid.friction.robot_friction import frictions
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import elements, state_space
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Body, Chain, Friction, Joint, Limits, LuGre, Motor, Robot, Spring
from elastid.simulation.dynamics import contacts
from elastid.simulation.spec import ControllerSpec

ARM = (0.3,)


def arm(
    limits: Limits = Limits(),  # noqa: B008
    chain: Chain = Chain(),  # noqa: B008
    friction: Friction | None = None,
) -> Robot:
    """One link in a vertical plane on an elastic gear: a mode at 11 Hz."""
    joint = Joint("1", "y", Spring(4e4, 20.0), Motor(2e-3, 80.0, 1e-3, friction=friction), limits=limits)
    body = Body("upper", joints=(joint,), mass=30.0, center_of_mass=(0.4, 0, 0), inertia=1.5)
    return Robot("arm", (body,), chain=chain)


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
    return np.asarray(np.mean(ratios, axis=0))


def linear(robot: Robot, freq_hz: np.ndarray) -> np.ndarray:
    model = serial(robot)
    point = linearise(model, Configuration("c1", np.array(ARM)), model.theta, ("motor 1",), "position")
    return frequency_response(point, point.theta_ref, freq_hz)[:, 0, 0]


# --- friction with states in the loop -------------------------------------------------------------------------------


def axis_with(friction: Friction) -> Robot:
    """A rotor of 20 kg m^2, link side, with friction of the link side, ratio one."""
    return Robot("axis", (Body("rotor", joints=(Joint("1", "z", motor=Motor(20.0, friction=friction)),), mass=1.0),))


LUGRE = Friction(30.0, 45.0, 0.02, lugre=LuGre(1e5, 300.0, 0.5))


def moved(friction: Friction, torque: np.ndarray, step: float) -> np.ndarray:
    """Velocities (n,) at the ends of steps of held torque (n,), by the loop's own Runge-Kutta step."""
    import casadi as ca

    from elastid.simulation.dynamics import FIFTH_ORDER, free_acceleration, runge_kutta_step

    model = serial(axis_with(friction))
    sliding = contacts(model, frictions(model.robot))
    free, curves = free_acceleration(model), ca.DM(sliding.curves)
    q, v, z, u = ca.SX.sym("q"), ca.SX.sym("v"), ca.SX.sym("z", sliding.n_states), ca.SX.sym("u")
    after = runge_kutta_step(
        lambda q, v, z, u: free(q, v, u - sliding.torque(v, z, ca.SX(curves))),
        lambda z, v, h: sliding.advanced(v, z, ca.SX(curves), h),
        *(q, v, z), (u,) * 6, step, FIFTH_ORDER,
    )  # fmt: skip
    walk = ca.Function("step", [q, v, z, u], [*after]).mapaccum("walk", len(torque), 3, {})
    return walk(0, 0, np.zeros(sliding.n_states), torque[None])[1].full()[0]


def test_a_rotor_with_bristles_moves_as_radau_says() -> None:
    """Over pushes that stick, slip and turn back the velocity is right to 1e-3 of its peak; finer steps, better."""
    law, J = LUGRE.lugre, 20.0
    assert law is not None
    pushes = np.random.default_rng(1).normal(0, 80, 20)

    def rate(t: float, x: np.ndarray) -> list[float]:
        v, z = x
        g = LUGRE.coulomb + (LUGRE.break_away - LUGRE.coulomb) * math.exp(-((v / 0.02) ** 2))
        dz = v - law.stiffness * abs(v) * z / g
        friction = law.stiffness * z + law.damping * math.exp(-((v / 0.5) ** 2)) * dz
        return [(pushes[min(int(t / 0.05), 19)] - friction) / J, dz]

    x, found = np.zeros(2), []
    for i in range(20):
        x = solve_ivp(rate, (i * 0.05, (i + 1) * 0.05 - 1e-12), x, "Radau", rtol=1e-9, atol=1e-12).y[:, -1]
        found.append(x[0])
    truth = np.array(found)
    errors = []
    for steps in (100, 400):
        ends = moved(LUGRE, np.repeat(pushes, steps), 0.05 / steps)[steps - 1 :: steps]
        errors.append(np.abs(ends - truth).max() / np.abs(truth).max())
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 4


# --- controller -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "left"), [("pd", 1.0), ("cascade", 0.0)])
def test_a_cascade_leaves_no_error_under_a_constant_torque_and_pd_leaves_torque_over_kp(kind: str, left: float) -> None:
    """A ripple so slow that it is a constant torque pushes; the velocity loop's integral takes it up."""
    push = 3.0
    ripple = TorqueRippleSpec(push / 80.0, 1, phase=math.pi / 2 - 80 * ARM[0])
    spec = SimulatedSpec(controller=ControllerSpec(2.0, kind=kind), torque_ripple=(ripple,))  # type: ignore[arg-type]
    simulated = rig(arm(), spec, rms=1e-6)
    record = simulated.measure(simulated.experiments[0])
    model = serial(arm())
    from elastid.simulation.controller import tune

    kp = tune(model, equilibrium(model, model.theta, simulated.plan.configurations[0]).q, 2.0, 0.8).kp[0]
    # The motor turns by push / kp rad, 80 times as much on its own side, where the ripple's cosine has hardly fallen.
    np.testing.assert_allclose((record.y[-1, 0] - ARM[0]) * kp / push, left, atol=0.03)


# --- encoders and drives --------------------------------------------------------------------------------------------


def test_torque_is_clipped_at_its_limit_and_the_record_says_how_often() -> None:
    """Gravity takes 112 Nm; with 40 Nm rms of multisine a limit of 180 Nm is met now and then, and never exceeded."""
    limits = Limits(torque=180.0)
    record = rig(arm(limits), SimulatedSpec(saturation=True), rms=40.0).measure(plan(40.0).experiments[0])
    assert np.abs(record.u).max() == 180.0
    share = np.mean(np.abs(record.u) == 180.0)
    assert 0 < share < 0.5
    (note,) = said(record.notes)
    assert f"180 N*m in {share:.2%}" in note
    free = rig(arm(limits), rms=40.0).measure(plan(40.0).experiments[0])
    assert np.abs(free.u).max() > 180.0


def test_a_drive_that_is_always_at_its_limit_is_refused() -> None:
    """Where gravity takes more than the motor has, the run ends in words; so does clipping without limits."""
    simulated = rig(arm(Limits(torque=60.0, angle=(-3.0, 3.0))), SimulatedSpec(saturation=True), rms=1.0)
    with refused("experiment/diverged"):
        simulated.measure(simulated.experiments[0])
    simulated = rig(arm(), SimulatedSpec(saturation=True))
    with refused("experiment/simulated", place="experiment.simulated.saturation"):
        simulated.measure(simulated.experiments[0])


# --- noise ----------------------------------------------------------------------------------------------------------


def test_colored_noise_has_its_standard_deviation_and_its_slope() -> None:
    """The spectrum falls by the given dB a decade above the corner; white noise stays."""
    size = (60_000, 1000.0, 1)
    white = draw_noise(NoiseSpec(torque_std=1.0), *size, ("motor 1",), (1,))
    fall = ColoredNoiseSpec("disturbance", 2.0, corner_hz=5.0, slope=-40.0)
    rise = ColoredNoiseSpec("torque", 3.0, corner_hz=50.0, slope=20.0)
    both = draw_noise(NoiseSpec(torque_std=1.0, colored=(fall, rise)), *size, ("motor 1",), (1,))
    np.testing.assert_array_equal(both.outputs, white.outputs)
    np.testing.assert_allclose(both.disturbance.std(), 2.0, rtol=0.03)
    np.testing.assert_allclose((both.torque - white.torque).std(), 3.0, rtol=0.03)
    f, power = welch(both.disturbance[:, 0], 1000.0, nperseg=8192)
    level = [10 * np.log10(power[(f > low) & (f < 1.3 * low)].mean()) for low in (30.0, 300.0)]
    np.testing.assert_allclose(level[1] - level[0], -40.0, atol=1.5)


# --- the chain ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_the_sensor_filter_is_butterworths(order: int) -> None:
    """Of the corner 1 / (2 pi T), as scipy has it."""
    f, T = np.array([0.1, 1.0, 5.0, 20.0, 90.0]), 1 / (2 * np.pi * 20.0)
    (element,) = elements(Chain(sensor_lag=T, sensor_order=order))  # type: ignore[arg-type]
    b, a = butter(order, 2 * np.pi * 20.0, analog=True)
    np.testing.assert_allclose(element.response(2j * np.pi * f, T), freqs(b, a, 2 * np.pi * f)[1], rtol=1e-10)


@pytest.mark.parametrize("quantity", ["position", "acceleration"])
def test_the_state_space_holds_the_lags(quantity: str) -> None:
    """Its response is that of the kernel; a differentiator is refused."""
    model = serial(arm(chain=Chain(2e-3, 2, 0.6, 1.5e-3, 3)))
    point = linearise(model, Configuration("c1", np.array(ARM)), model.theta, ("motor 1",), quantity)  # type: ignore[arg-type]
    freq_hz = np.array([2.0, 11.0, 70.0])
    expected = frequency_response(point, point.theta_ref, freq_hz)
    np.testing.assert_allclose(state_space(point, point.theta_ref).response(freq_hz), expected, rtol=1e-9)
    model = serial(arm(chain=Chain(differentiator=1e-3)))
    point = linearise(model, Configuration("c1", np.array(ARM)), model.theta, ("motor 1",), "velocity")
    with refused("linear/state-space", place="chain.differentiator"):
        state_space(point, point.theta_ref)


# --- towards the linear model ---------------------------------------------------------------------------------------


def departure(robot: Robot, rms: float, reference: np.ndarray | None, **spec: object) -> tuple[np.ndarray, float]:
    """The response of the rig, and its rms relative distance from a reference response."""
    simulated = rig(robot, SimulatedSpec(**spec), rms=rms, runs=2)  # type: ignore[arg-type]
    G = response(simulated)
    return G, 0.0 if reference is None else float(np.sqrt(np.mean(np.abs(G / reference - 1) ** 2)))


def test_without_friction_the_response_tends_to_the_linear_one_with_the_square_of_the_amplitude() -> None:
    """Gravity bends with the angle; what is even in it misses the odd lines, so the error falls as amplitude^2."""
    least, _ = departure(arm(), 2.0, None)
    errors = [departure(arm(), rms, least)[1] for rms in (800.0, 400.0, 200.0)]
    rates = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    np.testing.assert_allclose(rates, 2.0, atol=0.15)
    freq_hz = plan(1.0).freq_hz
    np.testing.assert_allclose(least, linear(arm(), freq_hz), rtol=2e-3)


@pytest.mark.parametrize("kind", ["coulomb", "lugre"])
def test_with_friction_the_response_tends_to_the_linear_one_with_friction_over_amplitude(kind: str) -> None:
    """A joint that slides under its carrier: half the friction is half the error, for static and dynamic friction."""

    def robot(level: float) -> Robot:
        bristles = LuGre(40 * level, 0.02 * level, 5.0) if kind == "lugre" else None
        return arm(friction=Friction(level, lugre=bristles))

    carrier = CarrierSpec(0.02, cycles=1)
    none, _ = departure(arm(), 60.0, None, carrier=carrier, substeps=4)
    errors = [departure(robot(level), 60.0, none, carrier=carrier, substeps=4)[1] for level in (0.02, 0.01, 0.005)]
    rates = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    np.testing.assert_allclose(rates, 1.0, atol=0.25)
