"""Taps on the tool of a six-axis robot with equations of its own, beside the responses of its motors."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elastid.base.errors import DataError
from elastid.fit.checks import check_responses
from elastid.record import JointLoop

sys.path.insert(0, str(Path(__file__).parents[3] / "scripts" / "studies"))
from load_tests import nominal, outside
from tool_side import FAULTS, WRIST, one_fit, taps


@pytest.mark.slow
def test_taps_make_a_wrist_known_that_motors_barely_move() -> None:
    """Ten times narrower and more, within four standard deviations of the truth, and no contradiction."""
    both, alone, truth = one_fit(0, also_alone=True)
    assert alone is not None
    assert both.tool is not None
    assert not both.tool.disagrees, both.tool.cause
    assert abs(both.tool.ratio - 1) < 4 * both.tool.ratio_std
    assert [each.configuration.name for each in both.linear] == [f"p{i}" for i in range(5)]
    for name in WRIST:
        assert both.std[name] < alone.std[name] / 10, name
        assert abs(both.values[name] - truth[name]) < 4 * both.std[name], name


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["sign", "gear"])
def test_a_contradiction_is_named_and_does_not_bend_the_numbers(fault: str) -> None:
    """The cause first, a misfit, a warning; the numbers of the motors alone, with intervals that hold the truth."""
    both, _, truth = one_fit(1, fault)
    assert both.tool is not None
    assert FAULTS[fault][1] in both.tool.cause.partition(" or ")[0]
    assert both.status == "misfit"
    assert "contradict" in both.message
    for name in ("k_1", "k_2", "k_3"):
        assert abs(both.values[name] - truth[name]) < 4 * both.std[name], name


def test_what_no_motor_can_do_is_refused() -> None:
    """Motors that are held and move, or are controlled by nothing; torques of motors and forces in one response."""
    robot = nominal()
    tapped = taps(outside(robot), np.random.default_rng(0))[0]
    loop = JointLoop(np.ones(6), np.ones(6), np.ones(6))
    mixed = (*tapped.inputs[:2], "motor 1")
    for wrong, words in (
        (replace(tapped, outputs=("motor 1", *tapped.outputs[1:])), "motor 1 does not move while the motors are held"),
        (replace(tapped, motors="controlled"), "give their loop"),
        (replace(tapped, motors="controlled", loop=loop), "without ki"),
        (replace(tapped, inputs=mixed), "beside forces at frames"),
        (replace(tapped, inputs=("motor 1", "motor 2", "motor 3")), "which are held, cannot act on them"),
        (replace(tapped, inputs=("force hok x", *tapped.inputs[1:])), "force hok x"),
    ):
        with pytest.raises(DataError, match=words):
            check_responses([wrong], robot)
