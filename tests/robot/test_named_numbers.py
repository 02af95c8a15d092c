"""Numbers are read and replaced by their paths; the description is checked once all of them are in it."""

from __future__ import annotations

import pytest

from elastid.robot import Body, Joint, Spring
from elastid.robot.named_numbers import below, number_at, replaced

BODY = Body("arm", joints=(Joint("1", spring=Spring(100.0)),), inertia=(1.0, 1.0, 1.0))
STIFFNESS = ("joints", 0, "spring", "stiffness")


def test_a_number_is_found_and_replaced_at_its_path() -> None:
    changed = replaced(BODY, {STIFFNESS: 7.0, ("mass",): 2.0})
    assert (number_at(changed, STIFFNESS), changed.mass, number_at(BODY, STIFFNESS)) == (7.0, 2.0, 100.0)
    assert below("spring", {"k": ("N*m/rad", ("stiffness",))}) == {"k": ("N*m/rad", ("spring", "stiffness"))}


def test_numbers_that_are_possible_only_together_are_replaced_together() -> None:
    larger = replaced(BODY, {("inertia", i): 5.0 for i in range(3)})
    assert larger.inertia == (5.0, 5.0, 5.0)
    with pytest.raises(ValueError, match="no body has the principal inertias"):
        replaced(BODY, {("inertia", 0): 5.0})
