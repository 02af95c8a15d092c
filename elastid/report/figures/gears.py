"""The torsion of each gear over its torque, to and fro, with its band."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.nonlinear.gear_result import ARCMIN, GearResult, GearSheet
from elastid.report.figures import style
from elastid.robot import Robot

_COLUMNS = 3


def hysteresis(gears: GearResult, robot: Robot | None) -> Figure:
    """Two panels a gear: torsion with its 95 % band; the same less that of the stiffness at zero torque."""
    count = len(gears.sheets)
    columns = min(_COLUMNS, count)
    rows = 2 * math.ceil(count / columns)
    size, margins = (style.WIDE, 2.4 * rows + 0.6), (0.8, 0.25, 0.95, 0.6)
    figure, panels = style.panels(rows, columns, size, margins, (0.35, 0.5))
    for spare in panels.flat:
        spare.set_axis_off()
    drawn = []
    for i, sheet in enumerate(gears.sheets):
        slides = robot is not None and robot.slides(f"motor {sheet.joint}")
        factor, angle, torque = (1e3, "mm", "N") if slides else (ARCMIN, "arcmin", "N·m")
        stiffness = sheet.number(f"k_{sheet.joint}")
        linear = sheet.torque / (math.inf if stiffness is None else stiffness.value)
        row, column = divmod(i, columns)
        for axes, less in ((panels[2 * row, column], 0.0 * linear), (panels[2 * row + 1, column], linear)):
            axes.set_axis_on()
            _draw_loop(axes, sheet, less, factor)
            drawn.append(axes)
        panels[2 * row, column].plot(sheet.torque, factor * linear, color=style.WEAK, ls="--", label="k at zero torque")
        words = f"joint {sheet.joint}"
        style.label(panels[2 * row, column], f"torque of the gear in {torque}", f"torsion in {angle}", words)
        style.label(panels[2 * row + 1, column], f"torque of the gear in {torque}", f"less torque / k, {angle}", words)
    return style.finish(figure, "Torsion of the gears over their torque", drawn, drawn[:1])


def _draw_loop(axes: Axes, sheet: GearSheet, less: FloatArray, factor: float) -> None:
    """To and fro, each half with its own band."""
    half = len(sheet.torque) // 2
    y = factor * (sheet.torsion - less)
    for part in (slice(None, half), slice(half, None)):
        rising = np.argsort(sheet.torque[part])
        band = QUANTILE_95 * factor * sheet.torsion_std[part][rising]
        style.fill_band(axes, sheet.torque[part][rising], y[part][rising], band, style.FITTED, 0.3, label="95 % band")
    axes.plot(sheet.torque, y, color=style.FITTED, lw=1.2, label="torsion, to and fro")
