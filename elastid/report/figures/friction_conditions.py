"""Friction levels over load and over temperature, at a few speeds, with the law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import BoolArray, FloatArray
from elastid.friction.static_terms import Conditions
from elastid.friction_study.laws import StaticLaw
from elastid.report.figures import style
from elastid.report.figures.friction_curve import POINTS, Z_95, Condition, depends_on, law_band, units

# Speeds that are drawn, and the share by which those of one group differ at most.
MOST_SPEEDS, SAME_SPEED = 4, 0.05


def conditions_of(law: StaticLaw) -> list[str]:
    """On which of load and temperature the law depends."""
    return [kind for kind in ("load", "temperature") if depends_on(law, kind)]


def friction_conditions(law: StaticLaw) -> Figure:
    """A panel over load and one over temperature, each where the law depends on it, and it does on one.

    Points: levels, brought by the law to the panel's other condition and to the mean speed of their group, so that
    their distance from the line is what the law leaves of them.
    """
    kinds = conditions_of(law)
    size = (style.WIDE if len(kinds) > 1 else 5.6, 4.1)
    figure, panels = style.panels(1, len(kinds), size, (0.8, 0.25, 1.05, 0.55), (0.25, 0.0))
    speed, torque = units(law.levels.slides)
    names = {"load": f"load in {torque}", "temperature": "temperature in °C"}
    for axes, kind in zip(panels[0], kinds, strict=True):
        for i, members in enumerate(_groups(law.levels.speed)):
            _draw_group(axes, law, kind, members, style.SERIES[i])
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        style.label(axes, names[kind], f"{'force' if law.levels.slides else 'torque'} in {torque}", _held(law, kind))
        style.lighten(axes)
    style.add_title(figure, f"{law.levels.place}: friction over {' and '.join(kinds)}, by speed in {speed}")
    style.add_legend(figure, panels[0])
    return figure


def _draw_group(axes: Axes, law: StaticLaw, kind: str, members: BoolArray, color: str) -> None:
    levels, typical = law.levels, Condition.typical(law.levels)
    speed = float(levels.speed[members].mean())
    values = getattr(levels, kind)[members]
    grid = np.linspace(values.min(), values.max(), POINTS)
    line, half = law_band(law, _conditions(typical, kind, speed, grid))
    axes.fill_between(grid, line - half, line + half, color=color, alpha=0.2, lw=0)
    axes.plot(grid, line, color=color, lw=1.2)
    left = levels.torque[members] - law.fit.torque(levels.select(members).conditions)
    torque = law.fit.torque(_conditions(typical, kind, speed, values)) + left
    looks: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 3.2, "mew": 0, "elinewidth": 0.8, "capsize": 2}
    axes.errorbar(values, torque, Z_95 * levels.std[members], **looks, color=color, label=f"{speed:.3g}")


def _conditions(typical: Condition, kind: str, speed: float, values: FloatArray) -> Conditions:
    one = np.ones_like(values)
    load = values if kind == "load" else typical.load * one
    temperature = values if kind == "temperature" else typical.temperature * one
    return Conditions(speed * one, 0.0 * one, load, temperature)


def _held(law: StaticLaw, kind: str) -> str:
    """The other condition, of a law that depends on both."""
    other = "temperature" if kind == "load" else "load"
    if not depends_on(law, other):
        return ""
    typical = Condition.typical(law.levels)
    return (
        f"at {typical.temperature:.3g} °C"
        if kind == "load"
        else f"at a load of {typical.load:.3g} {units(law.levels.slides)[1]}"
    )


def _groups(speed: FloatArray) -> Sequence[BoolArray]:
    """Masks (n,) of the levels of a few speeds, spread from the lowest to the highest."""
    centres: list[float] = []
    for v in np.sort(speed).tolist():
        if not centres or v > centres[-1] * (1 + SAME_SPEED):
            centres.append(v)
    chosen = np.unique(np.round(np.linspace(0, len(centres) - 1, MOST_SPEEDS)).astype(int))
    return [(speed >= centres[i] * (1 - 1e-9)) & (speed <= centres[i] * (1 + SAME_SPEED)) for i in chosen]
