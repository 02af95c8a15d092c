"""The modal model at given poles: orthogonal columns of it, near and far from dependence."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.modal.model import orthogonal


@pytest.mark.parametrize("gap", [1.0, 1e-3, 1e-6, 1e-12])
def test_columns_are_made_orthogonal_however_near_two_of_them_are(gap: float) -> None:
    """To rounding, with an upper triangle that gives the columns back; Cholesky alone would lose a gap squared."""
    rng = np.random.default_rng(0)
    A = rng.standard_normal((400, 12))
    A[:, 1] = A[:, 0] + gap * A[:, 1]
    A /= np.linalg.norm(A, axis=0)
    Q, R = orthogonal(A)
    np.testing.assert_allclose(Q @ R, A, atol=1e-14)
    np.testing.assert_allclose(Q.T @ Q, np.eye(12), atol=1e-13)
    np.testing.assert_array_equal(R, np.triu(R))
