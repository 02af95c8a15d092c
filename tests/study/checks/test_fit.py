"""Bodies that resist no motion of their joints are refused where the study is read."""

from pathlib import Path

import numpy as np
import pytest

from elastid.model.kinematics import joint_without_inertia
from elastid.study import load

INERTIA = "    inertia: 1e-3\n"


def with_inertia(tiny: Path, text: str) -> Path:
    """The study, whose robot's body has another inertia."""
    robot = tiny.parent / "robot.yml"
    robot.write_text(robot.read_text().replace(INERTIA, text))
    return tiny


@pytest.mark.parametrize("text", ["    inertia: [1, 0, 1]\n", "    mass: 2\n    center_of_mass: [0.3, 0, 0]\n"])
def test_what_a_joint_does_not_turn_about_needs_no_inertia(tiny: Path, text: str) -> None:
    """A rod across the axis, and a mass off it."""
    robot = load(with_inertia(tiny, text)).study.as_robot()
    assert joint_without_inertia(robot, np.zeros(1)) is None
