"""Sections of a study of friction."""

import pytest

from elastid.friction_study.spec import (
    FilterSpec,
    LoadSpec,
    PassesSpec,
)


def test_a_filter_of_both_directions_has_no_state_of_either() -> None:
    with pytest.raises(ValueError, match=r"f\+ and f-"):
        FilterSpec(states=("f", "f+"))


def test_a_window_may_lie_below_zero_and_a_lone_load_need_no_name() -> None:
    """Positions have either sign; the robot as it is has no load to name."""
    assert PassesSpec(window=(-2.0, -1.0)).window == (-2.0, -1.0)
    assert LoadSpec("").payload == 0
