"""The torque of a multisine part by part, and the twin along a record: with the true numbers it is off by the noise."""

from dataclasses import replace

import numpy as np
import pytest
from plants.random_plants import periods_of

from elastid.experiment.plan.plan import Plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, NoiseSpec, SimulatedSpec
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linear_model import LinearModel
from elastid.linear.response.transfer import frequency_response
from elastid.parameters import DELAY
from elastid.record import Configuration, Record
from elastid.robot import Body, Friction, Joint, LuGre, Motor, Robot, Spring
from elastid.validation.log_comparison import DRY, ELASTICITY, LINK, MOTION, RIGID_BODY, TORQUE, VISCOUS, LogSimulation
from elastid.validation.simulation import simulate_record
from elastid.validation.torque_balance import elastic_balances

RATE_HZ, N = 500.0, 1000
J_MOTOR, J_LINK, K, VISCOUS_COEFFICIENT, DRY_SHARE = 3.0, 6.0, 2e4, 40.0, 0.1


def one_joint(viscous: float) -> LinearModel:
    """A motor and a link on a spring."""
    spring = K * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return LinearModel(
        Configuration("c1", np.zeros(1)), (DELAY,), np.zeros(1), np.diag([J_MOTOR, J_LINK]), np.diag([viscous, 0.0]),
        spring, {}, np.eye(2)[:, :1], np.eye(2)[:1], ("motor 1",), ("motor 1",), "acceleration",
    )  # fmt: skip


def test_parts_of_a_known_joint_have_their_torque() -> None:
    """Rigid: (J_m + J_l) a; viscous: f v; elasticity the rest of the model; dry friction what the net record lacks."""
    whole, frictionless = one_joint(VISCOUS_COEFFICIENT), one_joint(0.0)
    alone = replace(
        whole, M=np.array([[J_MOTOR + J_LINK]]), D=np.zeros((1, 1)), K=np.zeros((1, 1)), B=np.eye(1), C=np.eye(1),
        T=None, Z=None,
    )  # fmt: skip
    lines = np.arange(4, 61)
    freq_hz = lines * RATE_HZ / N
    rng = np.random.default_rng(0)
    U = np.exp(2j * np.pi * rng.uniform(size=len(lines)))
    Y = frequency_response(whole, np.zeros(1), freq_hz)[:, 0, 0] * U

    velocity = Y / (2j * np.pi * freq_hz)
    u, a, v = periods_of(lines, N, 3, *(X[:, None] for X in (U, Y, velocity)))
    net = Record("r", whole.configuration, 0, 0, RATE_HZ, N, ("motor 1",), ("motor 1",), ("acceleration",), u, a)
    record = replace(net, u=(1 + DRY_SHARE) * net.u)
    theta = np.zeros(1)
    parts = (whole, theta), (frictionless, theta), (alone, theta)
    (found,) = elastic_balances(record, net, parts, freq_hz, EstimatorSpec(transient_periods=1))
    assert found.parts == (RIGID_BODY, ELASTICITY, VISCOUS, DRY)
    np.testing.assert_allclose(found.torques[0], (J_MOTOR + J_LINK) * a[:N, 0], atol=1e-9)
    np.testing.assert_allclose(found.torques[2], VISCOUS_COEFFICIENT * v[:N, 0], atol=1e-9)
    np.testing.assert_allclose(found.torques[3], DRY_SHARE * net.u[:N, 0], atol=1e-9)
    assert sum(found.fractions) == pytest.approx(1.0)
    assert found.unexplained_fraction == pytest.approx(0.0, abs=1e-12)
    assert elastic_balances(record, net, parts, freq_hz, EstimatorSpec(transient_periods=2)) == ()


TORQUE_STD, ANGLE_STD = 0.5, 2e-6
BAND_HZ = (2.0, 45.0)
PERIOD, RATE_HZ = 1000, 500.0


