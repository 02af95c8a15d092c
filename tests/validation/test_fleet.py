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


def natural(seed: int, softened: float = 0.0, days: tuple[float, ...] = (0.0,), robots: int = 8) -> list[FleetValue]:
    """Three springs of robots that differ by 1.5 %, known to 0.03 %, and by 0.5 % from date to date; robot 2 softer."""
    rng = np.random.default_rng(seed)
    return [
        FleetValue(f"r{robot}", day, name, k, 3e-4 * k)
        for robot in range(robots)
        for name in ("k_1", "k_2", "k_3")
        for own in [0.015 * rng.standard_normal() + np.log1p(-softened * (robot == 2 and name == "k_1"))]
        for day in days
        for k in [1e5 * float(np.exp(own + (0.005 * (len(days) > 1) + 3e-4) * rng.standard_normal()))]
    ]


@pytest.mark.parametrize("days", [(0.0,), (0.0, 180.0), (0.0, 90.0, 180.0)])
def test_typical_scatter_of_fleet_is_not_reported(days):
    """Stds of 0.03 % beside 1.5 % between robots: 5 % of fleets at most, where z by the fits alone names seven of 8.

    Where no robot has a third date, the others' changes say what dates differ by.
    """
    assert np.mean([bool(find_changes(natural(seed, days=days), 0.05)) for seed in range(60)]) <= 0.05


def test_soft_gear_is_reported_in_varied_fleet() -> None:
    """Of 8 robots, in 95 % of fleets, and hardly another with it."""
    findings = [find_changes(natural(seed, softened=0.1), 0.05) for seed in range(100)]
    assert np.mean([any((f.robot, f.parameter) == ("r2", "k_1") for f in each) for each in findings]) >= 0.95
    assert np.mean([any(f.robot != "r2" for f in each) for each in findings]) <= 0.05


def test_two_dates_of_one_number_are_no_trend() -> None:
    """The change of one spring of one robot is compared with nothing: the fit's std alone would name it in 86 %."""
    one = [value for value in natural(0, days=(0.0, 180.0), robots=1) if value.parameter == "k_1"]
    assert find_changes(one, 0.05) == ()


def test_a_softer_gear_and_a_drift_are_found_and_named() -> None:
    found = find_changes(fleet(1, 64, softened=0.06, drift=0.08), 0.05)
    (off,) = [finding for finding in found if finding.kind == "differs" and finding.robot == "r3"]
    (drifting,) = [finding for finding in found if finding.kind == "drifts"]
    assert off.parameter == "k_1"
    assert off.change == pytest.approx(-0.06, abs=0.02)
    assert drifting.robot == "r5"
    assert drifting.change == pytest.approx(-0.08, abs=0.04)
    assert f"k_1 of r5 drifts: the spring softens, {drifting.change:+.2%}" in drifting.sentence
    assert drifting.z == pytest.approx(np.log1p(drifting.change) / (0.01 * np.sqrt(2)), rel=0.1)


def test_one_odd_robot_leaves_others_unreported() -> None:
    """Two of a kind are the fleet."""
    three = [FleetValue(f"r{i}", 0.0, "k_1", 54.0 if i == 2 else 60.0 + 0.01 * i, 0.05) for i in range(3)]
    assert [finding.robot for finding in find_changes(three, 0.05)] == ["r2"]
