"""A placement comes back from its rotation matrix, also where roll and yaw turn about the same axis; named numbers."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.robot import Body, Joint, Placement, Spring, unit_axis
from elastid.robot.placement import below, number_at, replaced


@pytest.mark.parametrize("rpy", [(0.3, -0.4, 1.2), (-2.0, 1.5, 3.0), (0.7, np.pi / 2, 0.0), (0.7, -np.pi / 2, 0.4)])
def test_a_rotation_survives_the_way_over_its_matrix(rpy: tuple[float, float, float]) -> None:
    R = Placement(rpy=rpy).rotation
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(Placement.of(R, np.zeros(3)).rotation, R, atol=1e-12)


def test_the_zero_vector_is_no_axis() -> None:
    np.testing.assert_allclose(unit_axis((3.0, 0.0, 4.0)), [0.6, 0.0, 0.8])
    with pytest.raises(ValueError, match="zero vector"):
        unit_axis((0.0, 0.0, 0.0))


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
