"""A motion, with its regression."""

from __future__ import annotations

import numpy as np
from plants import friction_study as study

from elastid.report.figures.friction_records import friction_motion


def test_a_motion_shows_friction_without_inertia() -> None:
    """20 N and 200 N s/m under 400 N of inertia."""
    found = study.motion()
    curve = friction_motion(found).axes[0]
    v, friction = next(line for line in curve.get_lines() if line.get_marker() == "o").get_data()
    fast = np.abs(v) > 0.3
    np.testing.assert_allclose(friction[fast], (20 * np.sign(v) + 200 * v)[fast], atol=2.0)
