"""Notes on the numbers of gears: effects that cannot be told apart."""

from __future__ import annotations

import numpy as np

from elastid.nonlinear.effects import GearEffect
from elastid.nonlinear.gear_levels import Levels
from elastid.nonlinear.gear_limits import alike_notes
from tests.nonlinear.test_gear_sheet import PARAMETERS

FRICTION, LOAD = GearEffect("friction", "1", 1e-3), GearEffect("load", "1", 1e-3)


def levels(correlation: float, **found: float) -> Levels:
    """Of 2 % each: friction in Nm, load."""
    effects = tuple({"friction": FRICTION, "load": LOAD}[name] for name in found)
    size = 0.02 * np.array([*found.values()])
    covariance = np.eye(2 + len(size))
    covariance[2:, 2:] = np.outer(size, size) * np.where(np.eye(len(size)) > 0, 1.0, correlation)
    x, none = PARAMETERS.x, np.zeros(len(size))
    return Levels(PARAMETERS, effects, x, np.array([*found.values()]), covariance, 1, 0.0, 0.0, (), (), none)


def test_two_that_were_found_alike_have_one_level() -> None:
    """Under a torque of 200 Nm that hardly changes 0.1 by load are 20 Nm: with 20 Nm beside them 40."""
    (note,) = alike_notes(levels(-0.99, load=0.1, friction=20.0))
    assert "(correlation -0.990)" in note.text
    assert note.text.endswith("together they are 39.8 N*m of the first")
    assert alike_notes(levels(-0.9, load=0.1, friction=20.0)) == []
