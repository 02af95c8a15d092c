"""A spring hardens, or is refused with the deflection at which it would lose its stiffness."""

from __future__ import annotations

import pytest

from elastid.robot import Spring


def test_a_softening_spring_is_refused_with_the_deflection_at_which_its_tangent_vanishes() -> None:
    # a + 2 s x = 0 with a = 1000 and s = -500 to the positive side.
    with pytest.raises(ValueError, match=r"positive deflection of 1 rad"):
        Spring(stiffness=1000.0, quadratic=-500.0)
    assert not Spring(stiffness=1000.0, quadratic=-500.0, cubic=100.0).is_linear  # 500^2 < 3 1000 100


def test_optional_terms_have_names_only_where_they_are_given() -> None:
    assert set(Spring(1.0).numbers("1")) == {"k_1", "d_1"}
    assert set(Spring(1.0, backlash=0.1).numbers("1")) == {"k_1", "d_1", "b_1", "ki_1", "e_1"}
