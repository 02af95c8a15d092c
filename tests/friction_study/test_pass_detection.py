"""Passes in the log of any motion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plants.cogged_joint import CoggedJoint, logged, reference, simulated
from plants.friction_logs import COULOMB, RATE, RATIO, VISCOUS, sliding_torque, trapezoids
from plants.refusals import refused

from elastid.base.arrays import FloatArray
from elastid.friction_study.levels import find_levels, passes_of
from elastid.friction_study.motion_signals import detect_passes
from elastid.record import FrictionRecord

SPEEDS = (0.02, 0.05, 0.2, 0.5, 1.0)


def record(q: FloatArray, **changes: Any) -> FrictionRecord:
    """A log with a 16-bit encoder on the motor."""
    count = 2 * np.pi / RATIO / 65536
    return FrictionRecord("log", "1", "motion", RATE, np.round(q / count) * count, sliding_torque(q), **changes)


def test_every_pass_of_a_log_is_found_and_its_levels_are_right() -> None:
    """Five speeds there and back under gravity of 2.5 times friction: levels within 0.2 %."""
    found = detect_passes(record(trapezoids(SPEEDS)), True)
    assert [each.speed for each in found] == pytest.approx(SPEEDS, rel=0.01)
    assert [each.name for each in found] == [f"log-{number}" for number in range(1, 6)]
    levels = find_levels([one for each in found for one in passes_of(each)], True, 2 * np.pi / RATIO)
    assert levels.torque == pytest.approx(COULOMB + VISCOUS * levels.speed, rel=2e-3)
    assert levels.notes == ()


def test_a_log_of_one_speed_gives_its_own_passes_alone() -> None:
    found = detect_passes(record(trapezoids((0.2, 0.5, 0.2)), speed=0.2), True)
    assert [each.speed for each in found] == pytest.approx([0.2, 0.2], rel=0.01)


def test_a_motion_without_plateaus_has_no_passes() -> None:
    t = np.arange(5000) / RATE
    assert detect_passes(record(0.5 * np.sin(2 * np.pi * 0.4 * t)), True) == ()


@pytest.mark.parametrize("position", [trapezoids((0.5,), travel=0.05), trapezoids((0.5,))[: round(2.1 * RATE)]])
def test_a_log_without_its_pass_is_refused(position: FloatArray) -> None:
    """Too short a way, and no way back."""
    with refused("friction/passes", holds="0.5 rad/s"):
        detect_passes(record(position, speed=0.5), True)


def test_ways_whose_speed_wanders_with_the_cogging_are_passes() -> None:
    """15 Nm of cogging on 115 Nm: twelve speeds of twelve, levels within 0.5 %, a slope of 12 % between directions."""
    joint = CoggedJoint(uneven=0.12 * 60)
    speeds = np.geomspace(0.05, 1.0, 12)
    ends = simulated([joint] * 12, [reference((speed,), 0.5, 1e-3) for speed in speeds], 1e-3)
    logs = [replace(logged(*end, 1e-3, i), name=f"log {i}") for i, end in enumerate(ends)]
    wander = np.gradient(ends[0][0])[3000:9000]
    assert wander.std() > 0.1 * wander.mean()
    passes = [each for log in logs for each in detect_passes(log, True)]
    assert [each.speed for each in passes] == pytest.approx(speeds, rel=0.02)
    levels = find_levels([one for each in passes for one in passes_of(each)], True, 2 * np.pi / RATIO)
    truth = [float(joint.level(v, s)) for v, s in zip(levels.speed, levels.direction, strict=True)]
    assert set(levels.direction) == {-1.0, 1.0}
    assert levels.torque == pytest.approx(truth, rel=5e-3)


def test_the_signals_of_a_pass_are_those_of_its_log() -> None:
    one = record(trapezoids((0.5,)), temperature=np.full(len(trapezoids((0.5,))), 40.0), start_s=100.0)
    (found,) = detect_passes(one, True)
    start = round((found.start_s - 100.0) * RATE)
    np.testing.assert_array_equal(found.torque, one.torque[start : start + len(found.torque)])
    assert found.mean_temperature == 40.0
    assert replace(found, notes=()).purpose == "passes"


def test_without_gravity_there_and_back_need_no_common_positions() -> None:
    """There at 0.5 rad/s in the first half of the travel, back at that speed in its second half."""
    speeds = np.repeat([0.0, 0.5, 0.25, 0.0, -0.5, -0.25, 0.0], [100, 400, 800, 200, 400, 800, 100])
    q = np.cumsum(np.convolve(speeds, np.hanning(100) / np.hanning(100).sum(), "same")) / RATE
    found = detect_passes(record(q), has_gravity=False)
    assert [each.speed for each in found] == pytest.approx([0.5, 0.25], rel=0.01)
    assert detect_passes(record(q), has_gravity=True) == ()
