"""The truth of a simulated robot stands at the conditions of the levels that it is compared with."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.friction_study import at_rest, motion

from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.levels import Levels
from elastid.friction_study.result import JointFriction, numbers_of_law, true_numbers
from elastid.friction_study.spec import LawSpec
from elastid.robot import Body, Friction, Joint, LoadDependence, Motor, Robot, TemperatureDependence


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


def test_the_inertia_at_rest_counts_where_it_is_known_better_than_that_of_a_motion() -> None:
    """One and a tenth, and ten times the std of the motion's."""
    alone = JointFriction("1", False, motion=motion())
    value, std = alone.shared["inertia"]
    better, worse = ((1.05 * value, factor * std) for factor in (0.1, 10.0))
    assert replace(alone, at_rest=replace(at_rest(), inertia=better)).shared["inertia"] == better
    assert replace(alone, at_rest=replace(at_rest(), inertia=worse)).shared == alone.shared
