"""The torque of logs by part and octave, and a parameter over a fleet."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from elastid.report.figures import style
from elastid.report.figures.style import Cells, Curve, Panel
from elastid.validation.twin import (
    DRY,
    ELASTICITY,
    FRICTION,
    GRAVITY,
    INERTIA,
    MIN_POWER_SHARE,
    RIGID_BODY,
    VISCOUS,
    TorqueBalance,
)

if TYPE_CHECKING:
    from elastid.validation.fleet import FleetValue  # brings SciPy's statistics

# Samples of a torque that are drawn.
MOST_SAMPLES = 3000
COLORS = {
    INERTIA: style.TOTAL, RIGID_BODY: style.TOTAL, GRAVITY: style.MEASURED, VISCOUS: style.NOISE, DRY: style.START,
    ELASTICITY: style.TRUTH,
}  # fmt: skip
TORQUE_CAPTION = (
    "torque of the log and of the model for the measured motion; the model's parts; by octave what the model leaves of "
    "the mean square, with friction and without, and the share of the torque's power that lies there."
)


def torque_balance_figure(balance: TorqueBalance) -> Figure:
    """Torque measured and modelled; its parts; the share left by octave."""
    part = slice(None, None, max(1, len(balance.measured) // MOST_SAMPLES))
    t = (np.arange(len(balance.measured)) / balance.rate_hz)[part]
    modelled = balance.measured - balance.residual
    whole = [(balance.measured, style.MEASURED, 1.2, "measured"), (modelled, style.FITTED, 0.8, "model")]
    if any(name in FRICTION for name in balance.parts):
        whole.append((modelled - balance.part(FRICTION), style.WEAK, 0.8, "model without friction"))
    whole.append((balance.residual, style.RESIDUAL, 0.6, "measured − model"))
    total = [Curve(t, torque[part], text, ink, looks={"lw": width}) for torque, ink, width, text in whole]
    parts = [
        Curve(t, torque[part], name, COLORS[name]) for name, torque in zip(balance.parts, balance.torques, strict=True)
    ]
    shares = [
        Curve(np.arange(len(balance.bands)), [100 * max(getattr(band, key), 1e-7) for band in balance.bands], text, ink,
              looks={"marker": "o", "ms": 5, "ls": ":"})
        for key, ink, text in (
            ("left", style.RESIDUAL, "left"), ("left_without_friction", style.WEAK, "left without friction"),
            ("power", style.MEASURED, "share of the torque's power"),
        )
    ]  # fmt: skip
    unit, time = style.pretty_unit(balance.unit), "time in s" if balance.rate_is_known else "time in samples"
    below = Panel(shares, style.frequency_label(balance.rate_is_known), "%", scale="log")
    title = f"{balance.place}, {balance.log}: {100 * balance.left:.2g} % of the mean square is left"
    figure = style.matrix(title, [[Panel(total, y=unit)], [Panel(parts, time, unit)], [below]], 1.8, gaps=(0, 0.4))
    style.set_names(figure.axes[-1].xaxis, [f"{band.low_hz:.3g}–{band.high_hz:.3g}" for band in balance.bands])
    return figure


def octaves_figure(balances: Sequence[TorqueBalance], own: Sequence[TorqueBalance] = ()) -> Figure:
    """Rms of the torque left over its own rms, by axis and octave; below it, by a regression of these logs."""
    edges = sorted({band.high_hz for balance in balances for band in balance.bands})
    known = all(balance.rate_is_known for balance in balances)
    label, rows = f"octave below {'Hz' if known else 'sampling rates'}", []
    for judged, title in ((balances, "torque left, % of its rms"), (own, "the same by a regression of these logs")):
        left = np.full((len(judged), len(edges)), np.nan)
        for i, balance in enumerate(judged):
            for band in (band for band in balance.bands if band.power >= MIN_POWER_SHARE):
                left[i, edges.index(band.high_hz)] = 100 * math.sqrt(band.left)
        names, columns = [f"{each.place}, {each.log}" for each in judged], [f"{edge:.3g}" for edge in edges]
        rows += [[Panel(x=label, title=title, cells=Cells(left, names, columns))]] if judged else []
    tall, left_of = 0.3 * len(balances) + 0.4, 0.4 + 0.075 * max(len(f"{b.place}, {b.log}") for b in balances)
    return style.matrix("Torque left by octave", rows, tall, left=left_of, gaps=(0.0, 0.9))


def fleet_parameter(name: str, unit: str, values: Sequence[FleetValue], marked: Collection[str]) -> Figure:
    """One column a robot, its dates from left to right; marked: robots with a finding."""
    robots, days = list(dict.fromkeys(value.robot for value in values)), sorted({value.day for value in values})
    width, curves = 0.6 / max(1, len(days)), []
    for is_marked in (False, True):
        if own := [value for value in values if (value.robot in marked) == is_marked]:
            x = np.array([robots.index(v.robot) + width * (days.index(v.day) - (len(days) - 1) / 2) for v in own])
            y, std = np.array([(value.value, value.std) for value in own]).T
            text = "differs or drifts" if is_marked else "robot, dates from left to right"
            color, size = style.FITTED if is_marked else style.TOTAL, 2.5 if len(robots) > 12 else 5
            curves.append(Curve(x, y, text, color, True, style.about(y, std), looks={"ms": size}))
    of_unit, names_fit = f" in {style.pretty_unit(unit)}" if unit else "", len(robots) <= 40
    panel = Panel(curves, "" if names_fit else "robot", f"{name}{of_unit}")
    figure = style.matrix(f"{name} over the fleet", [[panel]], 1.7)
    figure.axes[0].ticklabel_format(axis="y", useOffset=False)
    if names_fit:
        style.set_names(figure.axes[0].xaxis, robots, rotation=90 if len(robots) > 12 else 0)
    return figure
