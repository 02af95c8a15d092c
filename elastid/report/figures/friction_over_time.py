"""Friction over time: a warm-up with its thermal model, and a filter with its bands and innovations."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.follow import FILTER, FollowedFriction
from elastid.friction_study.warm_up import LevelOf, ThermalModel, WarmUp
from elastid.report.figures import style
from elastid.report.figures.friction_curve import units

NAMES = {
    "Fc": "Coulomb friction",
    "f": "viscous friction",
    "f+": "viscous friction +",
    "f-": "viscous friction \N{MINUS SIGN}",
    "offset": "offset",
}


def friction_filter(followed: FollowedFriction) -> Figure:
    """Followed numbers, NIS with its band, and autocorrelation of the innovations."""
    rows = len(followed.names) + 2
    ratios = (*(1.3 for _ in followed.names), 0.9, 1.0)
    figure, panels = style.column(1.6 * rows, ratios, 0.42, sharex=False)
    time, unit = (followed.time_s, "s") if followed.time_s[-1] <= 300 else (followed.time_s / 60, "min")
    for i, name in enumerate(followed.names):
        _draw_number(panels[i], followed, i, time)
        style.label(panels[i], y=f"{NAMES[name]}\nin {_unit(name, followed.slides)}")
    nis, correlation = panels[-2:]
    nis.plot(time, followed.nis, color=style.TOTAL, lw=0.8, label="mean NIS since the point before")
    nis.axhspan(*FILTER.nis_band, color=style.FITTED, alpha=0.15, lw=0, label="NIS of an honest filter")
    nis.set_yscale("log")
    style.label(nis, f"time in {unit}", "NIS")
    rho = followed.consistency.autocorrelation
    correlation.stem(np.arange(1, len(rho)), rho[1:], linefmt="-", markerfmt=".", basefmt=" ")
    reach = QUANTILE_95 / np.sqrt(max(followed.consistency.n_eff, 1.0))
    correlation.axhspan(-reach, reach, color=style.FITTED, alpha=0.15, lw=0)
    style.label(correlation, "lag in samples", "autocorrelation")
    title = f"joint {followed.joint}: friction followed, mean NIS {followed.consistency.nis:.2f}"
    style.finish(figure, title, panels, panels, 0.01)
    return figure


def _draw_number(axes: Axes, followed: FollowedFriction, i: int, time: np.ndarray) -> None:
    """The band, the estimate, and where the motion does not inform it."""
    axes.fill_between(
        time, followed.low[:, i], followed.high[:, i], color=style.FITTED, alpha=0.2, lw=0, label="95 % band"
    )
    axes.plot(time, followed.values[:, i], color=style.FITTED, lw=1.2, label="followed")
    held = np.where(followed.unknown[:, i], followed.values[:, i], np.nan)
    if np.isfinite(held).any():
        axes.plot(time, held, color=style.WEAK, lw=2.0, label="held: not observable in this motion")


def _unit(name: str, slides: bool) -> str:
    torque = "N" if slides else "N*m"
    return {"Fc": torque, "offset": torque}.get(name, "N*s/m" if slides else "N*m*s/rad")


def friction_warm_up(
    place: str, warm_up: WarmUp, model: ThermalModel, level_of: LevelOf | None, slides: bool = False
) -> Figure:
    """Power, temperature (relative where kelvins cannot be known), and levels by speed; lines: the thermal model."""
    figure, panels = style.column(6.4, (0.7, 1.4, 1.8), 0.16)
    power, heat, tests = panels
    minutes, kelvin = warm_up.time_s / 60, model.scale == "kelvin"
    power.stairs(warm_up.power, minutes, color=style.TOTAL, lw=1.0, label="power into heat")
    read = np.isfinite(warm_up.readings)
    if read.any() and kelvin:
        heat.plot(minutes[read], warm_up.readings[read], **style.DOTS, ms=1.8, color=style.WEAK, label="thermometer")
    heat.plot(minutes, model.temperature(warm_up), color=style.FITTED, lw=1.3, label="thermal model")
    if len(warm_up.level):
        _draw_tests(tests, warm_up, model, level_of, units(slides)[0])
    style.label(power, y="power in W")
    style.label(heat, y="temperature in °C" if kelvin else "relative temperature")
    style.label(tests, "time in min", f"{'force' if slides else 'torque'} in {units(slides)[1]}")
    times = " and ".join(f"{constant / 60:.3g} min" for constant in model.time_constants)
    title = f"{place}: warm-up, time constant{'s' if len(model.time_constants) > 1 else ''} of {times}"
    style.finish(figure, title, panels, panels, 0.01)
    return figure


def _draw_tests(axes: Axes, warm_up: WarmUp, model: ThermalModel, level_of: LevelOf | None, unit: str) -> None:
    """Levels over time by speed, and the model's where it can give them."""
    can_predict = model.scale == "relative" or level_of is not None
    predicted = model.levels(warm_up, level_of) if can_predict else None
    minutes = warm_up.time_s[warm_up.tests] / 60
    for i, speed in enumerate(np.unique(warm_up.test_speed).tolist()):
        own, color = warm_up.test_speed == speed, style.SERIES[i % len(style.SERIES)]
        looks: dict[str, Any] = {"ms": 3, "color": color, "label": f"tests at {speed:.3g} {unit}"}
        style.plot_intervals(axes, minutes[own], warm_up.level[own], warm_up.level_std[own], **looks)
        if predicted is not None:
            axes.plot(minutes[own], predicted[own], color=color, lw=1.0)
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
