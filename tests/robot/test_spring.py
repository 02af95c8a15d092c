"""A spring hardens, or is refused with the deflection at which it would lose its stiffness."""

from __future__ import annotations

from elastid.robot import Spring


def test_optional_terms_have_names_only_where_they_are_given() -> None:
    assert set(Spring(1.0).numbers("1")) == {"k_1", "d_1"}
    assert set(Spring(1.0, backlash=0.1).numbers("1")) == {"k_1", "d_1", "b_1", "ki_1", "e_1"}
