"""Derivatives that need no model of their own, as causes that a fit names first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from plants.faults import FREQ_HZ, true_case

from elastid.fit.diagnosis.sensitivities import HeldResponse, gear_ratios
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Robot


def test_the_slope_to_a_ratio_is_that_between_robots_of_two_ratios() -> None:
    """Logs are on the link side by the ratio of the file."""
    step, turns, carried = 1e-4, np.diag([0.0, 1.0]), true_case().truth

    def linear(ratio: float) -> tuple[Robot, LinearModel]:
        joint = carried.bodies[1].joints[0]
        motor = replace(joint.motor, inertia=0.1, ratio=5 * ratio)
        fore = replace(carried.bodies[1], joints=(replace(joint, motor=motor), *carried.bodies[1].joints[1:]))
        robot = replace(carried, bodies=(carried.bodies[0], fore, *carried.bodies[2:]))
        model = serial(robot)
        at = Linearisation.of(model).at(Configuration("c", [0.6, -0.7]), model.theta, robot.motor_locations, "position")
        return robot, at

    (robot, model), theta = linear(1.0), linear(1.0)[1].theta_ref
    kernel = Kernel(model, FREQ_HZ, tuple(name for name in model.parameters if name in model.slopes))
    G, dG = Columns(kernel).evaluate(theta)
    held = HeldResponse(robot, model, theta, FREQ_HZ, G, dict(zip(kernel.wanted, dG, strict=True)))
    logs = [(np.eye(2) + sign * step * turns) @ frequency_response(linear(1 + sign * step)[1], theta, FREQ_HZ)
            @ (np.eye(2) + sign * step * turns) for sign in (1, -1)]  # fmt: skip
    np.testing.assert_allclose(
        gear_ratios(held)["ratio_2"], (logs[0] - logs[1]) / (2 * step), rtol=1e-4, atol=1e-4 * np.abs(G).max()
    )
