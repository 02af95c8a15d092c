"""Levels, law and what it leaves of them, over speed, load and temperature."""

from __future__ import annotations

import numpy as np
import pytest
from plants import friction_study as study
from plants.published_friction import drawn, published_levels
from plants.report_values import bars_of, lines_of

from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.spec import LawSpec
from elastid.report.figures.friction_curve import (
    Condition,
    conditions_of,
    friction_conditions,
    friction_curve,
    residuals,
)


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