def arm(friction: Friction = Friction(0.08)) -> Robot:  # noqa: B008
    """A pendulum on an elastic joint, with friction at its motor: 8 Nm on the link side."""
    joint = Joint("1", "y", Spring(3e4, 15.0), Motor(2e-4, 100.0, viscous=1e-3, friction=friction))
    body = Body("link", joints=(joint,), mass=12, center_of_mass=(0, 0, -0.4), inertia=0.5)
    return Robot("arm", (body,), gravity=(0.0, 0.0, -9.81))


def rig_of(robot: Robot) -> SimulatedRig:
    """One experiment of odd lines, over a slow movement so that friction slides, with noise of torque and angles."""
    lines = np.arange(9, 90, 2)
    phases = np.exp(2j * np.pi * np.random.default_rng(3).random(len(lines)))
    R = (60.0 / np.sqrt(len(lines) / 2) * phases)[None, None, None, :, None]
    plan = Plan((Configuration("c1", np.array([0.3])),), ("motor 1",), RATE_HZ, PERIOD, 2, 2, lines, R)
    spec = SimulatedSpec(
        outputs=("motor 1", "joint 1"),
        carrier=CarrierSpec(amplitude=0.02, cycles=2),
        substeps=4,
        noise=NoiseSpec(torque_std=TORQUE_STD, angle_std=ANGLE_STD),
    )
    return SimulatedRig(robot, ExperimentSpec({"c1": (0.3,)}, simulated=spec), plan, 1)


@pytest.fixture(scope="module")
def measured() -> tuple[SimulatedRig, Record]:
    rig = rig_of(arm())
    return rig, rig.measure(rig.experiments[0])


def errors(run: LogSimulation) -> dict[str, float]:
    return {signal.kind: signal.error for signal in run.signals}


def test_the_true_twin_is_off_by_the_noise(measured: tuple[SimulatedRig, Record]) -> None:
    """Motions by what the noise of the torque moves, held on the log by a slow loop."""
    _, record = measured
    (run,) = simulate_record(record, arm(), BAND_HZ)
    assert run.drive == "torque"
    inside = slice(int(BAND_HZ[0] * PERIOD / RATE_HZ), int(BAND_HZ[1] * PERIOD / RATE_HZ) + 1)
    power = 2 * np.abs(np.fft.rfft(record.u[-PERIOD:, 0])[inside] / PERIOD) ** 2
    expected = TORQUE_STD * np.sqrt(2 * len(power) / PERIOD / np.sum(power))  # noise over torque, both within the band
    assert errors(run)[TORQUE] < expected
    assert errors(run)[MOTION] < 5 * expected
    assert errors(run)[LINK] < 5 * expected
    assert run.tracking_bandwidth_hz == pytest.approx(0.4)


def test_bristles_and_aperiodic_record_are_simulated() -> None:
    """LuGre's law under the torque, from the middle of a motion on: friction has slid so for long."""
    bristly = arm(friction=Friction(0.08, lugre=LuGre(30.0, 0.02)))
    rig = rig_of(bristly)
    record = rig.measure(rig.experiments[0])
    (periodic,) = simulate_record(record, bristly, BAND_HZ)
    assert errors(periodic)[MOTION] < 0.02
    (once,) = simulate_record(replace(record, is_periodic=False, period_samples=record.n_samples), bristly, BAND_HZ)
    assert once.seconds == record.n_samples / RATE_HZ
    # Speed and deflection of the link are not in the log, and what they begin with fades slowly.
    assert errors(once)[MOTION] < 0.2


def test_too_fast_simulation_is_called_lost(measured: tuple[SimulatedRig, Record]) -> None:
    """Stiff friction takes more steps in a sample than are affordable; without a rate nothing is simulated."""
    _, record = measured
    assert simulate_record(replace(record, has_rate=False), arm(), BAND_HZ) == ()
    (stiff,) = simulate_record(record, arm(friction=Friction(8.0)), BAND_HZ)
    assert stiff.lost
    assert not stiff.signals
