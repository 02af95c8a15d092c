"""Bodies that resist no motion of their joints are refused where the study is read."""

from pathlib import Path

import numpy as np
import pytest

from elastid.base.errors import StudyError
from elastid.model.kinematics import joint_without_inertia
from elastid.study import load, load_robot

INERTIA = "    inertia: 1e-3\n"


def with_inertia(tiny: Path, text: str) -> Path:
    """The study, whose robot's body has another inertia."""
    robot = tiny.parent / "robot.yml"
    robot.write_text(robot.read_text().replace(INERTIA, text))
    return tiny


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("", "4:5"),
        ("    inertia: 0\n", "11:14"),
        ("    inertia: [1, 1, 0]\n", "11:14"),
        ("    mass: 2\n    center_of_mass: [0, 0, 0.3]\n", "4:5"),
    ],
    ids=["nothing", "zero", "a rod along the axis", "a mass on the axis"],
)
def test_a_body_without_inertia_about_its_joint_is_refused_at_its_line(tiny: Path, text: str, place: str) -> None:
    """With body, joint, axis and configuration."""
    with pytest.raises(StudyError) as refused:
        load(with_inertia(tiny, text))
    said = str(refused.value)
    assert f"robot.yml:{place}: bodies[0].inertia: body load and the bodies behind it have neither an inertia" in said
    assert "where joint 1 (axis z) moves them, in configuration a: the mass matrix is singular" in said


@pytest.mark.parametrize("text", ["    inertia: [1, 0, 1]\n", "    mass: 2\n    center_of_mass: [0.3, 0, 0]\n"])
def test_what_a_joint_does_not_turn_about_needs_no_inertia(tiny: Path, text: str) -> None:
    """A rod across the axis, and a mass off it."""
    robot = load(with_inertia(tiny, text)).study.as_robot()
    assert joint_without_inertia(robot, np.zeros(1)) is None


def test_a_rotor_that_turns_rigidly_is_an_inertia(tiny: Path) -> None:
    """Without a spring the body moves with its motor."""
    robot = with_inertia(tiny, "").parent / "robot.yml"
    robot.write_text("".join(line for line in robot.read_text().splitlines(True) if "spring:" not in line))
    assert joint_without_inertia(load_robot(robot), np.zeros(1)) is None
