"""The figure of friction that was taken out."""

from __future__ import annotations

import math

import numpy as np
from plants.dry_friction import robot
from plants.report_values import lines_of
from plants.taken_friction import LEVELS, STDS, THRESHOLD, taken_friction

from elastid.report.figures.friction import curve_of, friction_curves


def test_the_curve_after_a_reversal_goes_from_one_sliding_level_to_the_other() -> None:
    """The bristle bends over twice its threshold; the interval is that of both levels."""
    friction = taken_friction()
    x, torque, std, is_distance = curve_of(friction, "motor 1")
    assert is_distance
    for at, expected in ((-1e-4, -4.5), (THRESHOLD, LEVELS[0]), (3 * THRESHOLD, 4.5)):
        assert math.isclose(np.interp(at, x, torque), expected, rel_tol=1e-2)
    assert math.isclose(std[-1], math.hypot(*STDS))


def test_without_a_bristle_it_is_a_curve_over_velocity() -> None:
    """Coulomb friction turns with the sign."""
    v, torque, std, is_distance = curve_of(taken_friction(bristle=False), "motor 1")
    assert not is_distance
    np.testing.assert_allclose(torque, LEVELS[0] * np.sign(v))
    np.testing.assert_allclose(std, STDS[0])


def test_the_figure_shows_the_unexplained_torque_of_every_motor_and_a_curve_where_friction_was_found() -> None:
    """Before and after, by configuration; motor 2 has no curve."""
    friction = taken_friction()
    figure = friction_curves(friction)
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
    with_law = friction_curves(taken_friction(), robot((4.0, 7.0))).axes[0]
    drawn = [line.get_ydata()[0] for line in with_law.get_lines() if line.get_label() == label]
    np.testing.assert_allclose(drawn, (4.0, -4.0))
    assert label not in lines_of(friction_curves(taken_friction()).axes[0])
