"""The section `design`: parameters of interest, and the configurations that fit into a robot time."""

from __future__ import annotations

import numpy as np
from plants.refusals import refused

from elastid.design.spec import interest


def test_patterns_select_columns_of_the_identity() -> None:
    names = ("k_1", "d_1", "k_2")
    np.testing.assert_array_equal(interest(names, ["k_*"]), np.eye(3)[:, [0, 2]])
    np.testing.assert_array_equal(interest(names, ()), np.eye(3))
    with refused("design/goal"):
        interest(names, ["k_3"])
