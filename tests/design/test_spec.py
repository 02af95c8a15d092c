"""The section `design`: parameters of interest, and the configurations that fit into a robot time."""

from __future__ import annotations

import numpy as np
import pytest
from plants.refusals import refused

from elastid.design.spec import BoxSpec, CandidateSpec, DesignSpec, GuessSpec, interest


def test_patterns_select_columns_of_the_identity() -> None:
    names = ("k_1", "d_1", "k_2")
    np.testing.assert_array_equal(interest(names, ["k_*"]), np.eye(3)[:, [0, 2]])
    np.testing.assert_array_equal(interest(names, ()), np.eye(3))
    with refused("design/goal"):
        interest(names, ["k_3"])


def test_sections_without_a_meaning_are_refused() -> None:
    with pytest.raises(ValueError, match="below that of upper"):
        BoxSpec("table", (0, 0, 0), (1, 0, 1))
    with pytest.raises(ValueError, match="only one of random, grid and given"):
        CandidateSpec(random=3, grid=2)
    with pytest.raises(ValueError, match="factor above 1"):
        GuessSpec(factor=1.0)
    with pytest.raises(ValueError, match="either count"):
        DesignSpec()
