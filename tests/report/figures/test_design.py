"""Figures of a plan."""

from __future__ import annotations

import numpy as np
from plants.report_values import plan

from elastid.report.figures.design import excitation


def test_the_excitation_figure_shows_one_period_of_every_input():
    """The torque that the plan injects in its first experiment, and its line amplitudes."""
    given = plan(3)
    panels = excitation(given).axes
    assert len(panels) == 6
    for j in range(3):
        spectrum, time = panels[2 * j], panels[2 * j + 1]
        np.testing.assert_allclose(spectrum.get_lines()[0].get_ydata(), 30.0)
        np.testing.assert_allclose(time.get_lines()[0].get_ydata(), given.torque(given.experiments[0])[:, j])
