"""Taps on the tool of a six-axis robot with equations of its own, beside the responses of its motors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.refusals import refused
from plants.tapped_arm import FAULTS, WRIST, one_fit, taps
from plants.weighed_arm import nominal, outside

import elastid as ei
from elastid.fit.checks import check_responses
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.record import JointLoop
from elastid.response import Covariance
from elastid.study import load_robot


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
@pytest.mark.parametrize(("fault", "seed"), [("sign", 2), ("gear", 1)])
def test_a_contradiction_is_named_and_does_not_bend_the_numbers(fault: str, seed: int) -> None:
    """The cause first, a misfit, a warning; the numbers of the motors alone, with intervals that hold the truth.

    Of sign 2 a step of a wrong cause goes so far that slopes overflow.
    """
    both, _, truth = one_fit(seed, fault)
    assert both.tool is not None
    assert FAULTS[fault][1] in both.tool.cause.partition(" or ")[0]
    assert both.status == "misfit"
    assert "contradict" in both.message
    for name in ("k_1", "k_2", "k_3"):
        assert abs(both.values[name] - truth[name]) < 4 * both.std[name], name


def test_a_sensor_that_was_not_plugged_in_says_nothing(tiny: Path) -> None:
    """Zeros at the tool: a warning, the motors' numbers as they are, and no disagreement."""
    file, where = tiny.with_name("robot.yml"), ei.Configuration("a", np.zeros(1))
    file.write_text(file.read_text() + "frames: [{name: tool, body: load, placement: {xyz: [0.4, 0, 0]}}]\n")
    robot = load_robot(file)
    f = np.linspace(5, 80, 30)
    s = (2j * np.pi * f)[:, None, None]
    inertia, spring = 1e-3 * s**2, 0.01 * s + 60
    G = s**2 * (inertia + spring) / ((inertia + 1e-3 * s + spring) * (inertia + spring) - spring**2)
    of_motor = ei.Response(
        f, G, ("motor 1",), ("motor 1",), "acceleration", where, noise=Covariance(1e-4 * np.abs(G) ** 2, 1e4)
    )
    tool = ("force tool y",), ("frame tool y",)
    silent = ei.Response(
        f, 0 * G, *tool, "acceleration", ei.Configuration("a at the tool", np.zeros(1)),
        noise=Covariance(0 * np.abs(G), 1e4), motors="held",
    )  # fmt: skip
    result = identify([of_motor, silent], robot, FitSpec(parameters={"k_1": ParameterSpec()}, starts=1))
    assert result.tool is not None
    assert not result.tool.disagrees
    assert "none is more than noise" in result.tool.words
    assert result.tool.ratio_std == np.inf
    assert any("frame tool y" in note.text for note in result.notes)
    assert result.values["k_1"] == pytest.approx(60, rel=1e-6)


def test_what_no_motor_can_do_is_refused() -> None:
    """Motors that are held and move, or are controlled by nothing; torques of motors and forces in one response."""
    robot = nominal()
    tapped = taps(outside(robot), np.random.default_rng(0))[0]
    loop = JointLoop(np.ones(6), np.ones(6), np.ones(6))
    mixed = (*tapped.inputs[:2], "motor 1")
    for wrong in (
        replace(tapped, outputs=("motor 1", *tapped.outputs[1:])),
        replace(tapped, motors="controlled"),
        replace(tapped, motors="controlled", loop=loop),
        replace(tapped, inputs=mixed),
        replace(tapped, inputs=("motor 1", "motor 2", "motor 3")),
        replace(tapped, inputs=("force hok x", *tapped.inputs[1:])),
    ):
        with refused("fit/responses", place=f"configuration {tapped.configuration.name}"):
            check_responses([wrong], robot)
