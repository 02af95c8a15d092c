"""A pass and a motion, with the parts of their regressions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants import friction_study as study
from plants.report_values import bars_of, lines_of

from elastid.friction_study.passes import passes_of
from elastid.report.figures.friction_records import (
    friction_at_rest,
    friction_loops,
    friction_motion,
    friction_pass,
    friction_warm_up,
)


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


def test_loops_are_replayed_and_the_spectrum_is_in_torque() -> None:
    """k D of each element; the log's first half loop is not drawn."""
    log, found = study.loops()
    loop, spectrum, errors = friction_loops(log, found).axes
    measured, replayed = lines_of(loop)["measured"], lines_of(loop)["replayed"]
    assert len(measured.get_xdata()) == len(log.position) - log.settled
    np.testing.assert_allclose(replayed.get_ydata(), measured.get_ydata(), atol=1e-12)
    np.testing.assert_allclose(lines_of(spectrum)["2 elements"].get_data(), ((1.0, 3.0), (0.3, 1.5)))
    assert lines_of(errors)["error of unseen parts"].get_ydata()[0] == pytest.approx(100 * 0.2 / 1.8)


def test_bristles_at_rest_end_at_amplitude_zero() -> None:
    spring, damper = friction_at_rest("joint elbow", study.at_rest()).axes
    assert bars_of(spring)["extrapolated"] == (np.zeros(1), np.array([1e4]))
    assert bars_of(damper)["extrapolated"] == (np.zeros(1), np.array([10.0]))
    np.testing.assert_array_equal(bars_of(spring)["measured"], ((0.5, 1.0), (9.9e3, 9.8e3)))


def test_a_warm_up_has_readings_levels_and_what_is_predicted() -> None:
    """At each speed the model's line goes through the levels."""
    campaign, model = study.warm_up()
    _, heat, tests = friction_warm_up("joint elbow", campaign, model, None).axes
    np.testing.assert_allclose(lines_of(heat)["thermal model"].get_ydata(), model.temperature(campaign))
    x, y = bars_of(tests)["tests at 1 rad/s"]
    line = next(line for line in tests.get_lines() if line.get_linestyle() == "-" and line.get_ydata()[0] > 12)
    np.testing.assert_allclose(line.get_xdata(), x)
    np.testing.assert_allclose(line.get_ydata(), y, atol=0.2)
