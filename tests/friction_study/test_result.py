"""The truth of a simulated robot stands at the conditions of the levels that it is compared with."""

import math

import numpy as np
import pytest

from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.levels import Levels
from elastid.friction_study.result import true_numbers
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
