"""A tuned move at its limits, on draws; moves that cannot be made. What it gains is in the example 18."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.commanded_arm import END, START, given, move

from elastid.base.errors import DataError
from elastid.use.command.moves import point_to_point
from elastid.use.command.tune import tune_move

HIGHEST = 2.0  # rad: the link hangs beyond the vertical, and gravity turns it back


@pytest.mark.slow
def test_limits_of_torque_hold_on_draws_with_their_feedback() -> None:
    """Where torque is short the tool leaves its path, and a message says where and in which time it need not."""
    tuned = tune_move(given(torque=420.0), move(0.5), "arm")
    assert np.all(tuned.most <= 420.0)
    assert np.all(np.abs(tuned.torque) <= 420.0)
    assert tuned.planned.max() > 1e-3
    assert "leaves its path by" in tuned.advice
    seconds = float(tuned.advice.rpartition("--time ")[2])
    assert tune_move(given(torque=420.0, draws=0), move(seconds * 1.01), "arm").planned.max() <= 1e-3


@pytest.mark.slow
def test_the_shortest_time_is_that_in_which_the_error_is_just_kept() -> None:
    """A twentieth less time exceeds it."""
    tuned = tune_move(given(torque=420.0, draws=0), move(0.0), "arm")
    assert tuned.planned.max() <= 1e-3
    assert tune_move(given(torque=420.0, draws=0), move(0.95 * tuned.duration), "arm").planned.max() > 1e-3


def test_a_draw_that_no_loop_moves_is_named_as_one() -> None:
    """A damping a hundred thousand times the estimate, of a fit that knows nothing of it."""
    asked = given(draws=1)
    (robot,) = asked.draws
    stiff = robot.with_parameters({"d_1": 1e5 * robot.parameters()["d_1"][0]})
    with pytest.raises(DataError, match=r"is lost .*; this is a robot drawn from the fit, .* or give --draws 0"):
        tune_move(replace(asked, draws=(stiff,)), move(1.0), "arm")


def test_an_end_that_gravity_does_not_let_be_held_is_named() -> None:
    """The torque at rest exceeds the limit, whatever the time."""
    with pytest.raises(DataError, match=r"at its start gravity takes .* of joint 2, whose limit is 20 N\*m"):
        tune_move(given(torque=20.0, draws=0), move(1.0), "arm")


def test_an_end_beyond_the_limits_by_deflection_is_named() -> None:
    """The motor must stand higher than the joint, which is at its limit."""
    high = point_to_point(START, np.array([END[0], HIGHEST]), 1.0)
    with pytest.raises(DataError, match="at its end the motor of joint 2 stands at"):
        tune_move(given(draws=0), high, "arm")
