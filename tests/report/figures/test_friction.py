"""Levels, law and what it leaves of them, over speed, load and temperature; a motion with its regression."""

import numpy as np
from plants import friction_study as study
from plants.dry_friction import robot
from plants.published_friction import drawn, published_levels
from plants.report_values import bars_of, lines_of
from plants.taken_friction import LEVELS, STDS, taken_friction

from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.spec import LawSpec
from elastid.report.figures.friction import Condition, curve_of, friction_curve, friction_taken_out
from elastid.report.figures.friction_records import friction_motion


def test_levels_of_other_conditions_are_grey_and_counted() -> None:
    """12 speeds at 3 loads and 3 temperatures: 12 levels are the curve's."""
    levels = drawn(published_levels(loads=(0.0, 0.5, 1.0), temperatures=(33.0, 62.0, 80.0)), 1)
    published = StaticLaw.of(levels, LawSpec())
    axes = friction_curve(published).axes[0]
    points = {name: len(x) for name, (x, _) in bars_of(axes).items()}
    assert points == {"levels at other loads and temperatures": 96, "levels, both directions": 12}
    assert Condition.typical(published.levels).text(published) == "at a load of 0 N·m and 62 °C"


def test_without_a_bristle_it_is_a_curve_over_velocity() -> None:
    """Coulomb friction turns with the sign."""
    v, torque, std, is_distance = curve_of(taken_friction(bristle=False), "motor 1")
    assert not is_distance
    np.testing.assert_allclose(torque, LEVELS[0] * np.sign(v))
    np.testing.assert_allclose(std, STDS[0])


def test_the_figure_shows_the_unexplained_torque_of_every_motor_and_a_curve_where_friction_was_found() -> None:
    """Before and after, by configuration; motor 2 has no curve."""
    friction = taken_friction()
    figure = friction_taken_out(friction)
    titles = {axes.get_title(): axes for axes in figure.axes if axes.axison}
    assert list(titles) == ["motor 1: F_c = 4.5 ± 0.44 N·m", "motor 1: torque not explained",
                            "motor 2: torque not explained"]  # fmt: skip
    for i, place in enumerate(friction.places):
        drawn = lines_of(titles[f"{place}: torque not explained"])
        np.testing.assert_array_equal(drawn["unexplained, with friction"].get_ydata(), friction.before[:, i])
        np.testing.assert_array_equal(drawn["unexplained, friction taken out"].get_ydata(), friction.after[:, i])
    curve = lines_of(titles["motor 1: F_c = 4.5 ± 0.44 N·m"])["friction"]
    np.testing.assert_allclose(curve.get_ydata(), curve_of(friction, "motor 1")[1])


def test_the_law_of_the_robot_file_stands_beside_the_curve() -> None:
    """On the link side, both signs; without a robot there is none."""
    label = "F_c of the robot's file"
    with_law = friction_taken_out(taken_friction(), robot((4.0, 7.0))).axes[0]
    drawn = [line.get_ydata()[0] for line in with_law.get_lines() if line.get_label() == label]
    np.testing.assert_allclose(drawn, (4.0, -4.0))
    assert label not in lines_of(friction_taken_out(taken_friction()).axes[0])


def test_a_motion_shows_friction_without_inertia() -> None:
    """20 N and 200 N s/m under 400 N of inertia."""
    found = study.motion()
    curve = friction_motion(found).axes[0]
    v, friction = next(line for line in curve.get_lines() if line.get_marker() == "o").get_data()
    fast = np.abs(v) > 0.3
    np.testing.assert_allclose(friction[fast], (20 * np.sign(v) + 200 * v)[fast], atol=2.0)
