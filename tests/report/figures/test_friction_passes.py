"""A pass and a motion, with the parts of their regressions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants import friction_study as study
from plants.report_values import lines_of

from elastid.friction_study.passes import passes_of
from elastid.report.figures.friction_passes import friction_motion, friction_pass


def test_the_parts_of_a_pass_explain_its_torque() -> None:
    """What is left is the noise that was added."""
    figure = friction_pass(passes_of(study.example()), study.pass_levels())
    whole, parts, left = figure.axes
    assert np.std(left.get_lines()[0].get_ydata()) == pytest.approx(study.NOISE, rel=0.1)
    there = lines_of(parts)
    assert set(there) == {"friction", "gravity and offset", "ripple", "inertia"}
    assert np.abs(there["friction"].get_ydata()) == pytest.approx(study.F_C + study.VISCOUS * study.SPEED, rel=0.01)
    assert np.ptp(there["ripple"].get_ydata()) == pytest.approx(2 * study.RIPPLE, rel=0.01)
    assert whole.get_lines()[0].get_xdata()[0] == pytest.approx(np.degrees(passes_of(study.example())[0].position[0]))


def test_a_motion_shows_friction_without_inertia() -> None:
    """20 N and 200 N s/m under 400 N of inertia."""
    found = study.motion()
    curve = friction_motion(found).axes[0]
    v, friction = next(line for line in curve.get_lines() if line.get_marker() == "o").get_data()
    fast = np.abs(v) > 0.3
    np.testing.assert_allclose(friction[fast], (20 * np.sign(v) + 200 * v)[fast], atol=2.0)


def test_directions_that_differ_have_the_symmetric_regression_beside_them() -> None:
    one = replace(study.motion(), are_apart=True)
    assert "the same in both directions" in lines_of(friction_motion(one).axes[0])
    assert "the same in both directions" not in lines_of(friction_motion(study.motion()).axes[0])
