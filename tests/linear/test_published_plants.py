"""Published plants with their printed numbers, and chains whose motion is known by thinking."""

from dataclasses import replace

import numpy as np
import pytest
from plants.zeros import antiresonances

from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Body, Joint, Motor, Robot, Spring

WEIGHTLESS = (0.0, 0.0, 0.0)


def linear(robot: Robot, angles=(0.0,), outputs=("motor 1",), quantity="acceleration") -> LinearModel:
    model = serial(robot)
    return linearise(model, Configuration("c", angles), model.theta, outputs, quantity)


def chain(motor: Motor, springs: list[Spring], inertias: list[float], viscous: float = 0.0) -> Robot:
    """A motor and masses one behind the other about one axis, a spring before each mass."""
    bodies, parent = [], "base"
    for i, (spring, inertia) in enumerate(zip(springs, inertias, strict=True), start=1):
        joint = Joint(str(i), spring=spring, motor=motor if i == 1 else None, viscous=viscous if i == 1 else 0.0)
        bodies.append(Body(f"mass{i}", parent, joints=(joint,), inertia=inertia))
        parent = f"mass{i}"
    return Robot("chain", tuple(bodies), gravity=WEIGHTLESS)


def three_mass() -> Robot:
    """Wernholt & Gunnarsson (2006), SYSID, pp. 143-148: the numbers of the public idnlgrey example."""
    J, a_m, a_g = 0.03291699877416, 0.17910964111956, 0.61206166914114
    motor = Motor(inertia=J * a_m, viscous=0.00986346744839)
    springs = [Spring(20.59269827430799, 0.06241814047290), Spring(20.23072060978318, 0.00987527995798)]
    return chain(motor, springs, [J * a_g, J * (1 - a_m - a_g)])


def four_mass(k1: float) -> LinearModel:
    """Moberg & Ohr (2005), IFAC World Congress: all on the motor side, every mass with viscous friction to ground."""
    springs = [Spring(k1, 0.08), Spring(110, 0.06), Spring(80, 0.08)]
    robot = chain(Motor(5e-3, viscous=6e-3), springs, [2e-3, 0.02, 0.02])
    model = linear(robot, outputs=("motor 1", "body mass1 z", "body mass2 z", "body mass3 z"))
    to_ground = model.C[1:]  # a joint's friction acts between its bodies; here each mass rubs on the ground
    return replace(model, D=model.D + 1e-3 * to_ground.T @ to_ground)


def test_three_mass_response_equals_published_numbers():
    """Torque to acceleration at 1, 5, 10, 20, 40 Hz to the digits printed."""
    model = linear(three_mass())
    G = frequency_response(model, model.theta_ref, np.array([1.0, 5, 10, 20, 40]))[:, 0, 0]
    printed = [28.926 + 1.3416j, -15.872 + 5.5897j, 162.796 + 67.747j, 217.161 + 31.446j, 179.105 + 9.520j]
    np.testing.assert_allclose(G, printed, rtol=0, atol=6e-4)


def test_three_mass_resonances_and_antiresonances_equal_published_numbers():
    """Frequencies and damping to the digits printed, and the slow real pole of the friction."""
    model = linear(three_mass())
    found = modes(model, model.theta_ref)
    np.testing.assert_allclose(found.freq_hz, [9.0439, 11.4776], rtol=0, atol=6e-5)
    np.testing.assert_allclose(found.zeta, [0.04479, 0.08247], rtol=0, atol=6e-6)
    np.testing.assert_allclose(found.real_poles, [0.0, -0.29968], rtol=0, atol=6e-6)
    freq_hz, zeta = antiresonances(model, "motor 1", "motor 1")
    np.testing.assert_allclose(freq_hz, [4.2283, 10.3902], rtol=0, atol=6e-5)
    np.testing.assert_allclose(zeta, [0.03726, 0.02332], rtol=0, atol=6e-6)


@pytest.mark.parametrize(
    ("k1", "resonances", "zeta", "zeros"),
    [
        (16.7, [8.816, 14.441, 41.613], [0.115, 0.066, 0.141], [2.912, 14.254, 41.627]),
        (58.35, [11.948, 17.176, 48.253], [0.041, 0.059, 0.131], [4.578, 14.941, 47.216]),
        (100, [12.403, 19.121, 54.664], [0.039, 0.047, 0.118], [5.255, 15.378, 52.321]),
    ],
)
def test_four_mass_benchmark_equals_published_numbers(k1, resonances, zeta, zeros):
    """Resonances, damping and antiresonances at three stiffnesses of the gear, to the digits printed."""
    model = four_mass(k1)
    found = modes(model, model.theta_ref)
    np.testing.assert_allclose(found.freq_hz, resonances, rtol=0, atol=6e-4)
    np.testing.assert_allclose(found.zeta, zeta, rtol=0, atol=6e-4)
    locked, _ = antiresonances(model, "motor 1", "motor 1")
    np.testing.assert_allclose(locked, zeros, rtol=0, atol=6e-4)
