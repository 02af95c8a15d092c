"""Peaks in percent of their limits, and a run between its limits."""

from __future__ import annotations

import numpy as np
import pytest
from plants.report_values import plan

from elastid.design.limits import QUANTITIES, LimitUse
from elastid.experiment.plan.plan import Experiment
from elastid.experiment.plan.rehearsal import Rehearsal
from elastid.record import Configuration
from elastid.report.figures.limits import limit_use, nearest_run_signals


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
