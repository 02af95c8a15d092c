"""Effects of a gear in a robot's file: what is refused, and that a file keeps them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from plants.two_mass_gear import Gear as Plant
from plants.two_mass_gear import robot

from elastid.robot import Gear, GearRipple, Hysteresis, Joint, Motor, Spring, TransmissionError
from elastid.robot.simplified import stiffened, with_joints, without_dry_friction
from elastid.study import load_robot
from elastid.study.robots import robot_text

FULL = Gear(
    0.02, (TransmissionError(2e-5, 1.0, 0.3),), (GearRipple(3.0, 6.0, -0.4),), (Hysteresis(4.0, 1e-4, "smooth"),)
)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Gear(load=-0.1), "load is -0.1"),
        (lambda: Gear(load=1.0), "takes all of its torque"),
        (lambda: TransmissionError(0.0), "error: amplitude"),
        (lambda: GearRipple(1.0, order=0.0), "ripple: order"),
        (lambda: Hysteresis(1.0, deflection=0.0), "hysteresis: deflection"),
        (lambda: Joint("1", motor=Motor(1e-3, 100.0), gear=Gear()), "the joint has no spring"),
        (lambda: Joint("1", spring=Spring(1e5), gear=Gear()), "the joint has no motor"),
    ],
)
def test_numbers_that_no_gear_has_are_refused(make: Callable[[], object], words: str) -> None:
    """With the key and the number."""
    with pytest.raises(ValueError, match=words):
        make()


def test_a_robot_file_keeps_every_effect(tmp_path: Path) -> None:
    """To the last digit, and makers' units may be written."""
    geared = with_joints(robot(Plant()), lambda joint: replace(joint, gear=FULL))
    text = robot_text(geared)
    path = tmp_path / "robot.yml"
    path.write_text(text)
    assert load_robot(path).driven[0].gear == FULL
    path.write_text(text.replace("amplitude: 2e-05", "amplitude: 10 arcsec"))
    assert load_robot(path).driven[0].gear.error[0].amplitude == pytest.approx(4.8481368e-5)


def test_friction_of_a_gear_goes_with_the_rest_of_it() -> None:
    """Without dry friction a gear keeps its error and ripple; a gear that is rigid has none of its effects."""
    geared = with_joints(robot(Plant()), lambda joint: replace(joint, gear=FULL))
    assert without_dry_friction(geared).driven[0].gear == replace(FULL, load=0.0, hysteresis=())
    assert stiffened(geared, ["1"]).driven[0].gear is None
