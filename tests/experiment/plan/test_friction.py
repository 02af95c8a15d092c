"""Plans of friction passes and their references."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from plants.refusals import advised, refused

from elastid.experiment.plan.friction import (
    RAMP_PEAK,
    SHORTEST_S,
    PassLimits,
    fastest_speed,
    pass_reference,
    pass_time,
    plan_passes,
    planned_pass,
)

LIMITS = PassLimits("motor 2", (-0.4, 0.8), 1.8, 6.0, 2 * np.pi / 240, 6.0, lag=0.02)
SPEEDS = tuple(np.geomspace(0.004, 1.0, 12))


def test_the_fastest_pass_fills_the_window() -> None:
    """Its ramps, and the time that its loop and its plateau take; none where a turn does not fit."""
    v = fastest_speed(replace(LIMITS, velocity=9.0))
    room = v**2 / (LIMITS.acceleration / RAMP_PEAK) + v * (3 / (2 * np.pi * LIMITS.bandwidth_hz) + SHORTEST_S)
    assert room == pytest.approx(1.2 - LIMITS.turn - LIMITS.lag)
    assert fastest_speed(replace(LIMITS, turn=0.2, window=(0.0, 0.5))) > 0
    assert fastest_speed(replace(LIMITS, turn=0.6, window=(0.0, 0.5))) == 0


def test_window_or_speed_of_refusal_is_accepted():
    """Three digits of the speed, four of the window; not much more speed, hardly less window."""
    limits = replace(LIMITS, velocity=9.0)
    with refused("friction/plan", place=".window", holds=("motor 2 at 4 rad/s", "the window is 1.2.")) as caught:
        planned_pass(4.0, 1, limits)
    room, speed = advised(caught, "needs"), advised(caught, "up to")
    planned_pass(4.0, 1, replace(limits, window=(0.0, 1.001 * room)))
    planned_pass(0.99 * speed, 1, limits)
    for least, window in ((4.0, (0.0, 0.999 * room)), (1.05 * speed, limits.window)):
        with refused("friction/plan"):
            planned_pass(least, 1, replace(limits, window=window))


def test_run_stays_in_window_and_covers_turn_at_speed() -> None:
    """Velocity constant between the marks, there and back; position within the window, at rest where it began."""
    for planned in plan_passes(SPEEDS, 1, LIMITS, 0):
        reference = pass_reference(planned, LIMITS, 500.0)
        assert reference.position.min() > LIMITS.window[0] - 1e-3
        assert reference.position.max() < LIMITS.window[1] + 1e-3
        assert reference.position[-1] == pytest.approx(planned.start, abs=1e-9)
        assert reference.position.max() == pytest.approx(planned.stop, abs=planned.speed / 50)
        for (start, stop), sign in ((reference.there, 1), (reference.back, -1)):
            np.testing.assert_allclose(reference.velocity[start:stop], sign * planned.speed, rtol=1e-12)
            covered = np.ptp(reference.position[start:stop])
            assert covered > min(0.95 * LIMITS.turn, 0.95 * 20.0 * planned.speed)
        assert np.abs(reference.acceleration).max() < 1.02 * LIMITS.acceleration
        assert len(reference.position) / 500.0 == pytest.approx(pass_time(planned, LIMITS), rel=0.02, abs=0.02)


def test_run_order_is_random_by_seed_with_references_between() -> None:
    plan = plan_passes(SPEEDS, 2, LIMITS, 3, reference_every_s=60.0)
    assert plan == plan_passes(SPEEDS, 2, LIMITS, 3, reference_every_s=60.0)
    speeds = [one.speed for one in plan if not one.is_reference]
    assert sorted(speeds) == sorted([*SPEEDS, *SPEEDS])
    assert speeds != sorted(speeds)
    assert plan[0].is_reference
    assert plan[-1].is_reference
    since = 0.0
    for one, following in pairwise(plan):
        since = 0.0 if one.is_reference else since + pass_time(one, LIMITS)
        assert following.is_reference == (since > 60.0) or following is plan[-1]
    assert len({one.name for one in plan}) == len(plan)
