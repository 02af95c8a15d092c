"""A joint has numbers, limits and units of its own; its motor's are on the motor side, its dry friction has one law."""

from collections.abc import Callable

import numpy as np
import pytest
from plants.elastic_arm import arm

from elastid.model.formulation import serial
from elastid.robot import Gear, Joint, Motor, Spring


def test_shaft_spring_adds_names_and_is_linear() -> None:
    assert set(Motor(1e-3, spring=Spring(10.0)).numbers("2")) == {"Jm_2", "fm_2", "km_2", "dm_2"}
    with pytest.raises(ValueError, match="must be linear"):
        Motor(1e-3, spring=Spring(10.0, cubic=1.0))


def test_sliding_joint_has_translation_units_and_no_point() -> None:
    rail = Joint("rail", motion="translation", spring=Spring(1e6))
    assert (rail.unit, rail.numbers["k_rail"][0], rail.numbers["f_rail"][0]) == ("m", "N/m", "N*s/m")
    assert rail.geometry == {}
    with pytest.raises(ValueError, match="joint rail"):
        Joint("rail", motion="translation", point=(0.0, 0.0, 0.1))


def test_joint_zero_adds_to_position() -> None:
    """The mass matrix of both is the same; a joint that slides has its place in its body."""
    robot = arm()
    off, model = serial(robot.with_parameters({"zero_2": 0.3})), serial(robot)
    q = np.linspace(-0.5, 0.5, model.n_q)
    moved = q + 0.3 * (np.arange(model.n_q) == model.index("joint 2"))
    np.testing.assert_allclose(
        off.mass(q, off.theta).full(), model.mass(moved, model.theta).full(), rtol=1e-12, atol=1e-12
    )
    with pytest.raises(ValueError, match="joint rail"):
        Joint("rail", motion="translation", zero=0.1)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Gear(load=1.0), "load: it must be below 1"),
        (lambda: Joint("1", motor=Motor(1e-3, 100.0), gear=Gear()), "the joint has no spring"),
        (lambda: Joint("1", spring=Spring(1e5), gear=Gear()), "the joint has no motor"),
    ],
)
def test_numbers_that_no_gear_has_are_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()
