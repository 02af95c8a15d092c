"""Derivatives that need no model of their own, as causes that a fit names first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from plants.faults import CONFIGURATIONS, FREQ_HZ, SPEC, Case, drawn, exact, true_case

from elastid.fit.diagnosis.sensitivities import HeldResponse, gear_ratios
from elastid.fit.identify import identify
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Robot

SOFT = 0.95


def with_soft_day(case: Case) -> Case:
    """One posture was measured when the gear was softer."""
    soft = exact(case.truth.with_parameters({"k_2": SOFT * case.stiffness["k_2"]}))
    return replace(case, responses=(*case.responses[:2], soft[2]))


def behind_gear(case: Case) -> Case:
    """The angle of axis 2 is that of its link."""
    model, s = serial(case.truth), 2j * np.pi * FREQ_HZ[:, None, None]
    linearisation, responses = Linearisation.of(model), []
    for G, angles in zip(case.responses, CONFIGURATIONS, strict=True):
        read = linearisation.at(Configuration("c", angles), model.theta, ("motor 1", "joint 2"), "position")
        Z = s**2 * read.M + s * read.D + read.K
        B = np.broadcast_to(read.B, (len(FREQ_HZ), *read.B.shape))
        responses.append(replace(G, G=s**2 * (read.C @ np.linalg.solve(Z, B))))
    return replace(case, responses=tuple(responses))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "name", "step"),
    [
        (with_soft_day, "spring_2@c3", np.log(SOFT)),
        (behind_gear, "encoder of axis 2 behind the gear", None),
    ],
)
def test_a_cause_is_named_first_with_its_size(fault: Callable[[Case], Case], name: str, step: float | None) -> None:
    """To a fifth of its size, by one linear step; or next to what the data cannot distinguish from it."""
    case = true_case()
    result = identify(drawn(fault(case), np.random.default_rng(0)), case.robot, SPEC)
    first = result.indices[0]
    assert name in (first.name, *first.alike)
    assert first.share > 0.8
    if step is not None:
        index = next(each for each in result.indices if each.name == name)
        assert index.steps[0] == pytest.approx(step, rel=0.2)


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
