"""Goals are read as people write them, and used as wide as the intervals are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from elastid.base.errors import StudyError
from elastid.design.goal import read_goal
from elastid.parameters import Parameter, ParameterSet

NAMES = ("k_1", "k_2", "d_1", "c_1")


def test_patterns_lists_and_several_goals_name_parameters() -> None:
    """The narrower counts where two goals name one."""
    assert read_goal(["k_*: 1 %"], NAMES).widths == {"k_1": 0.01, "k_2": 0.01}
    assert read_goal(["k_*: 1 %, d_1:5%", "k_2: 0.5 %"], NAMES).widths == {"k_1": 0.01, "k_2": 0.005, "d_1": 0.05}
    assert read_goal(["k_2: 0.5 %", "k_*: 1 %"], NAMES).widths["k_2"] == 0.005


@pytest.mark.parametrize("text", ["", "k_1", "k_1: ", "k_1: one %", "k_1: 0 %", "k_1: 100 %", "k_1: nan %", ": 1 %"])
def test_a_text_without_a_width_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(StudyError, match=r'"k_\*: 1 %"'):
        read_goal([text], NAMES)


def test_a_name_that_is_none_is_refused_with_the_nearest() -> None:
    with pytest.raises(StudyError, match="did you mean 'k_1'"):
        read_goal(["k1: 1 %"], NAMES)


def test_the_used_part_is_the_half_width_over_the_goal() -> None:
    """Of a logarithmic parameter by the deviation of its logarithm, of a linear one relative to its value."""
    free = (Parameter("k_1", 2e5, log=True), Parameter("c_1", -4.0))
    parameters = ParameterSet(free)
    used = read_goal(["*: 1 %"], ("k_1", "c_1")).used(parameters, np.array([math.log(2e5), -4.0]), np.diag([1e-4, 1.0]))
    np.testing.assert_allclose(used, [1.96, 1.96 / 4 / 0.01], rtol=1e-3)
