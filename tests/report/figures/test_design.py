"""Figures of a plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.arm_modes import ANGLES, ARM
from plants.report_values import plan

from elastid.design.forecast import Forecast
from elastid.model.kinematics import link_angles
from elastid.model.stick_figure import stick_figure
from elastid.record import Configuration
from elastid.report.figures.design import configuration_sketches, excitation, information


def test_the_excitation_figure_shows_one_period_of_every_input():
    """The torque that the plan injects in its first experiment, and its line amplitudes."""
    given = plan(3)
    panels = excitation(given).axes
    assert len(panels) == 6
    for j in range(3):
        spectrum, time = panels[2 * j], panels[2 * j + 1]
        np.testing.assert_allclose(spectrum.get_lines()[0].get_ydata(), 30.0)
        np.testing.assert_allclose(time.get_lines()[0].get_ydata(), given.torque(given.experiments[0])[:, j])


def forecast():
    """Two configurations of 4 lines, three parameters; the second line from the top is in the band of the first."""
    share = np.random.default_rng(0).random((2, 4, 3))
    share /= share.sum(axis=(0, 1))
    freq_hz = np.array([2.0, 10.0, 40.0, 40.1])
    return Forecast(("k", "d", "m"), ("",) * 3, np.ones(3), (True,) * 3, np.eye(3), ("a", "b"), freq_hz, share,
                    np.empty((0, 3)), ())  # fmt: skip


def test_the_information_figure_shows_the_shares_of_the_forecast():
    """In percent: by band, NaN between the lines, the mean over the parameters; by parameter, written where 0.5 %."""
    given = forecast()
    left, right = information(given).axes
    by_band = np.ma.filled(left.collections[0].get_array(), np.nan).reshape(2, -1)
    assert np.isfinite(by_band).sum() == 2 * 3
    np.testing.assert_allclose(np.nansum(by_band, axis=1), 100 * given.share.mean(axis=2).sum(axis=1))
    expected = 100 * given.share.sum(axis=1)
    np.testing.assert_allclose(right.images[0].get_array(), expected)
    assert [text.get_text() for text in right.texts] == [f"{value:.0f}" for value in expected.ravel()]
    assert [label.get_text() for label in left.get_yticklabels()] == ["a", "b"]
    assert left.get_ylim()[0] > left.get_ylim()[1]


@pytest.mark.parametrize("gravity", [(0, 0, -9.81), (0, 0, 9.81)])
def test_a_robot_is_sketched_with_gravity_pointing_down(gravity):
    """Its tool is above the base where it stands, below where it hangs, at the kinematics' position."""
    robot = replace(ARM, gravity=gravity)
    configuration = Configuration("reach", np.array(ANGLES))
    (axes,) = configuration_sketches(robot, [configuration], ["two realisations"]).axes
    (dots,) = [line for line in axes.get_lines() if line.get_marker() == "o"]
    heights = np.asarray(dots.get_data_3d()[2])
    expected = stick_figure(robot, link_angles(robot, np.array([ANGLES]))[0])
    sign = -np.sign(gravity[2])
    np.testing.assert_allclose(heights, sign * expected.points[list(expected.joints), 2])
    assert axes.get_title() == "reach\ntwo realisations"
