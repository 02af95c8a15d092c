"""The model of one posture: numbers as functions of the fit, doubts, ports, an integral in its state space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.predicted_arm import result

from elastid.linear.fitted_model import Doubt
from elastid.record import JointLoop

ANGLES = [0.3, 0.7]


def test_numbers_follow_the_fit_and_their_slopes_are_those_of_differences() -> None:
    """Parameters of the fit, and a held mass that a doubt moves by a factor."""
    own = result()
    doubt = Doubt(np.array([0.03, -0.02, 0.0, 0.01]), ("m_fore", "c_fore_x"), (0.1, 5e-3), (True, False))
    model = own.at(ANGLES)
    estimated = replace(model.estimated, doubts=(doubt,))
    theta = estimated.theta(estimated.x)
    np.testing.assert_allclose(theta, model.estimated.theta(model.estimated.x), rtol=1e-12)
    assert len(estimated.x) == len(own.x) + 1
    assert estimated.covariance[-1, -1] == 1.0
    for i in range(len(estimated.x)):
        step = 1e-6 * np.eye(len(estimated.x))[i]
        slope = (estimated.theta(estimated.x + step) - estimated.theta(estimated.x - step)) / 2e-6
        np.testing.assert_allclose(estimated.slopes[:, i], slope, rtol=1e-6, atol=1e-6)
    moved = estimated.theta(estimated.x + np.eye(len(estimated.x))[-1])
    place = estimated.names.index("m_fore")
    assert moved[place] == pytest.approx(np.exp(0.1) * theta[place])


def test_matrices_are_symmetric_and_forces_work_on_the_motion_they_are_at() -> None:
    """M, D, K of what moves; B of `force tool x` is C of `frame tool x` transposed, Maxwell's reciprocity."""
    ports = [f"force tool {axis}" for axis in "xyz"]
    model = result().at(ANGLES, ports, [f"frame tool {axis}" for axis in "xyz"])
    A = model.linear
    for matrix in (A.M, A.D, A.K):
        np.testing.assert_allclose(matrix, matrix.T, rtol=1e-12)
    np.testing.assert_allclose(A.B, A.C.T, rtol=1e-12, atol=1e-15)
    G = model.response(np.array([3.0, 17.0])).G
    np.testing.assert_allclose(G, G.transpose(0, 2, 1), rtol=1e-10, atol=1e-16)


def test_an_integral_is_a_further_state() -> None:
    """The response by three states a coordinate is that by (s^2 M + s D + K + Delta / s)^-1."""
    loop = JointLoop(np.full(2, 4e4), np.full(2, 8e2), np.full(2, 3.0))
    model = result().at(ANGLES, ["motor 1", "force tool z"], ["motor 2", "frame tool z"], motors="controlled",
                        controller=loop)  # fmt: skip
    lines = np.array([0.3, 2.0, 20.0])
    system = model.state_space()
    assert len(system.A) == 3 * model.linear.n
    np.testing.assert_allclose(system.response(lines), model.response(lines).G, rtol=1e-8, atol=1e-18)


def test_a_controller_acts_on_the_motors_as_its_transfer_function() -> None:
    """(kp + s kd) (1 + ki / s) beside the impedance of the robot whose motors are free."""
    kp, kd, ki = np.array([4e4, 3e4]), np.array([8e2, 5e2]), np.array([30.0, 50.0])
    motors, lines = ["motor 1", "motor 2"], np.array([0.3, 2.0, 20.0])
    held = result().at(ANGLES, motors, motors, motors="controlled", controller=JointLoop(kp, kd, ki))
    A = result().at(ANGLES, motors, motors, motors="free").linear
    for G, s in zip(held.response(lines).G, 2j * np.pi * lines, strict=True):
        loop = (A.B * ((kp + s * kd) * (1 + ki / s))) @ A.B.T
        Z = s**2 * A.M + s * A.D + A.K + loop
        np.testing.assert_allclose(G, A.C @ np.linalg.solve(Z, A.B), rtol=1e-9)
