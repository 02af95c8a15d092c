"""A placement comes back from its rotation matrix, also where roll and yaw turn about the same axis; named numbers."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.robot import Placement, unit_axis


@pytest.mark.parametrize("rpy", [(0.3, -0.4, 1.2), (-2.0, 1.5, 3.0), (0.7, np.pi / 2, 0.0), (0.7, -np.pi / 2, 0.4)])
def test_a_rotation_survives_the_way_over_its_matrix(rpy: tuple[float, float, float]) -> None:
    R = Placement(rpy=rpy).rotation
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(Placement.of(R, np.zeros(3)).rotation, R, atol=1e-12)


def test_the_zero_vector_is_no_axis() -> None:
    np.testing.assert_allclose(unit_axis((3.0, 0.0, 4.0)), [0.6, 0.0, 0.8])
    with pytest.raises(ValueError, match="zero vector"):
        unit_axis((0.0, 0.0, 0.0))
