"""Elements of the measurement chain: their responses by hand, and the slopes of their logarithms by differences."""

import numpy as np
import pytest

from elastid.linear.measurement_chain import BUTTERWORTH, DifferenceElement, LagElement, elements
from elastid.robot import Chain

S = 2j * np.pi * np.array([0.01, 1.0, 8.0, 60.0])
T = 3e-3
ELEMENTS = [*(LagElement("lag", p) for p in (*BUTTERWORTH.values(), (1.4, 1.0))), DifferenceElement("difference")]


@pytest.mark.parametrize("element", ELEMENTS)
def test_slopes_of_the_logarithm_equal_differences(element):
    """d ln H / dT at lines where s T is tiny and where it is of order one."""
    h = 1e-4 * T
    difference = (np.log(element.response(S, T + h)) - np.log(element.response(S, T - h))) / (2 * h)
    np.testing.assert_allclose(element.log_slope(S, T), difference, rtol=1e-6)


@pytest.mark.parametrize("order", BUTTERWORTH)
def test_a_butterworth_filter_is_flat_and_at_half_power_at_its_corner(order):
    """|H(j w T)|^2 = 1 / (1 + (w T)^(2 n))."""
    w = np.array([0.1, 1.0, 3.0])
    H = LagElement("lag", BUTTERWORTH[order]).response(1j * w / T, T)
    np.testing.assert_allclose(np.abs(H) ** 2, 1 / (1 + w ** (2 * order)), rtol=1e-12)


def test_a_difference_over_a_time_is_the_mean_of_the_derivative():
    """(x(t) - x(t - T)) / T of e^(s t), over its derivative s e^(s t)."""
    np.testing.assert_allclose(DifferenceElement("d").response(S, T), (1 - np.exp(-S * T)) / (S * T), rtol=1e-9)


def test_the_elements_of_a_chain_are_those_it_has_torque_before_sensor():
    found = elements(Chain(torque_lag=1e-3, torque_order=2, torque_damping=0.6, sensor_lag=2e-3, sensor_order=3))
    assert found == (LagElement("torque_lag", (1.2, 1.0)), LagElement("sensor_lag", BUTTERWORTH[3]))
    assert elements(Chain()) == ()
