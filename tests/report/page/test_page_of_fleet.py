"""The figure and the verdict of a fleet."""

from __future__ import annotations

import numpy as np
from plants.report_values import bars_of

from elastid.report.page.page_of_fleet import FleetContent, Outcome, fleet_parameter
from elastid.validation.fleet import FleetValue


def test_values_are_in_the_column_of_their_robot_and_findings_apart() -> None:
    """Two dates of each robot lie left and right of its name."""
    values = [FleetValue(robot, day, "k_1", i + day, 0.1) for i, robot in enumerate("AB") for day in (0.0, 1.0)]
    points = bars_of(fleet_parameter("k_1", "N*m/rad", values, {"B"}).axes[0])
    np.testing.assert_allclose(points["robot, dates from left to right"], ((-0.15, 0.15), (0.0, 1.0)))
    np.testing.assert_allclose(points["differs or drifts"], ((0.85, 1.15), (1.0, 2.0)))


def test_the_verdict_counts_what_was_identified() -> None:
    outcomes = (Outcome("A", "2026-01-01", "converged", ""), Outcome("B", "2026-01-01", "died", "no memory"))
    verdict = FleetContent("fleet", (), {}, (), outcomes, 0.05, "elastid").verdict
    assert verdict == "2 robots, 1 of 2 measurements identified: no parameter differs or drifts beyond its interval."
