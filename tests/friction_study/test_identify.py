"""Records of passes give the friction of a joint: its law, its table, and a robot's file with both."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from plants.friction_records import records, simulated, template

from elastid.app.identified_robot import robot_of_friction
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.levels import Levels
from elastid.friction_study.result import (
    FrictionResult,
    JointLevels,
    identify_friction,
    numbers_of_law,
    true_numbers,
)
from elastid.friction_study.spec import (
    FilterSpec,
    LawSpec,
    LoadSpec,
    PassesSpec,
)
from elastid.record import FrictionRecords
from elastid.robot import Body, Friction, Joint, LoadDependence, Motor, Robot, TemperatureDependence
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
    found = JointLevels("1", False, levels)
    study = template().study
    result = identify_friction(study.as_robot(), [found], FrictionRecords(()), study.as_friction())
    assert (result.status, result.at("1").friction) == ("failed", None)
    assert result.numbers == ()
    assert [note.code for note in result.at("1").notes] == ["friction/law"]


def test_a_warm_and_loaded_joint_has_the_numbers_of_its_levels() -> None:
    """20 K above the reference and under 30 Nm; the file's numbers where nothing is compared."""
    warm = TemperatureDependence(25.0, stiction=0.002, viscous=1e-3, decay=20.0)
    law = Friction(0.2, 0.3, 5.0, load=LoadDependence(0.05, 0.08), temperature=warm)
    joint = Joint("1", motor=Motor(1e-3, 100.0, viscous=2e-3, friction=law))
    robot = Robot("axis", (Body("arm", joints=(joint,), mass=3.0, inertia=1.0),))
    speed = np.geomspace(0.01, 1.0, 8)
    same = np.ones_like(speed)
    levels = Levels("joint 1", speed, 0 * same, 20 + 10 * speed, 0.1 * same, 30 * same, 45 * same)
    found = true_numbers(robot, "1", StaticLaw.of(levels, LawSpec()))
    fading = math.exp(-1.0)
    expected = {"Fc_m1": 20 + 1.5, "Fs_m1": 30 + 0.2 * 20 + 2.4, "f_m1": 20 + 10 * (fading - 1), "fT_m1": 10 * fading}
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert true_numbers(robot, "1")["Fc_m1"] == pytest.approx(20.0)


def test_each_direction_has_an_interval_as_wide_in_its_std_as_the_mean_has() -> None:
    """F_c forwards 24, backwards 20, and as many std to each end as of F_c itself."""
    speed = np.tile(np.geomspace(0.01, 1.0, 8), 2)
    way = np.repeat([1.0, -1.0], 8)
    levels = Levels("joint 1", speed, way, 22 + 2 * way + 9 * speed, 0.1 + 0 * speed, 0 * speed, np.nan * speed)
    rows = {row.name: row for row in numbers_of_law("1", StaticLaw.of(levels, LawSpec()), {})}
    mean, forwards, backwards = (rows[name] for name in ("Fc_m1", "Fc_m1+", "Fc_m1-"))
    assert (forwards.value, backwards.value) == (pytest.approx(24.0, abs=0.1), pytest.approx(20.0, abs=0.1))
    for row in (forwards, backwards):
        assert (row.high - row.value) / row.std == pytest.approx((mean.high - mean.value) / mean.std)


def test_a_filter_of_both_directions_has_no_state_of_either() -> None:
    with pytest.raises(ValueError, match=r"f\+ and f-"):
        FilterSpec(states=("f", "f+"))


def test_a_window_may_lie_below_zero_and_a_lone_load_need_no_name() -> None:
    """Positions have either sign; the robot as it is has no load to name."""
    assert PassesSpec(window=(-2.0, -1.0)).window == (-2.0, -1.0)
    assert LoadSpec("").payload == 0
