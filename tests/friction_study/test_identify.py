"""Records of passes give the friction of a joint: its law, its table, and a robot's file with both."""

from pathlib import Path

import numpy as np
import pytest
from plants.friction_records import records, simulated, template

from elastid.app.identified_robot import robot_of_friction
from elastid.friction_study.identify import identify_friction
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.friction_study.levels import Levels, PassLevels
from elastid.friction_study.result import FrictionResult, JointLevels
from elastid.record import FrictionRecords
from elastid.robot.friction_numbers import friction_numbers
from elastid.study import load_robot


@pytest.fixture(scope="module")
def found() -> FrictionResult:
    loaded = template()
    study, (_, measured) = loaded.study, records(loaded)
    levels = find_joint_levels(study.as_robot(), study.friction_joints, measured)
    return identify_friction(study.as_robot(), levels, measured, study.as_friction(), simulated(loaded))


def test_the_numbers_are_those_of_the_truth(found: FrictionResult) -> None:
    """Each within its interval of 99.9 %; parts that one load and no thermometer cannot show are held with reasons."""
    numbers = {number.name: number for number in found.numbers}
    assert {"Fc_m1", "Fs_m1", "vs_m1", "f_m1"} <= set(numbers)
    for name in ("Fc_m1", "Fs_m1", "vs_m1", "f_m1"):
        one = numbers[name]
        assert one.truth is not None
        assert abs(one.value - one.truth) < 3.3 * one.std + 2e-3 * one.truth, name
        assert one.std < 0.05 * one.value
    assert found.status == "identified"
    assert {held.part for held in found.at("1").held} >= {"load", "temperature"}


def test_the_robots_file_has_the_law_and_its_ranges(found: FrictionResult, tmp_path: Path) -> None:
    """Read back, it is the robot whose friction has the numbers of the table, on the side of the motor."""
    text = robot_of_friction(template().study.name, template().study.as_robot(), found)
    assert all(f"#   {number.name} = " in text for number in found.numbers)
    (tmp_path / "robot.yml").write_text(text)
    numbers = friction_numbers(load_robot(tmp_path / "robot.yml"))
    table = {number.name: number.value for number in found.numbers}
    for name in ("Fc_m1", "Fs_m1", "vs_m1", "f_m1"):
        assert numbers[name][0] == pytest.approx(table[name], rel=1e-9)
    motor = load_robot(tmp_path / "robot.yml").driven[0].motor
    assert motor is not None
    assert motor.friction is not None
    assert motor.friction.measured is not None
    assert motor.friction.measured.speed == pytest.approx((0.87, 157.1), rel=0.02)


def test_numbers_that_no_contact_has_make_no_law() -> None:
    """Viscous friction that would drive backwards: no number of it is stated, and a note says why."""
    v, s = (x.ravel() for x in np.meshgrid(np.geomspace(0.02, 2, 10), (1.0, -1.0), indexing="ij"))
    one = np.ones_like(v)
    levels = Levels("joint 1", v, s, 9 + (0.5 + 3 * s) * v, 0.01 * one, 0 * one, np.nan * one)
    found = JointLevels("1", False, PassLevels(levels, {}, ()))
    study = template().study
    result = identify_friction(study.as_robot(), [found], FrictionRecords(()), study.as_friction())
    assert (result.status, result.at("1").friction) == ("failed", None)
    assert result.numbers == ()
    assert [note.code for note in result.at("1").notes] == ["friction/law"]
