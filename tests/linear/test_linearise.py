"""A robot's linearisation: kept for the next who asks, and without slopes the same matrices."""

from pathlib import Path

import numpy as np
import pytest

from elastid.linear.linearise import Linearisation
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.study import load_robot

ROBOTS = Path(__file__).parents[2] / "configs" / "robots"


@pytest.mark.parametrize(("name", "formulation"), [("manutec_r3", "serial"), ("linkage_arm", "constrained")])
def test_matrices_without_slopes_are_those_with_them(name: str, formulation: str) -> None:
    """Of robots under gravity, with and without loops, whose geometry is among the parameters too."""
    robot = load_robot(ROBOTS / f"{name}.yml")
    linearisation = Linearisation.of_robot(robot, ModelSpec(formulation=formulation), tuple(robot.geometry))
    theta = linearisation.model.theta
    posture = Configuration("a", np.full(len(robot.driven), 0.1))
    outputs = robot.motor_locations
    full = linearisation.at(posture, theta, outputs, "acceleration")
    plain = linearisation.without_slopes.at(posture, theta, outputs, "acceleration")
    for letter in "MDKBCTZ":
        np.testing.assert_array_equal(getattr(plain, letter), getattr(full, letter), err_msg=letter)
    assert full.slopes
    assert not plain.slopes
