"""Figures of a plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.arm_modes import ANGLES, ARM
from plants.report_values import plan

from elastid.design.forecast import Forecast
from elastid.design.limits import QUANTITIES, LimitUse
from elastid.experiment.plan.movement import Rehearsal
from elastid.experiment.plan.plan import Experiment
from elastid.model.closed_posture import followed
from elastid.model.kinematics import stick_figure
from elastid.record import Configuration
from elastid.report.figures.design import (
    configuration_sketches,
    excitation,
    information,
    limit_use,
    nearest_run_signals,
)


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
    expected = stick_figure(robot, followed(robot, np.array([ANGLES]))[0])
    sign = -np.sign(gravity[2])
    np.testing.assert_allclose(heights, sign * expected.points[list(expected.joints), 2])
    assert axes.get_title() == "reach\ntwo realisations"


def use():
    """Torque uses 80 % and 10 %; velocity has a limit for one motor."""
    peak, limit = np.ones((1, len(QUANTITIES), 2)), np.full((1, len(QUANTITIES), 2), np.inf)
    limit[0, 0] = 1.25, 10.0
    limit[0, 2, 0] = 2.0
    return LimitUse(("c1",), ("motor 1", "motor 2"), peak, limit, np.ones((1, 2)), margin=0.1)


def test_peaks_are_written_in_percent_of_their_limits():
    """A panel for each quantity with a limit; grey where a motor has none."""
    torque, velocity = limit_use(use()).axes
    np.testing.assert_allclose(torque.images[0].get_array(), [[80.0, 10.0]])
    assert [text.get_text() for text in torque.texts] == ["80", "10"]
    assert [text.get_text() for text in velocity.texts] == ["50"]
    assert "velocity" in velocity.get_title()
    assert [label.get_text() for label in torque.get_yticklabels()] == ["c1"]


def test_a_run_is_drawn_between_the_limits_that_it_comes_near():
    """Limits and margins on both sides of the torque that uses 80 %; 10 % is a number; unmeasured time is shaded."""
    t = np.arange(4000)
    torque = np.stack([np.sin(t / 300), np.cos(t / 300)], axis=1)
    run = Rehearsal(Experiment(Configuration("c1", np.zeros(2)), 0, 0), 250.0, 700, np.zeros((4000, 2)), torque)
    figure = nearest_run_signals(run, use(), plan(2))
    near, _, far, _ = figure.axes
    signal, *limits = near.get_lines()
    assert np.abs(signal.get_ydata()).max() == pytest.approx(1.0, abs=1e-4)
    assert sorted(line.get_ydata()[0] for line in limits) == [-1.25, 1.25]
    spans = [patch.get_extents().transformed(near.transData.inverted()) for patch in near.patches]
    assert sorted(round(span.y1, 9) for span in spans if abs(span.y1) < 1.3 and span.height < 1) == [-1.125, 1.25]
    begin = 500 / 250.0 * plan(2).transient_periods
    shaded = sorted((round(span.x0, 6), round(span.x1, 6)) for span in spans if span.height > 2)
    assert shaded[0] == (run.time_s[0], begin)
    assert shaded[1][0] == pytest.approx(begin + 2.0 * plan(2).periods)
    assert len(far.get_lines()) == 1
    assert [text.get_text() for text in (*near.texts[:1], *far.texts[:1])] == ["80%", "10.0% of 10"]
