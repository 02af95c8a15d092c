"""The motion of a measurement moves the robot out of its posture: closed forms, and one answer of all formulations."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm_modes import ARM
from plants.moved_posture import posture_effect
from plants.paths import ROBOTS

from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.motion_bias import estimate_motion_bias
from elastid.linear.response.transfer import to_response
from elastid.model.elastic import ElasticModel
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.response import MotorMotion
from elastid.robot import Body, Joint, Motor, Robot, Spring
from elastid.study import load_robot

FREQ = np.linspace(0.7, 12.3, 21)
OPEN = np.zeros((3, 1, 1))
# A pendulum of 8 kg, 0.5 m below its axis, which its motor drives without a gear.
PENDULUM = Robot(
    "pendulum",
    (Body("bob", joints=(Joint("1", "y", motor=Motor(0.5, 1.0, 3.0)),), mass=8, center_of_mass=(0, 0, -0.5)),),
)
WEIGHT = 8 * 9.81 * 0.5


def motion(
    rms: float, lines: tuple[float, ...], mean: float = np.nan, feedback: np.ndarray | None = None
) -> MotorMotion:
    """Of motor 1, the same power at each line."""
    power = np.full((len(lines), 1, 1), rms**2 / len(lines), complex)
    return MotorMotion(("motor 1",), np.array(lines), power, np.array([mean]), feedback)


def linear_of(robot: Robot, angles: tuple[float, ...], form: str | None = None) -> tuple[ElasticModel, LinearModel]:
    linearisation = Linearisation.of_robot(robot, ModelSpec(form))
    model, posture = linearisation.model, Configuration("c", angles)
    return model, linearisation.at(posture, model.theta, model.inputs, "position")


def test_gravity_softens_as_a_hanging_pendulum_swings() -> None:
    """E[cos e] = 1 - rms^2 / 2: m g c of less stiffness, at every frequency, as statistical linearisation has it."""
    model, linear = linear_of(PENDULUM, (0.0,))
    rms = 0.02
    effect = posture_effect(model, linear, linear.theta_ref, motion(rms, (0.55, 1.4, 3.1), 0.0, OPEN), FREQ)
    softer = replace(linear, K=linear.K - WEIGHT * rms**2 / 2)
    expected = to_response(softer, linear.theta_ref, FREQ).G - to_response(linear, linear.theta_ref, FREQ).G
    np.testing.assert_allclose(effect, expected, rtol=1e-3)


def test_sums_and_differences_of_lines_meet_the_motion_again() -> None:
    """A pendulum that leans: the curvature of its gravity twice, and between them the pendulum at omega +- omega_k."""
    angle, rms, lines = 0.9, 0.01, (0.55, 1.4)
    model, linear = linear_of(PENDULUM, (angle,))
    effect = posture_effect(model, linear, linear.theta_ref, motion(rms, lines, angle, OPEN), FREQ)
    (M,), (D,), (K,) = linear.M[0], linear.D[0], linear.K[0]

    def L(omega: np.ndarray) -> np.ndarray:
        return K + 1j * omega * D - omega**2 * M

    omega, curvature = 2 * np.pi * FREQ, -WEIGHT * np.sin(angle)
    change = -WEIGHT * np.cos(angle) * rms**2 / 2 + 0j * omega
    for line in 2 * np.pi * np.array([*lines, *lines]) * [1, 1, -1, -1]:
        change -= curvature**2 * rms**2 / 4 / L(omega + line)
    np.testing.assert_allclose(effect[:, 0, 0], 1 / (L(omega) + change) - 1 / L(omega), rtol=1e-3)


def test_deflected_posture_is_at_measured_motor_angle() -> None:
    """Of a mean 1 mrad off the configuration: gravity's stiffness there, to first order; 0.1 rad is another zero."""
    angle, shift = 0.9, 1e-3
    model, linear = linear_of(PENDULUM, (angle,))
    _, there = linear_of(PENDULUM, (angle + shift,))
    kept, moved, other = (
        posture_effect(model, linear, linear.theta_ref, motion(0.01, (1.4,), angle + by), FREQ)
        for by in (0.0, shift, 0.1)
    )
    expected = to_response(there, linear.theta_ref, FREQ).G - to_response(linear, linear.theta_ref, FREQ).G
    np.testing.assert_allclose(moved - kept, expected, rtol=1e-2)
    np.testing.assert_array_equal(other, kept)


