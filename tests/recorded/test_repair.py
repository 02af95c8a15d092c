"""The repetitions of a signal."""

from __future__ import annotations

import numpy as np
from plants.waves import CLEAN, DRIFT, N

from elastid.recorded.repair import Finding, counts, flat


def test_flat_removes_offset_and_slope_of_each_period_and_counts_add_up() -> None:
    """What is left is the periodic signal without its own line."""
    x = CLEAN[:, 1] + DRIFT[:, 1]
    np.testing.assert_allclose(flat(x, N), flat(CLEAN[:, 1], N), atol=1e-7)
    assert counts([Finding("a", 1, ""), Finding("b", 2, ""), Finding("a", 3, "")]) == {"a": 4, "b": 2}
