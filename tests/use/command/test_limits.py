"""The limit that a motion comes nearest to."""

import numpy as np
import pytest
from plants.commanded_arm import arm

from elastid.use.command.moves import KINDS, MotionLimits, References, nearest_limit


@pytest.mark.parametrize(("side", "limit"), [(-1.0, -2.0), (1.0, 3.0)])
def test_the_end_of_a_range_that_is_near_is_named(side: float, limit: float) -> None:
    """Joint 1 within [-2, 3] rad: at 0.5 rad it is in the middle, 2 rad below or above it near one end."""
    robot = arm()
    n_u = len(robot.driven)
    free = np.full(n_u, np.inf)
    angle = np.tile([-np.inf, np.inf], (n_u, 1))
    angle[0] = [-2.0, 3.0]
    limits = MotionLimits(angle, **dict.fromkeys(KINDS, free))
    still = np.zeros((3, n_u))
    position = still.copy()
    position[:, 0] = 0.5 + side * np.array([0.0, 2.0, 1.0])
    near = nearest_limit(robot, limits, References(np.arange(3.0), position, still, still, still, still))
    assert near is not None
    assert (near.kind, near.limit, near.unit) == ("angle", limit, "rad")
    assert near.used == pytest.approx(0.8)
