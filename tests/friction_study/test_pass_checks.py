"""Faults of passes are said with their numbers, and clean passes have none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.friction_logs import INERTIA, RATIO, ROBOT
from plants.refusals import refused

from elastid.friction_study.joint_levels import check_sides, joint_inertia
from elastid.friction_study.levels import PassLevels, find_levels
from elastid.friction_study.passes import Pass

RATE, N = 200.0, 400


def passes(speeds: Sequence[float], seed: int = 0, gravity: float = 20.0, uneven: float = 0.0) -> list[Pass]:
    """There and back at each speed about a horizontal arm: Coulomb 10 Nm, viscous 5 Nms/rad, noise 0.3 Nm."""
    rng, found = np.random.default_rng(seed), []
    for k, speed in enumerate(speeds):
        for s in (1.0, -1.0):
            q = s * (np.arange(N) / N - 0.5) * 0.4
            v = np.full(N, s * speed)
            u = s * (10 + 5 * speed) + uneven * speed + gravity * np.cos(q) + 0.3 * rng.standard_normal(N)
            found.append(Pass("joint 1", f"p{k}", RATE, q, v, np.zeros(N), u))
    return found


def codes(levels: PassLevels) -> list[str]:
    return [note.code for note in levels.notes]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0, 100), st.sampled_from([0.0, 3.0]))
def test_clean_passes_raise_no_alarm(seed: int, gravity: float, uneven: float) -> None:
    """Whatever gravity, and friction that differs between the directions."""
    speeds = np.random.default_rng(seed).permutation(np.geomspace(0.05, 2.0, 8))
    assert codes(find_levels(passes(speeds.tolist(), seed, gravity, uneven), True)) == []


def test_a_clipped_pass_does_not_count() -> None:
    clean = passes([0.1, 0.5, 1.0])
    limit = float(np.quantile(clean[4].torque, 0.8))
    spoilt = [replace(each, torque=np.minimum(each.torque, limit)) for each in clean]
    levels = find_levels(spoilt, True)
    assert codes(levels) == ["friction/passes"]
    assert levels.levels.speed == pytest.approx([0.1, 0.5])


@pytest.mark.parametrize("factor", [1 / RATIO, 1 / RATIO**2, RATIO])
def test_mixed_sides_of_a_gear_are_refused(factor: float) -> None:
    (joint,) = ROBOT.joints
    with refused("friction/rigid-body"):
        check_sides(ROBOT, joint, INERTIA * factor, 1e-3 * INERTIA * factor, None, "log.csv")


def test_inertias_that_are_roughly_right_or_not_known_are_not_refused() -> None:
    (joint,) = ROBOT.joints
    assert joint_inertia(ROBOT, joint, None) == pytest.approx(INERTIA)
    for inertia, std in ((0.5 * INERTIA, 0.1), (3 * INERTIA, 0.1), (INERTIA / RATIO, INERTIA), (-1.0, 0.1)):
        check_sides(ROBOT, joint, inertia, std, None, "log.csv")
