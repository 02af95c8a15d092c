"""A loop joins two bodies in one way; a rigid rod has neither stiffness nor damping."""

from __future__ import annotations

import pytest

from elastid.robot import Anchor, Loop, Pin, Rod

ENDS = (Anchor("lever"), Anchor("arm"))


def test_a_loop_is_closed_in_one_way_between_two_bodies() -> None:
    with pytest.raises(ValueError, match="not both"):
        Loop("pull", ENDS, Pin(), Rod(0.5))
    with pytest.raises(ValueError, match="both ends are on arm"):
        Loop("pull", (Anchor("arm"), Anchor("arm")))


def test_only_an_elastic_rod_has_stiffness_and_damping_as_parameters() -> None:
    assert set(Loop("pull", ENDS, rod=Rod(0.5)).numbers) == {"m_pull", "a_pull", "I_pull"}
    assert {"k_pull", "d_pull"} < set(Loop("pull", ENDS, rod=Rod(0.5, stiffness=1e6)).numbers)
    with pytest.raises(ValueError, match="a rigid rod does not stretch"):
        Rod(0.5, damping=1.0)
