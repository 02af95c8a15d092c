"""A tuned move at its limits, on draws; moves that cannot be made. What it gains is in the example 18."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.commanded_arm import END, START, given, move
from plants.refusals import refused

from elastid.base.arrays import FloatArray
from elastid.use.command.moves import point_to_point
from elastid.use.command.tune import tune_move

HIGHEST = 2.0  # rad: the link hangs beyond the vertical, and gravity turns it back


@pytest.mark.slow
def test_limits_of_torque_hold_on_draws_with_their_feedback() -> None:
    """Where torque is short the tool leaves its path, and a message says where."""
    tuned = tune_move(given(torque=420.0), move(0.5), "arm")
    assert np.all(tuned.most <= 420.0)
    assert np.all(np.abs(tuned.torque) <= 420.0)
    assert tuned.planned.max() > 1e-3
    assert "leaves its path by" in tuned.advice


@pytest.mark.slow
def test_the_shortest_time_is_that_in_which_the_error_is_just_kept() -> None:
    """A twentieth less time exceeds it."""
    tuned = tune_move(given(torque=420.0, draws=0), move(0.0), "arm")
    assert tuned.planned.max() <= 1e-3
    assert tune_move(given(torque=420.0, draws=0), move(0.95 * tuned.duration), "arm").planned.max() > 1e-3


def test_the_band_of_draws_holds_the_geometry_of_the_file() -> None:
    """A zero that is 1 mrad off turns a tool of 1.2 m by 1.2 mm, which the loop of the motor does not see."""
    asked = given(draws=1)
    robot = asked.draws[0].with_parameters({"zero_1": 1e-3})
    tuned = tune_move(replace(asked, draws=(robot,)), move(1.0), "arm")
    high = tuned.outcomes[-1].high
    assert high is not None
    reach = np.linalg.norm(tuned.target, axis=1).max()
    assert high.max() == pytest.approx(1e-3 * reach, rel=0.05)


def test_a_draw_that_no_loop_moves_is_refused() -> None:
    """A damping a hundred thousand times the estimate, of a fit that knows nothing of it."""
    asked = given(draws=1)
    (robot,) = asked.draws
    stiff = robot.with_parameters({"d_1": 1e5 * robot.parameters()["d_1"][0]})
    with refused("experiment/diverged"):
        tune_move(replace(asked, draws=(stiff,)), move(1.0), "arm")


@pytest.mark.parametrize(
    ("torque", "end"), [(20.0, END), (900.0, np.array([END[0], HIGHEST]))], ids=["gravity", "deflection"]
)
def test_an_end_that_no_motor_holds_is_refused(torque: float, end: FloatArray) -> None:
    """Gravity takes more than the motor has, in any time; or deflects so far that the motor stands at its limit."""
    with refused("use/move"):
        tune_move(given(torque, 0), point_to_point(START, end, 1.0), "arm")
