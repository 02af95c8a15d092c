"""Responses to references: closed form of one joint, and derivatives by differences."""

from dataclasses import replace

import numpy as np
import pytest
from plants.referenced_joint import RATE, ReferencedJoint

from elastid.fit.problem.frf_residuals import linear_model
from elastid.linear.linearise import Linearisation
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import frequency_response
from elastid.record import Configuration, JointLoop, ReferenceLoop, ZohTorque, unit_delay
from elastid.response import Response
from elastid.robot import Body, Chain, Joint, Motor, Placement, Robot, Spring

FREQ_HZ = np.linspace(1.0, 60.0, 30)
NUMBERS = ("delay_r", "low_pass_r", "gain_kp_motor_1", "gain_kd_motor_1", "gain_r_motor_1", "delay_y_motor_1")


def measured(motors, kp, kd, inputs, outputs, forward=0.0, quantity="position"):
    """A response to references on FREQ_HZ, without its values."""
    loop = JointLoop(np.array(kp), np.array(kd), np.zeros(len(motors)))
    parts, delay = (replace(loop, kd=0 * loop.kd), replace(loop, kp=0 * loop.kp)), unit_delay(FREQ_HZ, RATE)
    shares = [part.response(delay, RATE) for part in parts]
    feedforward = np.stack([shares[0], forward * shares[1]])
    controller = ReferenceLoop(motors, RATE, FREQ_HZ, np.stack(shares), feedforward)
    hold = ZohTorque((RATE,) * len(motors), tuple(place.startswith(("motor", "joint")) for place in outputs))
    G = np.zeros((len(FREQ_HZ), len(outputs), len(inputs)), complex)
    posture = Configuration("c", np.linspace(0.3, 0.8, len(motors)))
    return Response(FREQ_HZ, G, inputs, outputs, quantity, posture, controller=controller, hold=hold)


@pytest.mark.parametrize("forward", [0.0, 0.7])
def test_closed_loop_of_two_masses_is_exact(forward: float) -> None:
    """Motor and load of the exactly discretised plant under a sampled PD controller, to the images of the hold."""
    truth = ReferencedJoint(forward=forward, delay_s=3.7e-3)
    spring, motor = Spring(truth.k, truth.d), Motor(truth.motor, 1.0, truth.fm)
    robot = Robot("joint", (Body("load", joints=(Joint("1", "z", motor=motor, spring=spring),), inertia=truth.load),))
    response = measured(("motor 1",), [truth.kp], [truth.kd], ("reference 1",), ("motor 1", "joint 1"), forward=forward)
    linearisation = Linearisation.of_robot(robot, geometry=("delay_r",))
    theta = np.append(linearisation.model.theta, 0.0)
    theta[linearisation.parameters.index("delay_r")] = truth.delay_s
    T = frequency_response(linear_model(linearisation, response, theta), theta, FREQ_HZ)
    for row in (0, 1):
        assert np.abs(T[:, row, 0] / truth.response(FREQ_HZ, row) - 1).max() < 1e-6


@pytest.mark.parametrize("inputs", [("reference 1", "reference 2"), ("reference 2",)])
def test_derivatives_of_closed_loops_are_differences(inputs: tuple[str, ...]) -> None:
    """Of springs, inertias, delays, gains of the controllers and lags, for a tool behind two coupled joints."""
    joints = [Joint(f"{i}", "y", motor=Motor(0.01 / i, 10.0, 0.01), spring=Spring(2e3 / i, 2.0 / i)) for i in (1, 2)]
    arm = {"center_of_mass": (0.2, 0.0, 0.0), "inertia": 0.3}
    bodies = (
        Body("a", joints=(joints[0],), mass=5.0, **arm),
        Body("b", "a", Placement((0.5, 0.0, 0.0)), joints=(joints[1],), mass=3.0, **arm),
    )
    robot = Robot("arm", bodies, chain=Chain(torque_lag=3e-4))
    response = measured(
        ("motor 1", "motor 2"), [2e3, 8e2], [60.0, 25.0], inputs, ("motor 1", "joint 2"), 0.3, "acceleration"
    )
    linearisation = Linearisation.of_robot(robot, geometry=NUMBERS)
    names = (*linearisation.parameters, "delay")
    values = dict(zip((*NUMBERS, "delay"), (4e-3, 1e-3, 1.1, 0.9, 1.05, 1e-3, 5e-4), strict=True))
    theta = np.append(linearisation.model.theta, 0.0)
    theta[[names.index(name) for name in values]] = list(values.values())
    model = linear_model(linearisation, response, theta)
    wanted = tuple(name for name in names if name in (*values, "k_1", "d_2", "Jm_1", "fm_2", "m_b", "torque_lag"))
    kernel = Kernel(model, FREQ_HZ, wanted)
    T, dT = Columns(kernel).evaluate(theta)
    assert np.abs(T - frequency_response(model, theta, FREQ_HZ)).max() < 1e-12 * np.abs(T).max()
    for name, derivative in zip(wanted, dT, strict=True):
        step = np.zeros_like(theta)
        step[names.index(name)] = 1e-6 * max(abs(theta[names.index(name)]), 1e-3)
        difference = (kernel.response(theta + step) - kernel.response(theta - step)) / (2 * step.sum())
        size = max(float(np.abs(difference).max()), 1e-12)
        assert np.abs(derivative - difference).max() < 1e-6 * size, name
