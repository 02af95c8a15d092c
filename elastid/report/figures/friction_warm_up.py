"""A warm-up: temperature and the levels of its test passes over time, with what the thermal model predicts."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.friction_study.warm_up import LevelOf, ThermalModel, WarmUp
from elastid.report.figures import style
from elastid.report.figures.friction_curve import Z_95, units

MINUTE = 60.0


def friction_warm_up(
    place: str, warm_up: WarmUp, model: ThermalModel, level_of: LevelOf | None, slides: bool = False
) -> Figure:
    """Power, temperature (relative where kelvins cannot be known), and levels by speed; lines: the thermal model."""
    options = {"sharex": True, "height_ratios": (0.7, 1.4, 1.8)}
    figure, panels = style.panels(3, 1, (style.WIDE, 6.4), (0.8, 0.25, 0.85, 0.55), (0.0, 0.16), **options)
    power, heat, tests = panels[:, 0]
    minutes, kelvin = warm_up.time_s / MINUTE, model.scale == "kelvin"
    power.stairs(warm_up.power, minutes, color=style.TOTAL, lw=1.0, label="power into heat")
    read = np.isfinite(warm_up.readings)
    if read.any() and kelvin:
        looks: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 1.8, "mew": 0, "color": style.WEAK}
        heat.plot(minutes[read], warm_up.readings[read], **looks, label="thermometer")
    heat.plot(minutes, model.temperature(warm_up), color=style.FITTED, lw=1.3, label="thermal model")
    if len(warm_up.level):
        _draw_tests(tests, warm_up, model, level_of, units(slides)[0])
    for axes in panels[:, 0]:
        style.lighten(axes)
        axes.margins(x=0.01)
    style.label(power, y="power in W")
    style.label(heat, y="temperature in °C" if kelvin else "relative temperature")
    style.label(tests, "time in min", f"{'force' if slides else 'torque'} in {units(slides)[1]}")
    times = " and ".join(f"{constant / MINUTE:.3g} min" for constant in model.time_constants)
    style.add_title(figure, f"{place}: warm-up, time constant{'s' if len(model.time_constants) > 1 else ''} of {times}")
    style.add_legend(figure, panels[:, 0])
    return figure


def _draw_tests(axes: Axes, warm_up: WarmUp, model: ThermalModel, level_of: LevelOf | None, unit: str) -> None:
    """Levels over time by speed, and the model's where it can give them."""
    can_predict = model.scale == "relative" or level_of is not None
    predicted = model.levels(warm_up, level_of) if can_predict else None
    minutes = warm_up.time_s[warm_up.tests] / MINUTE
    for i, speed in enumerate(np.unique(warm_up.test_speed).tolist()):
        own, color = warm_up.test_speed == speed, style.SERIES[i % len(style.SERIES)]
        looks: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 3, "mew": 0, "elinewidth": 0.8, "color": color}
        error = Z_95 * warm_up.level_std[own]
        axes.errorbar(minutes[own], warm_up.level[own], error, **looks, label=f"tests at {speed:.3g} {unit}")
        if predicted is not None:
            axes.plot(minutes[own], predicted[own], color=color, lw=1.0)
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
