"""Numbers of the robot's file within their tolerances are free, and all others stay as a study says."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from plants.data_sheet_arm import SPEC, arm

from elastid.fit.parameter_choice import choose, with_tolerances
from elastid.robot import Body, Joint, Motor, Robot, Spring, Tolerances


def test_numbers_are_free_within_their_tolerance_and_zero_lengths_stay() -> None:
    """One factor for the entries of an inertia, in x behind all that was asked for."""
    robot = arm(Tolerances())
    parameters = with_tolerances(choose(SPEC, robot), robot, SPEC)
    free = parameters.free_names
    assert [p.name for p in parameters.asked] == list(free[:6])
    assert {"m_upper", "I_upper", "I_fore", "Jm_1", "c_fore_y", "p_fore_z", "zero_2"} <= set(free[6:])
    assert not {"p_fore_x", "pj_2_x", "I_upper_xx"} & set(free)
    assert parameters["p_fore_z"].prior is not None
    x = parameters.x
    x[free.index("I_upper")] = math.log(1.1)
    theta = parameters.as_dict(x)
    assert theta["I_upper_xx"] == pytest.approx(3.3)
    assert theta["I_upper_zz"] == pytest.approx(0.55)


def test_numbers_that_no_response_shows_have_no_tolerance() -> None:
    """The centre of a body without mass, and the zero of an axis about gravity that turns the whole robot."""
    joint = Joint("1", "z", Spring(50, 0.01), Motor(1e-3, 1, 1e-3))
    load = Body("load", joints=(joint,), inertia=1e-3)
    bench = Robot("bench", (load,), gravity=(0, 0, -9.81), tolerances=Tolerances())
    tolerated = {p.name for p in with_tolerances(choose(SPEC, bench), bench, SPEC) if p.tolerated}
    assert tolerated == {"I_load", "Jm_1"}
    on_a_wall = replace(bench, gravity=(9.81, 0, 0))
    assert with_tolerances(choose(SPEC, on_a_wall), on_a_wall, SPEC)["zero_1"].tolerated
