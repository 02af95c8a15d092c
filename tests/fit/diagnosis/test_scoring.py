"""The score test measures what the fit left, by the fit's own model, whatever stands in for what is rigid there."""

from __future__ import annotations

import numpy as np
from plants.faults import SPEC, Case, drawn, exact

from elastid.fit.identify import identify
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring


def gantry() -> Robot:
    """A heavy bridge on a rail, 0.4 m above it, with a small wrist: no spring but the wrist's resists a turn."""
    rail = Joint("X", "x", Spring(2e7, 6e3), Motor(8e-4, 314, 2e-3), motion="translation")
    wrist = Joint("B", "y", Spring(3e4, 20.0), Motor(2e-4, 80, 1e-4))
    bridge = Body("bridge", "base", Placement((0, 0, 0)), (rail,), 300, (0, 0.1, 0.4), (30, 20, 40))
    hand = Body("hand", "bridge", Placement((0, 0, -0.3)), (wrist,), 15, (0.15, 0.02, 0), (0.1, 0.4, 0.4))
    return Robot("gantry", (bridge, hand), gravity=(0.0, 0.0, -9.81))


def test_numbers_without_an_effect_are_no_cause_however_small_the_noise() -> None:
    """Noise of 0.002 %; the centre of the bridge moved V by 5000 where a stiff spring stood in for its guide."""
    robot = gantry()
    quiet = drawn(Case(robot, exact(robot), robot), np.random.default_rng(0), 2e-5, np.inf)
    result = identify(quiet, robot, SPEC)
    assert (result.status, result.indices) == ("converged", ())
