"""Elements of the measurement chain: their responses by hand, and the slopes of their logarithms by differences."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from plants.elastic_arm import arm
from plants.linkages import linkage

from elastid.linear.linear_model import DifferenceElement, LagElement, LinearModel, butterworth, elements, state_space
from elastid.linear.linearise import Linearisation
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import formulate, serial
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Chain, Channel, Frame, Placement, Rod

S = 2j * np.pi * np.array([0.01, 1.0, 8.0, 60.0])
T = 3e-3
ELEMENTS = [*(LagElement("lag", p) for p in (butterworth(3), butterworth(4), (1.4, 1.0))), DifferenceElement("d")]


@pytest.mark.parametrize("element", ELEMENTS)
def test_slopes_of_the_logarithm_equal_differences(element):
    """d ln H / dT at lines where s T is tiny and where it is of order one."""
    h = 1e-4 * T
    difference = (np.log(element.response(S, T + h)) - np.log(element.response(S, T - h))) / (2 * h)
    np.testing.assert_allclose(element.log_slope(S, T), difference, rtol=1e-6)


@pytest.mark.parametrize(
    ("chain", "by_hand"),
    [
        (Chain(torque_lag=T), 1 / (1 + S * T)),
        (Chain(torque_lag=T, torque_order=2, torque_damping=0.4), 1 / (1 + 0.8 * S * T + (S * T) ** 2)),
        (Chain(sensor_lag=T, sensor_order=2), 1 / (1 + 2**0.5 * S * T + (S * T) ** 2)),
        (Chain(differentiator=T), (1 - np.exp(-S * T)) / (S * T)),
    ],
)
def test_an_element_of_a_chain_has_its_response(chain, by_hand):
    (element,) = elements(chain)
    np.testing.assert_allclose(element.response(S, T), by_hand, rtol=1e-9)


FREQ_HZ = np.linspace(3.0, 40.0, 9)
GAINS = (Channel("y", "body fore y", 1.3), Channel("y", "motor 1", 0.9), Channel("u", "motor 2", 1.1))


def linear(gains: tuple[Channel, ...]) -> LinearModel:
    """Two motors and the rotation of the fore arm, per motor torque, in a bent posture."""
    model = serial(replace(arm(), chain=Chain(channels=gains)))
    outputs = ("motor 1", "motor 2", "body fore y")
    return Linearisation.of(model).at(Configuration("c1", (0.3, -0.5)), model.theta, outputs, "acceleration")


def test_gains_multiply_rows_and_divide_columns_of_a_response() -> None:
    """By the formula, by the kernel and by the state space; motor 2 and motor 1 as output and input are apart."""
    model, calibrated = linear(GAINS), linear(())
    G = frequency_response(calibrated, calibrated.theta_ref, FREQ_HZ)
    expected = G * np.array([[0.9], [1.0], [1.3]]) / np.array([1.0, 1.1])
    theta = model.theta_ref
    space = state_space(model, theta).response(FREQ_HZ)
    for found in (frequency_response(model, theta, FREQ_HZ), Kernel(model, FREQ_HZ, ()).response(theta), space):
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-12 * np.abs(G).max())


@pytest.mark.parametrize("equations", ["constrained", "minimal"])
def test_slopes_follow_geometry_of_a_closed_loop(equations: str) -> None:
    """Planar four-bar under gravity: slopes change responses as central differences of linearisations do."""
    tool = Frame("tool", "upper", Placement((0.9, 0.0, 0.1)))
    robot = replace(linkage(Rod(0.86, 6.2, 0.4, 0.5), crank=0.33), frames=(tool,))
    model, place = formulate(robot, ModelSpec(equations), robot.geometry), Configuration("c", (0.2, 0.1))
    linearisation, outputs = Linearisation.of(model), ("accelerometer tool z", "frame tool x", "motor 2")

    def at(theta: np.ndarray) -> np.ndarray:
        there = linearisation.at(place, theta[:-1], outputs, "acceleration")
        return frequency_response(there, theta, FREQ_HZ)

    linear = linearisation.at(place, model.theta, outputs, "acceleration")
    for name in ("p_lower_z", "pj_2_x", "p_end_z", "zero_3", "p_upper_x", "p1_rod_x", "p2_rod_z", "l_rod", "m_upper"):
        step = 1e-5 * (np.array(linear.parameters) == name)
        by_slopes, difference = (
            response(linear.theta_ref + step) - response(linear.theta_ref - step)
            for response in (partial(frequency_response, linear, freq_hz=FREQ_HZ), at)
        )
        assert np.abs(by_slopes - difference).max() < 1e-5 * np.abs(difference).max(), name
