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
    assert "k_1 of r5 drifts" in drifting.words


def test_an_equal_fleet_has_false_findings_at_the_stated_rate() -> None:
    """A fleet without differences reports something in at most about 10 % of cases: 5 % for each of two kinds."""
    rates = [bool(find_changes(fleet(seed, 12), 0.05)) for seed in range(200)]
    assert np.mean(rates) < 0.16


def test_numbers_that_were_held_and_two_robots_tell_no_difference() -> None:
    """No std, no test; of two robots nobody knows which is the odd one."""
    held = [FleetValue(f"r{i}", 0.0, "k_1", 1.0 + i, 0.0) for i in range(5)]
    assert find_changes(held, 0.05) == ()
    pair = [FleetValue(f"r{i}", 0.0, "k_1", 1.0 + i, 0.01) for i in range(2)]
    assert find_changes(pair, 0.05) == ()
