"""The figures of a friction study show the numbers that they are drawn from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from plants import friction_study as study
from plants.published_friction import drawn, published_levels
from plants.report_values import lines_of

from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.passes import passes_of
from elastid.friction_study.spec import LawSpec
from elastid.report.figures.drawings import friction_study_drawings
from elastid.report.figures.friction_curve import (
    Condition,
    conditions_of,
    friction_conditions,
    friction_curve,
    residuals,
)
from elastid.report.figures.friction_over_time import friction_warm_up
from elastid.report.figures.friction_passes import friction_motion, friction_pass
from elastid.report.figures.friction_presliding import friction_at_rest, friction_loops


def bars_of(axes: Axes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Points with intervals of a panel, x and y by label."""
    found = {}
    for each in axes.containers:
        x, y = each.lines[0].get_data()
        found[str(each.get_label())] = np.asarray(x), np.asarray(y)
    return found


def test_the_curve_has_every_level_and_the_law_of_each_direction() -> None:
    """Friction grows more forwards; what is left is in std."""
    law = study.law()
    curve, left = friction_curve(law).axes
    levels = law.levels
    for sign, name in ((1.0, "positive"), (-1.0, "negative")):
        own = levels.direction == sign
        x, y = bars_of(curve)[f"levels, {name} direction"]
        np.testing.assert_array_equal((x, y), (levels.speed[own], levels.torque[own]))
        v, torque = lines_of(curve)[f"law, {name} direction"].get_data()
        np.testing.assert_allclose(torque, study.F_C + (study.VISCOUS + sign * study.UNEVEN) * np.asarray(v), rtol=0.02)
        assert (v[0], v[-1]) == pytest.approx((levels.speed.min(), levels.speed.max()))
    shown = np.sort(np.concatenate([line.get_ydata() for line in left.get_lines() if line.get_marker() in "os"]))
    np.testing.assert_allclose(shown, np.sort(residuals(law)))


@pytest.fixture(scope="module")
def published() -> StaticLaw:
    return StaticLaw.of(drawn(published_levels(loads=(0.0, 0.5, 1.0), temperatures=(33.0, 62.0, 80.0)), 1), LawSpec())


def test_levels_of_other_conditions_are_grey_and_counted(published: StaticLaw) -> None:
    """12 speeds at 3 loads and 3 temperatures: 12 levels are the curve's."""
    axes = friction_curve(published).axes[0]
    points = {name: len(x) for name, (x, _) in bars_of(axes).items()}
    assert points == {"levels at other loads and temperatures": 96, "levels, both directions": 12}
    assert Condition.typical(published.levels).text(published) == "at a load of 0 N·m and 62 °C"


def test_levels_over_load_and_temperature_lie_as_far_from_the_law_as_they_do(published: StaticLaw) -> None:
    """Each panel keeps the residuals of its speeds; a law of neither has no figure."""
    figure = friction_conditions(published)
    assert figure is not None
    over_load, over_heat = figure.axes
    assert (over_load.get_title(), over_heat.get_title()) == ("at 62 °C", "at a load of 0 N·m")
    levels = published.levels
    slowest = levels.speed == levels.speed.min()
    _, y = bars_of(over_load)["1"]
    line = over_load.get_lines()[0]
    away = y - np.interp(levels.load[slowest], *line.get_data())
    np.testing.assert_allclose(away / levels.std[slowest], residuals(published)[slowest], atol=1e-6)
    assert conditions_of(study.law()) == []


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


def test_a_warm_up_has_readings_levels_and_what_is_predicted() -> None:
    """At each speed the model's line goes through the levels."""
    campaign, model = study.warm_up()
    _, heat, tests = friction_warm_up("joint elbow", campaign, model, None).axes
    np.testing.assert_allclose(lines_of(heat)["thermal model"].get_ydata(), model.temperature(campaign))
    x, y = bars_of(tests)["tests at 1 rad/s"]
    line = next(line for line in tests.get_lines() if line.get_linestyle() == "-" and line.get_ydata()[0] > 12)
    np.testing.assert_allclose(line.get_xdata(), x)
    np.testing.assert_allclose(line.get_ydata(), y, atol=0.2)


def test_bristles_at_rest_end_at_amplitude_zero() -> None:
    spring, damper = friction_at_rest("joint elbow", study.at_rest()).axes
    assert bars_of(spring)["extrapolated"] == (np.zeros(1), np.array([1e4]))
    assert bars_of(damper)["extrapolated"] == (np.zeros(1), np.array([10.0]))
    np.testing.assert_array_equal(bars_of(spring)["measured"], ((0.5, 1.0), (9.9e3, 9.8e3)))


def test_every_joint_has_the_figures_of_what_was_measured() -> None:
    """In files that every system can write."""
    found = list(friction_study_drawings(study.friction_result()))
    assert [one.name for one in found] == [
        "friction-elbow-curve", "friction-elbow-pass", "friction-elbow-loops", "friction-elbow-at-rest",
        "friction-elbow-warm-up", "friction--lift--motion",
    ]  # fmt: skip
    assert [one.section for one in found[-2:]] == ["joint elbow", "joint <lift>"]
