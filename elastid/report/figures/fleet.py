"""A parameter over the robots of a fleet and their dates, with 95 % intervals."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from matplotlib.figure import Figure

from elastid.base.statistics import QUANTILE_95
from elastid.report.figures import style
from elastid.validation.fleet import FleetValue

# Robots whose names fit below an axis.
MAX_NAMED = 40


def fleet_parameter(name: str, unit: str, values: Sequence[FleetValue], marked: Collection[str]) -> Figure:
    """One column a robot, its dates beside each other from left to right; marked: robots with a finding."""
    figure, panels = style.panels(1, 1, (style.WIDE, 3.2), (0.8, 0.25, 0.85, 0.9), (0.0, 0.0))
    axes = panels[0, 0]
    robots = list(dict.fromkeys(value.robot for value in values))
    days = sorted({value.day for value in values})
    width = 0.6 / max(1, len(days))
    for is_marked in (False, True):
        own = [value for value in values if (value.robot in marked) == is_marked]
        if not own:
            continue
        x = [robots.index(v.robot) + width * (days.index(v.day) - (len(days) - 1) / 2) for v in own]
        axes.errorbar(
            x, [v.value for v in own], QUANTILE_95 * np.array([v.std for v in own]), ls="none", marker="o", ms=2.5,
            mew=0, elinewidth=0.9, color=style.FITTED if is_marked else style.TOTAL,
            label="differs or drifts" if is_marked else "robot, dates from left to right",
        )  # fmt: skip
    style.lighten(axes)
    if len(robots) <= MAX_NAMED:
        axes.set_xticks(range(len(robots)))
        style.set_names(axes.xaxis, robots, rotation=90)
    style.label(axes, "" if len(robots) <= MAX_NAMED else "robot", f"{style.plain(name)} in {style.pretty_unit(unit)}")
    style.add_title(figure, f"{name} over the fleet")
    style.add_legend(figure, [axes])
    return figure
