"""Tolerances of a robot's file: which number has which, and what is refused."""

import math
from dataclasses import replace

import pytest
from plants.elastic_arm import arm

from elastid.robot import BodyTolerances, Tolerances


def test_each_number_has_the_tolerance_of_its_kind_and_body() -> None:
    """Of a body's own where it is listed, else those of all; springs and friction have none."""
    robot = arm()
    weighed = Tolerances(
        bodies=(
            BodyTolerances("fore", mass=0.005, motor_inertia=0.02, center_of_mass="exact", length=2e-4, angle=1e-4),
        )
    )
    paths = {name: path for name, (_, path) in (robot.numbers | robot.geometry).items()}
    std = {name: weighed.std(path, robot.bodies[path[1]].name) for name, path in paths.items()}
    assert (std["m_upper"], std["m_fore"]) == (0.03, 0.005)
    assert (std["c_upper_x"], std["c_fore_x"]) == (0.01, 0.0)
    assert (std["I_fore_yy"], std["Jm_1"], std["p_fore_z"]) == (0.1, 0.05, 2e-4)
    assert std["Jm_2"] == 0.02
    assert (std["zero_1"], std["zero_2"]) == (pytest.approx(math.radians(0.2)), 1e-4)
    assert {std[name] for name in ("k_1", "d_1", "f_1", "fm_1")} == {0.0}


def test_tolerances_are_positive_and_of_bodies_that_exist() -> None:
    """Zero is written `exact`; a Gaussian prior of a positive number is narrower than the number."""
    with pytest.raises(ValueError, match=r"^mass: "):
        Tolerances(mass=5.0)
    with pytest.raises(ValueError, match=r"^mass: "):
        Tolerances(mass=0.0)
    with pytest.raises(ValueError, match=r"^inertia: "):
        BodyTolerances("fore", inertia=-1.0)
    with pytest.raises(ValueError, match="tolerances: no body is called for; did you mean 'fore'"):
        replace(arm(), tolerances=Tolerances(bodies=(BodyTolerances("for"),)))
