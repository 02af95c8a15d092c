"""Differences and trends of a fleet are found at the stated false discovery rate."""

import numpy as np
import pytest

from elastid.validation.fleet import FleetValue, find_changes


def fleet(seed: int, robots: int, softened: float = 0.0, drift: float = 0.0) -> list[FleetValue]:
    """k and d of robots on three dates, 1 and 5 % known; robot 3 is softer, robot 5 drifts."""
    rng = np.random.default_rng(seed)
    values = []
    for robot in range(robots):
        for day in (0.0, 180.0, 360.0):
            for name, true, part in (("k_1", 1e5, 0.01), ("d_1", 40.0, 0.05)):
                here = true * (1 - softened * (robot == 3 and name == "k_1"))
                here *= 1 - drift * day / 360 * (robot == 5 and name == "k_1")
                values.append(
                    FleetValue(f"r{robot}", day, name, here * (1 + part * rng.standard_normal()), part * here)
                )
    return values


def test_a_softer_gear_and_a_drift_are_found_and_named() -> None:
    """Both first, with their sizes."""
    found = find_changes(fleet(1, 64, softened=0.06, drift=0.08), 0.05)
    (off,) = [finding for finding in found if finding.kind == "differs" and finding.robot == "r3"]
    (drifting,) = [finding for finding in found if finding.kind == "drifts"]
    assert off.parameter == "k_1"
    assert off.change == pytest.approx(-0.06, abs=0.02)
    assert drifting.robot == "r5"
    assert drifting.change == pytest.approx(-0.08, abs=0.04)
    assert "k_1 of r5 drifts: the spring softens, -" in drifting.words


def test_an_equal_fleet_has_false_findings_at_the_stated_rate() -> None:
    """A fleet without differences or trends reports something in 5 % of cases: here of 200."""
    rates = [bool(find_changes(fleet(seed, 12), 0.05)) for seed in range(200)]
    assert np.mean(rates) < 0.05 + 3 * np.sqrt(0.05 / 200)


def test_numbers_that_were_held_and_two_robots_tell_no_difference() -> None:
    """No std, no test; of two robots neither is the odd one."""
    held = [FleetValue(f"r{i}", 0.0, "k_1", 1.0 + i, 0.0) for i in range(5)]
    assert find_changes(held, 0.05) == ()
    pair = [FleetValue(f"r{i}", 0.0, "k_1", 1.0 + i, 0.01) for i in range(2)]
    assert find_changes(pair, 0.05) == ()


def test_one_odd_robot_of_three_does_not_make_the_others_odd() -> None:
    """Two of a kind are the fleet."""
    three = [FleetValue(f"r{i}", 0.0, "k_1", 54.0 if i == 2 else 60.0 + 0.01 * i, 0.05) for i in range(3)]
    assert [finding.robot for finding in find_changes(three, 0.05)] == ["r2"]
