"""Units and limits of a joint's motion are checked where the joint is described."""

from __future__ import annotations

import pytest

from elastid.robot import Joint, Limits, Spring


def test_a_sliding_joint_has_no_point_and_units_of_a_translation() -> None:
    rail = Joint("rail", motion="translation", spring=Spring(1e6))
    assert (rail.unit, rail.numbers["k_rail"][0], rail.numbers["f_rail"][0]) == ("m", "N/m", "N*s/m")
    assert rail.geometry == {}
    with pytest.raises(ValueError, match="leave out point"):
        Joint("rail", motion="translation", point=(0.0, 0.0, 0.1))


def test_limits_leave_room_for_motion() -> None:
    with pytest.raises(ValueError, match="limits leave no motion"):
        Limits(angle=(1.0, 1.0))
