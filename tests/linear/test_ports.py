"""Forces at frames as inputs of a linear model: equations of their own, and derivatives by differences."""

from dataclasses import replace

import numpy as np
import pytest
from plants import elastic_arm
from plants.outside_arm import Outside

from elastid.fit.parameter_selection import choose, with_tolerances
from elastid.fit.problem.frf_residuals import kernel_of, linear_model
from elastid.fit.spec import FitSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.ports import locked_motor_motions, port_motion
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import EXACT
from elastid.record import Configuration, JointLoop, Motors
from elastid.response import Response
from elastid.robot import Frame, Placement, Robot, Tolerances

LINES = np.linspace(3, 60, 30)
TOOL = (0.5, 0.1, 0.05)
ANGLES = np.array([0.3, -0.7])
FORCES = ("force tool x", "force tool y", "force tool z")
MOTIONS = tuple(map(port_motion, FORCES))


def arm(tolerances: Tolerances | str = "exact") -> Robot:
    """The arm of two axes with a tool."""
    return replace(elastic_arm.arm(), frames=(Frame("tool", "fore", Placement(TOOL)),), tolerances=tolerances)


def outside(motors: Motors, loop: JointLoop | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations of the tool (F, 3, 3), along its own axes, and of the motors (F, 2, 3), by forces on it."""
    robot = Outside(arm())
    M, D, K, rest = robot.matrices(ANGLES)
    n, drift = len(robot.chain), 0 * K
    if loop is not None:  # (k_p + k_d s) (1 + k_i / s)
        D[n:, n:] += np.diag(loop.kd)
        K[n:, n:] += np.diag(loop.kp + loop.kd * loop.ki)
        drift[n:, n:] = np.diag(loop.kp * loop.ki)
    size = n if motors == "locked" else len(M)
    Jv, _, R = robot.jacobian(rest, n - 1, np.array(TOOL))
    J = np.zeros((3, size))
    J[:, :n] = R.T @ Jv
    s = 2j * np.pi * LINES[:, None, None]
    X = s**2 * np.linalg.inv((s**2 * M + s * D + K + drift / s)[:, :size, :size]) @ J.T
    return J @ X, X[:, n:]


def tapped(outputs: tuple[str, ...], motors: Motors = "free", loop: JointLoop | None = None) -> Response:
    G = np.ones((len(LINES), len(outputs), 3), complex)
    return Response(
        LINES, G, FORCES, outputs, "acceleration", Configuration("tapped", ANGLES), motors=motors, loop=loop
    )


@pytest.mark.parametrize("motors", ["locked", "free", "controlled"])
def test_a_tapped_robot_is_that_of_equations_of_its_own(motors: Motors) -> None:
    """To 1e-9 of the largest element: tool by force, and motor by force where these turn; a delay is no part of it."""
    loop = (
        JointLoop(np.array([3e5, 1e5]), np.array([2e3, 9e2]), np.array([5.0, 9.0])) if motors == "controlled" else None
    )
    linearisation = Linearisation.of_robot(arm())
    theta = np.append(linearisation.model.theta, 2e-3)
    at_tool, at_motors = outside(motors, loop)
    expected = [(MOTIONS, at_tool)] + [(("motor 1", "motor 2"), at_motors)] * (motors != "locked")
    for outputs, G in expected:
        model = linear_model(linearisation, tapped(outputs, motors, loop), theta)
        found = frequency_response(model, theta, LINES)
        np.testing.assert_allclose(found, G, atol=1e-9 * np.abs(G).max())


@pytest.mark.parametrize("outputs", [MOTIONS, ("motor 1", "accelerometer tool y")])
def test_derivatives_hold_where_the_geometry_moves_the_force(outputs: tuple[str, ...]) -> None:
    """To all numbers of the file within their tolerances, against differences of models linearised there."""
    robot, spec = arm(Tolerances()), FitSpec()
    parameters = with_tolerances(choose(spec, robot, ["tapped"]), robot, spec)
    linearisation, response = Linearisation.of_robot(robot, EXACT, parameters.names), tapped(outputs)
    theta = parameters.expand(parameters.x, "tapped")
    kernel = kernel_of(linear_model(linearisation, response, theta), parameters, LINES)
    assert any(slope.B is not None for slope in kernel.model.slopes.values())
    G, dG = Columns(kernel).evaluate(theta)

    def at(moved: np.ndarray) -> np.ndarray:
        return frequency_response(linear_model(linearisation, response, moved), moved, LINES)

    for name, slope in zip(kernel.parameters, dG, strict=True):
        i = parameters.names.index(name)
        h = 1e-6 * max(1e-2, abs(theta[i]))
        step = h * np.eye(len(theta))[i]
        numeric = (at(theta + step) - at(theta - step)) / (2 * h)
        # An error of 1 % of the number, or 10 um, against 1e-5 of the response.
        assert np.abs(numeric - slope).max() * max(1e-3, abs(theta[i])) < 1e-4 * np.abs(G).max(), name


@pytest.mark.parametrize("B", [np.eye(4)[:, 1:3], np.array([[1.0, 0], [-1, 0], [0, 2], [0, 0]])])
def test_locked_motors_leave_all_other_motions(B: np.ndarray) -> None:
    """Columns of the identity matrix, unless a motor acts between two coordinates."""
    N = locked_motor_motions(B)
    assert np.linalg.matrix_rank(N) == N.shape[1] == 2
    np.testing.assert_allclose(B.T @ N, 0, atol=1e-15)
    assert np.isin(N, (0, 1)).all() == (B.min() == 0)
