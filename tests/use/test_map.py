"""Maps of the workspace: quantities in closed form, order, limiting springs, intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from plants.predicted_arm import STD, result
from plants.refusals import refused

from elastid.use.map import map_workspace

ANGLES = np.array([[0.2, 0.4], [-0.7, 1.1], [0.9, -0.5], [0.1, 0.05]])


def test_the_softest_first_and_the_spring_that_gives_most() -> None:
    """Shares of the springs add up to 1 under no gravity's help; the order is that of the compliance."""
    workspace = map_workspace(result(), ANGLES)
    value = workspace["softest_compliance"].value
    assert np.all(np.diff(value[workspace.softest]) <= 0)
    assert workspace.asked.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(workspace.share.sum(axis=1), 1.0, rtol=0.05)  # the rest is gravity's
    largest = [workspace.springs[i] for i in workspace.share.argmax(axis=1)]
    assert workspace.limiting_springs == tuple(largest)


def test_intervals_are_those_of_the_stiffness() -> None:
    """All springs 2 % off independently: the softest compliance between 2 %/sqrt(2) and 2 % off, in logarithm."""
    quantity = map_workspace(result(), ANGLES)["softest_compliance"]
    assert np.all((quantity.relative_std > 0.9 * STD / np.sqrt(2)) & (quantity.relative_std < 1.1 * STD))
    low, high = quantity.interval
    np.testing.assert_allclose(np.log(high / low), 2 * 1.959964 * quantity.relative_std, rtol=1e-9)


def test_where_nothing_rests_the_map_says_why() -> None:
    """A robot of rubber."""
    own = result()
    rubber = replace(own, x=own.x - np.log(4e4))
    with refused("robot/no-rest", holds="1 postures"):
        map_workspace(rubber, np.array([[-0.2, 0.1]]))
