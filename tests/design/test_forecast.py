"""The forecast of a plan: correlations, and the limit of which most is used."""

from __future__ import annotations

import numpy as np

from elastid.design.forecast import LimitUse


def test_closest_limit_is_the_one_with_the_largest_share() -> None:
    peak, limit = np.ones((1, 5, 2)), np.full((1, 5, 2), 10.0)
    peak[0, 2, 1] = 8.0
    use = LimitUse(("bent",), ("motor 1", "motor 2"), peak, limit, np.ones((1, 2)), 0.1)
    assert "80% of a limit (velocity of motor 2 in bent: 8 of 10 rad/s)" in use.closest
    assert LimitUse(("bent",), ("motor 1",), peak, np.full((1, 5, 2), np.inf), np.ones((1, 2)), 0.1).closest == (
        "no limits are given"
    )
