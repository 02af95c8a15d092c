"""The barrier at physically impossible inertias: value, slope and curvature."""

import numpy as np

from elastid.fit.parameter_selection import choose
from elastid.fit.problem.inertia_barrier import BARRIER_WEIGHT, barrier, free_inertias
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.robot import Body, Joint, Motor, Robot, Spring


def test_barrier_equals_closed_form_with_exact_slope() -> None:
    """-2 mu ln det(Sigma / tr Sigma) of a free tensor; its gradient is that of central differences."""
    joint = Joint("1", "z", Spring(1e4, 10.0), Motor(1e-3, 50.0))
    robot = Robot("one", (Body("load", joints=(joint,), mass=3.0, inertia=(0.4, 0.5, 0.6, 0.02, 0.03, -0.01)),))
    parameters = choose(FitSpec(parameters={"I_load_*": ParameterSpec()}), robot, ["c1"])
    inertias, x = free_inertias(parameters, robot), parameters.x
    (body,) = inertias
    value, gradient, _ = barrier(inertias, parameters, x)
    sigma = body.second_moment(parameters, x)
    np.testing.assert_allclose(value, -2 * BARRIER_WEIGHT * np.log(np.linalg.det(sigma / np.trace(sigma))))
    for i, step in enumerate(1e-6 * np.eye(len(x))):
        ends = [barrier(inertias, parameters, x + sign * step)[0] for sign in (1, -1)]
        np.testing.assert_allclose(gradient[i], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-8)
