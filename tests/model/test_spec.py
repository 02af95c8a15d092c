"""The `model` section: what it refuses by itself, and for a robot."""

from __future__ import annotations

import pytest
from plants.linkages import linkage

from elastid.model.spec import ModelSpec


@pytest.mark.parametrize("formulation", [None, "serial", "constrained"])
def test_variants_and_independent_coordinates_are_choices_of_the_minimal_formulation(formulation: str | None) -> None:
    """Each alone."""
    for choice in ({"variant": "rigid_loop"}, {"independent": ("joint 2",)}):
        with pytest.raises(ValueError, match=f"{next(iter(choice))} is a choice of the minimal formulation"):
            ModelSpec(formulation, **choice)  # type: ignore[arg-type]
        ModelSpec("minimal", **choice)  # type: ignore[arg-type]


def test_keys_that_do_not_suit_a_robot_are_named_with_their_place() -> None:
    """Loops that a serial formulation leaves open; names that are no coordinates; others have their places."""
    robot = linkage()
    assert list(ModelSpec().refusals(robot)) == []
    ((key, words),) = ModelSpec("serial").refusals(robot)
    assert key == ("formulation",)
    assert "has loops (rod)" in words
    spec = ModelSpec("minimal", independent=("joint 2", "motor elbow", "motor 3", "rod rod"))
    assert [key for key, _ in spec.refusals(robot)] == [("independent", 1), ("independent", 3)]
