"""A warm-up with its thermal model."""

from __future__ import annotations

import numpy as np
from plants import friction_study as study
from plants.report_values import bars_of, lines_of

from elastid.report.figures.friction_over_time import friction_warm_up


def test_a_warm_up_has_readings_levels_and_what_is_predicted() -> None:
    """At each speed the model's line goes through the levels."""
    campaign, model = study.warm_up()
    _, heat, tests = friction_warm_up("joint elbow", campaign, model, None).axes
    np.testing.assert_allclose(lines_of(heat)["thermal model"].get_ydata(), model.temperature(campaign))
    x, y = bars_of(tests)["tests at 1 rad/s"]
    line = next(line for line in tests.get_lines() if line.get_linestyle() == "-" and line.get_ydata()[0] > 12)
    np.testing.assert_allclose(line.get_xdata(), x)
    np.testing.assert_allclose(line.get_ydata(), y, atol=0.2)
