"""Speeds of friction passes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.friction_axis import axis
from plants.refusals import refused

from elastid.design.friction_axis import (
    GEAR,
    StribeckGuess,
    _information,
    axis_of,
    default_window,
    guess_friction,
    optimal_speeds,
)
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.friction_study.spec import PassesSpec
from elastid.record import Configuration

# Axis 2 of a large robot at 40 degC, in parts of its rating (LiTH-ISY-R-2948).
GUESS = StribeckGuess(3.11e-2, 7.01e-2, 3.21e-4, 14.4, 1.36)


def test_five_numbers_take_five_speeds_of_equal_shares() -> None:
    """As slow as slides, about nu_s / 2, 1.5 nu_s, 4 nu_s, and the top: ten passes, two at each."""
    found = optimal_speeds([GUESS], 0.03 * 14.4, 250.0, 10)
    places = found.speed / 14.4
    groups = np.repeat(places, found.passes)
    assert groups[0] == pytest.approx(0.03, rel=0.01)
    assert groups[-1] == pytest.approx(250 / 14.4, rel=0.01)
    np.testing.assert_allclose(groups[[2, 4, 6]], [0.5, 1.45, 4.1], rtol=0.25)
    assert found.efficiency > 0.98


def test_no_speed_would_help_more_than_the_certificate_says() -> None:
    """d = 5 times (1 + excess) bounds the gain of every candidate; log-spaced speeds are worse by a fifth or more."""
    found = optimal_speeds([GUESS], 0.5, 250.0, 50)
    H = _information(GUESS, np.geomspace(0.5, 250.0, 200))
    M = np.einsum("q,qij->ij", found.passes / 50, _information(GUESS, found.speed))
    gains = np.einsum("ij,qji->q", np.linalg.inv(M), H)
    assert gains.max() < 5 * 1.1
    spread = _information(GUESS, np.geomspace(0.5, 250.0, 50)).mean(axis=0)
    assert (np.linalg.det(spread) / np.linalg.det(M)) ** (1 / 5) < 0.8


@pytest.mark.parametrize(
    ("lowest", "highest", "count"),
    [(10.0, 20.0, 12), (0.5, 250.0, 4)],
)
def test_impossible_designs_are_refused(lowest: float, highest: float, count: int) -> None:
    with refused("friction/plan"):
        optimal_speeds([GUESS], lowest, highest, count)


def test_an_axis_has_the_torques_of_its_window() -> None:
    """m g c sin q at its end; (m c^2 + I + J n^2) of inertia; friction as of common gears where the file has none."""
    robot, at = axis(law=None), Configuration("up", np.zeros(1))
    (joint,) = robot.driven
    assert default_window(joint) == (-1.0, 1.0)
    found = axis_of(robot, joint, at, PassesSpec(window=(-0.2, 0.6)), ControllerSpec(8.0))
    assert found.holding == pytest.approx(20 * 9.81 * 0.4 * np.sin(0.6), rel=2e-3)
    assert found.inertia == pytest.approx(20 * 0.4**2 + 1.0 + 4.0, rel=1e-2)
    assert found.limits.window == (-0.2, 0.6)
    assert joint.motor is not None
    guess = guess_friction(robot, replace(joint, motor=replace(joint.motor, viscous=0.0)), found.inertia)
    assert guess.viscous == pytest.approx(GEAR.viscous * guess.coulomb / joint.limits.velocity)
    steep = min(np.geomspace(0.03, 4, 200) * found.guess.stribeck_velocity, key=found.guess.slope)
    assert not found.sticks_at(steep)
    weak = replace(found, damping=-0.5 * found.guess.slope(steep))
    assert weak.sticks_at(steep)
    assert weak.slowest > steep
