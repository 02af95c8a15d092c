"""Rows of the table of friction."""

from __future__ import annotations

import math

import pytest
from plants.taken_friction import LEVELS, STDS, taken_friction

from elastid.report.friction_content import friction_rows


def test_sliding_friction_is_the_sum_of_its_levels_with_their_covariance() -> None:
    """F_c 4.5 Nm; a motor that keeps its friction has no level."""
    taken, kept = friction_rows(taken_friction())
    std = math.hypot(*STDS)
    assert (taken.level, taken.std) == (sum(LEVELS), pytest.approx(std))
    assert taken.interval == pytest.approx((4.5 - 1.959964 * std, 4.5 + 1.959964 * std))
    assert (taken.unit, taken.kept_share) == ("N*m", 0.0321)
    assert (kept.place, kept.unit, kept.level, kept.interval) == ("motor 2", "N", None, None)
