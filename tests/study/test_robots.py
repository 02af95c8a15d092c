"""A robot that is written as text is read as the same robot."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from plants.paths import ROOT

from elastid.robot import Limits
from elastid.robot.simplified import with_joints
from elastid.store.kinds import from_text, text_of
from elastid.study import load_robot
from elastid.study.robots import yaml_text

FILES = [*ROOT.glob("configs/robots/*.yml"), *ROOT.glob("elastid/app/templates/*/robot.yml")]


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_shipped_robot_comes_back(path: Path, tmp_path: Path) -> None:
    """Every number with all its digits; comments are no part of it."""
    robot = load_robot(path)
    (tmp_path / "robot.yml").write_text(yaml_text(robot, ("a comment",)))
    assert load_robot(tmp_path / "robot.yml") == robot


def test_a_limit_on_one_side_is_kept(tmp_path: Path) -> None:
    """In a file for people and in a result, where none can be written as a number."""
    one_sided = Limits(angle=(-math.inf, 2.0))
    robot = with_joints(load_robot(FILES[0]), lambda joint: replace(joint, limits=one_sided))
    (tmp_path / "robot.yml").write_text(yaml_text(robot))
    assert load_robot(tmp_path / "robot.yml") == robot == from_text(text_of(robot), type(robot))
