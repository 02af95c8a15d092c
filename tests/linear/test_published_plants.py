"""Published plants with their printed numbers, and chains whose motion is known by thinking."""

from dataclasses import replace

import numpy as np
import pytest
from plants.paths import ROBOTS

from elastid.base.arrays import FloatArray
from elastid.linear.linear_model import LinearModel, state_space
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.study import load_robot


def linear(robot: Robot, outputs=("motor 1",)) -> LinearModel:
    model = serial(robot)
    return linearise(model, Configuration("c", (0.0,)), model.theta, outputs, "acceleration")


# Wernholt & Gunnarsson (2006), SYSID, pp. 143-148: the inertias of the public idnlgrey example to all digits.
J, A_M, A_G = 0.03291699877416, 0.17910964111956, 0.61206166914114
EXACT = {"Jm_1": J * A_M, "I_gearbox": J * A_G, "I_arm": J * (1 - A_M - A_G)}
THREE_MASSES = load_robot(ROBOTS / "three_mass_axis.yml").with_parameters(EXACT)


def four_masses(k_1: float) -> LinearModel:
    """Moberg & Ohr (2005), IFAC World Congress: all on the motor side, every mass with viscous friction to ground."""
    robot = load_robot(ROBOTS / "four_mass_benchmark.yml").with_parameters({"k_1": k_1, "f_1": 0.0})
    model = linear(robot, outputs=("motor 1", "body a1 z", "body a2 z", "body a3 z"))
    to_ground = model.C[1:]  # a joint's friction acts between its bodies; here each mass rubs on the ground
    return replace(model, D=model.D + 1e-3 * to_ground.T @ to_ground)


def antiresonances(model: LinearModel) -> tuple[FloatArray, FloatArray]:
    """Of the motor: frequencies in Hz, rising, and damping ratios at theta_ref, by python-control.

    Those beyond ten times the last pole are infinite.
    """
    system = state_space(replace(model, quantity="position"), model.theta_ref).to_control()
    element = system[model.outputs.index("motor 1"), 0]
    zeros, most = element.zeros(), 10 * np.abs(element.poles()).max()
    zeros = zeros[(zeros.imag > 1e-6 * most) & (np.abs(zeros) < most)]
    zeros = zeros[np.argsort(np.abs(zeros))]
    return np.abs(zeros) / (2 * np.pi), -zeros.real / np.abs(zeros)


def test_three_mass_response_equals_published_numbers():
    """Torque to acceleration at 1, 5, 10, 20, 40 Hz to the digits printed."""
    model = linear(THREE_MASSES)
    G = frequency_response(model, model.theta_ref, np.array([1.0, 5, 10, 20, 40]))[:, 0, 0]
    printed = [28.926 + 1.3416j, -15.872 + 5.5897j, 162.796 + 67.747j, 217.161 + 31.446j, 179.105 + 9.520j]
    np.testing.assert_allclose(G, printed, rtol=0, atol=6e-4)


def test_three_mass_resonances_and_antiresonances_equal_published_numbers():
    """Frequencies and damping to the digits printed, and the slow real pole of the friction."""
    model = linear(THREE_MASSES)
    found = modes(model, model.theta_ref)
    np.testing.assert_allclose(found.freq_hz, [9.0439, 11.4776], rtol=0, atol=6e-5)
    np.testing.assert_allclose(found.zeta, [0.04479, 0.08247], rtol=0, atol=6e-6)
    np.testing.assert_allclose(found.real_poles, [0.0, -0.29968], rtol=0, atol=6e-6)
    assert found.real_poles[0] == 0  # the rigid body, to the last digit
    poles = state_space(replace(model, quantity="position"), model.theta_ref).to_control().poles()
    np.testing.assert_allclose(found.poles, sorted(poles[poles.imag > 1], key=abs), rtol=1e-6)
    np.testing.assert_allclose(found.shapes[np.abs(found.shapes).argmax(axis=0), [0, 1]], 1.0)
    freq_hz, zeta = antiresonances(model)
    np.testing.assert_allclose(freq_hz, [4.2283, 10.3902], rtol=0, atol=6e-5)
    np.testing.assert_allclose(zeta, [0.03726, 0.02332], rtol=0, atol=6e-6)


@pytest.mark.parametrize(
    ("k_1", "resonances", "zeta", "zeros"),
    [
        (16.7, [8.816, 14.441, 41.613], [0.115, 0.066, 0.141], [2.912, 14.254, 41.627]),
        (58.35, [11.948, 17.176, 48.253], [0.041, 0.059, 0.131], [4.578, 14.941, 47.216]),
        (100, [12.403, 19.121, 54.664], [0.039, 0.047, 0.118], [5.255, 15.378, 52.321]),
    ],
)
def test_four_mass_benchmark_equals_published_numbers(k_1, resonances, zeta, zeros):
    """Resonances, damping and antiresonances at three stiffnesses of the gear, to the digits printed."""
    model = four_masses(k_1)
    found = modes(model, model.theta_ref)
    np.testing.assert_allclose(found.freq_hz, resonances, rtol=0, atol=6e-4)
    np.testing.assert_allclose(found.zeta, zeta, rtol=0, atol=6e-4)
    locked, _ = antiresonances(model)
    np.testing.assert_allclose(locked, zeros, rtol=0, atol=6e-4)
