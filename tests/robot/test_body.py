"""An inertia tensor that is physically impossible is refused; the isotropic one is a multiple of the unit matrix."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.robot import Body


def test_principal_moments_obey_the_triangle_inequality() -> None:
    Body("plate", inertia=(1.0, 1.0, 2.0))  # the limit: a flat body
    with pytest.raises(ValueError, match="no body has the principal inertias"):
        Body("impossible", inertia=(1.0, 1.0, 2.1))


def test_off_diagonal_entries_are_those_of_the_tensor() -> None:
    matrix = Body("b", inertia=(3.0, 4.0, 5.0, 0.1, 0.2, 0.3)).inertia_matrix
    np.testing.assert_array_equal(matrix, [[3.0, 0.1, 0.2], [0.1, 4.0, 0.3], [0.2, 0.3, 5.0]])
    np.testing.assert_array_equal(Body("ball", inertia=2.0).inertia_matrix, 2 * np.eye(3))
