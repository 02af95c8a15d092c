"""A robot that is written as text is read as the same robot."""

from pathlib import Path

import pytest

from elastid.study import load_robot
from elastid.study.robots import yaml_text

ROOT = Path(__file__).parents[2]
FILES = [*ROOT.glob("configs/robots/*.yml"), *ROOT.glob("elastid/app/templates/*/robot.yml")]


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_shipped_robot_comes_back(path: Path, tmp_path: Path) -> None:
    """Every number with all its digits; comments are no part of it."""
    robot = load_robot(path)
    (tmp_path / "robot.yml").write_text(yaml_text(robot, ("a comment",)))
    assert load_robot(tmp_path / "robot.yml") == robot