def test_cubic_gear_stiffens_by_three_mean_squares() -> None:
    """The linearisation of a Duffing spring, k + 3 k_3 sigma^2, of the deflection that goes with the motor's motion."""
    k, cubic, inertia = 2e4, 4e8, 3.0
    joint = Joint("1", "z", Spring(k, 5.0, cubic=cubic), Motor(4.0, 1.0, 10.0))
    robot = Robot("gear", (Body("disc", joints=(joint,), inertia=inertia),), gravity=(0, 0, 0))
    model, linear = linear_of(robot, (0.0,))
    line, rms = 5.0, 2e-3
    effect = posture_effect(model, linear, linear.theta_ref, motion(rms, (line,), 0.0, OPEN), FREQ)
    s = 2j * np.pi * line
    sigma = rms * abs(1 - (k + 5 * s) / (inertia * s**2 + 5 * s + k))
    stiffer = np.array([[1.0, -1.0], [-1.0, 1.0]]) * 3 * cubic * sigma**2
    models = (replace(linear, K=linear.K + stiffer), linear)
    expected = np.subtract(*(to_response(each, linear.theta_ref, FREQ).G for each in models))
    np.testing.assert_allclose(effect, expected, rtol=1e-6)


@pytest.mark.parametrize("feedback", [False, True])
def test_multipliers_and_minimal_coordinates_say_the_same_of_a_loop(feedback: bool) -> None:
    """The linkage's rod as a constraint that turns and stretches, and cut: of two sums of terms that differ widely."""
    robot = load_robot(ROBOTS / "linkage_arm.yml")
    lines, effects = np.array([0.5, 3.0, 7.5, 12.0]), []
    power = np.tile(np.array([[1, 0.3 + 0.2j], [0.3 - 0.2j, 0.8]]) * 1e-4 / len(lines), (len(lines), 1, 1))
    F = np.stack([np.diag([50.0, 20]), np.diag([6600.0, 3300]), np.diag([1100.0, 560])]) if feedback else None
    motion = MotorMotion(("motor 2", "motor 3"), lines, power, np.array([0.5, -0.1]), F)
    for form in ("constrained", "minimal"):
        model, linear = linear_of(robot, (0.5, -0.1), form)
        effects.append(posture_effect(model, linear, linear.theta_ref, motion, FREQ))
    np.testing.assert_allclose(effects[0], effects[1], atol=1e-4 * np.abs(effects[1]).max())
    assert np.abs(effects[0]).max() > 0


def beyond_scatter(
    robot: Robot, experiment: ExperimentSpec, excitation: MultisineSpec
) -> tuple[np.ndarray, np.ndarray]:
    """Median of |error|^2 over variance (n_y, n_u) of records without noise, with the effect left in, and taken out."""
    plan = make_plan(excitation, experiment, robot, 1)
    rig = SimulatedRig(robot, experiment, plan, 1)
    spec = EstimatorSpec(friction="none")
    response = estimate([rig.measure(each) for each in rig.experiments], spec, plan.lines)
    linearisation = Linearisation.of_robot(robot)
    linear = linearisation.at(response.configuration, linearisation.model.theta, response.outputs, "acceleration")
    linear = replace(linear, hold=response.hold)
    rest = to_response(linear, linear.theta_ref, response.freq_hz).G
    effect = estimate_motion_bias(linearisation.model, linear, linear.theta_ref, response)
    assert effect is not None
    variance = response.total.variance
    left_in, taken = (np.median(np.abs(response.G - rest - each) ** 2 / variance, axis=0) for each in (0.0, effect))
    return left_in, taken


@pytest.mark.slow
def test_records_of_moving_arm_show_motion_bias() -> None:
    """Three axes and a link that bends and twists; a point's acceleration along an axis, and an accelerometer's."""
    outputs = (*ARM.motor_locations, "frame tool z", "accelerometer tool x")
    simulated = SimulatedSpec(outputs=outputs, compiled=True)
    experiment = ExperimentSpec(configurations={"c": (0.4, 0.3, -0.2)}, realisations=8, simulated=simulated)
    excitation = MultisineSpec(rate_hz=1000, period=1, band_hz=(3, 60), grid="odd", torque_rms=(900, 900, 500))
    left_in, taken = beyond_scatter(ARM, experiment, excitation)
    assert left_in[0, 0] > 30.0
    assert left_in[3:].max() > 4.0
    assert taken.max() < 2.0
