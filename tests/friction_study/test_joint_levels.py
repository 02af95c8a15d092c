"""The gain of a drive from motions with a payload once on and once off, on logs of a generator of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.friction_logs import COULOMB, INERTIA, RATE, RATIO, ROBOT, logs, sliding_torque, trapezoids, write_log
from plants.refusals import refused

from elastid.experiment.specs.recorded import FileSpec
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.friction_study.result import FrictionResult, identify_friction
from elastid.friction_study.spec import FrictionSpec
from elastid.recorded.friction_logs import read_friction_logs
from elastid.robot import Frame, Placement

LENGTH, PAYLOAD = 0.8, 5.0
ROBOT_WITH_TOOL = replace(ROBOT, frames=(Frame("tool", "arm", Placement((LENGTH, 0.0, 0.0))),))
Q = trapezoids([0.2, 0.5, 0.35])


def identified(folder: Path, gain: float, loads: tuple[str, ...], seed: int = 0) -> FrictionResult:
    a = np.gradient(np.gradient(Q, 1 / RATE), 1 / RATE)
    carried = PAYLOAD * (LENGTH**2 * a - 9.81 * LENGTH * np.cos(Q))
    for i, load in enumerate(loads):
        write_log(folder / f"{i}.csv", Q, gain * (sliding_torque(Q, seed + i) + (carried if load == "full" else 0.0)))
    files = [FileSpec(f"{i}.csv", load=load) for i, load in enumerate(loads)]
    payloads = {"empty": 0.0, "full": PAYLOAD}
    measured = read_friction_logs(ROBOT_WITH_TOOL, logs(*files), folder, ["1"], payloads)
    levels = find_joint_levels(ROBOT_WITH_TOOL, ROBOT_WITH_TOOL.driven, measured)
    return identify_friction(ROBOT_WITH_TOOL, levels, measured, FrictionSpec())


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.9, 1.0, 1.15])
def test_a_payload_on_and_off_gives_the_gain_with_its_interval(gain: float, tmp_path: Path) -> None:
    """Inside its interval in 7 of 8 draws and within 1 % in all; the order of the logs does not matter."""
    inside = []
    for seed in range(0, 16, 2):
        result = identified(tmp_path, gain, ("full", "empty"), seed)
        number = next(number for number in result.numbers if number.name == "gain_u_motor_1")
        assert number.value == pytest.approx(gain, rel=0.01)
        inside.append(number.low <= gain <= number.high)
    assert sum(inside) >= 7
    symbols = {number.symbol: number.value for number in result.numbers}
    assert symbols["J"] == pytest.approx(gain * INERTIA, rel=0.02)
    assert symbols["F_c"] == pytest.approx(gain * COULOMB, rel=0.05)


@pytest.mark.parametrize("loads", [("empty", "empty"), ("full", "full")])
def test_without_a_difference_no_gain_is_known(loads: tuple[str, ...], tmp_path: Path) -> None:
    assert not any(number.name.startswith("gain") for number in identified(tmp_path, 1.1, loads).numbers)


@pytest.mark.parametrize("factor", [1 / RATIO, 1 / RATIO**2, RATIO])
def test_mixed_sides_of_a_gear_are_refused(factor: float, tmp_path: Path) -> None:
    with refused("friction/rigid-body", place="0.csv"):
        identified(tmp_path, factor, ("empty",))
