"""Friction over time: a warm-up with its thermal model, and a filter with its bands and innovations."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.follow import FollowedFriction
from elastid.friction_study.innovations import FILTER
from elastid.friction_study.warm_up import LevelOf, ThermalModel, WarmUp
from elastid.report.figures import style
from elastid.report.figures.friction_curve import units

MINUTE = 60.0
# Longest time in s that is shown in seconds.
SHORT = 300.0
NAMES = {
    "Fc": "Coulomb friction",
    "f": "viscous friction",
    "f+": "viscous friction +",
    "f-": "viscous friction \N{MINUS SIGN}",
    "offset": "offset",
}


def friction_filter(found: FollowedFriction) -> Figure:
    """Followed numbers, NIS with its band, and autocorrelation of the innovations."""
    rows = len(found.names) + 2
    ratios = (*(1.3 for _ in found.names), 0.9, 1.0)
    figure, panels = style.panels(
        rows, 1, (style.WIDE, 1.6 * rows), (0.8, 0.25, 0.85, 0.55), (0.0, 0.42), height_ratios=ratios
    )
    is_short = float(found.time_s[-1]) <= SHORT
    time, unit = (found.time_s, "s") if is_short else (found.time_s / MINUTE, "min")
    for i, name in enumerate(found.names):
        _draw_number(panels[i, 0], found, i, time)
        style.label(panels[i, 0], y=f"{NAMES[name]}\nin {_unit(name, found.slides)}")
    nis, correlation = panels[-2, 0], panels[-1, 0]
    nis.plot(time, found.nis, color=style.TOTAL, lw=0.8, label="mean NIS since the point before")
    nis.axhspan(*FILTER.nis_band, color=style.FITTED, alpha=0.15, lw=0, label="NIS of an honest filter")
    nis.set_yscale("log")
    style.label(nis, f"time in {unit}", "NIS")
    rho = found.consistency.autocorrelation
    correlation.stem(np.arange(1, len(rho)), rho[1:], linefmt="-", markerfmt=".", basefmt=" ")
    reach = QUANTILE_95 / np.sqrt(max(found.consistency.n_eff, 1.0))
    correlation.axhspan(-reach, reach, color=style.FITTED, alpha=0.15, lw=0)
    style.label(correlation, "lag in samples", "autocorrelation")
    for axes in panels[:, 0]:
        style.lighten(axes)
        axes.margins(x=0.01)
    style.add_title(figure, f"joint {found.joint}: friction followed, mean NIS {found.consistency.nis:.2f}")
    style.add_legend(figure, panels[:, 0])
    return figure


def _draw_number(axes: Axes, found: FollowedFriction, i: int, time: np.ndarray) -> None:
    """The band, the estimate, and where the motion tells nothing."""
    axes.fill_between(time, found.low[:, i], found.high[:, i], color=style.FITTED, alpha=0.2, lw=0, label="95 % band")
    axes.plot(time, found.values[:, i], color=style.FITTED, lw=1.2, label="followed")
    held = np.where(found.unknown[:, i], found.values[:, i], np.nan)
    if np.isfinite(held).any():
        axes.plot(time, held, color=style.WEAK, lw=2.0, label="held: the motion tells nothing of it")


def _unit(name: str, slides: bool) -> str:
    torque = "N" if slides else "N*m"
    return {"Fc": torque, "offset": torque}.get(name, "N*s/m" if slides else "N*m*s/rad")


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
        error = QUANTILE_95 * warm_up.level_std[own]
        axes.errorbar(minutes[own], warm_up.level[own], error, **looks, label=f"tests at {speed:.3g} {unit}")
        if predicted is not None:
            axes.plot(minutes[own], predicted[own], color=color, lw=1.0)
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
