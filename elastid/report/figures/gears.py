"""The torsion of each gear over its torque, to and fro, with its band."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from elastid.base.statistics import QUANTILE_95
from elastid.nonlinear.gear_result import ARCMIN, GearResult
from elastid.report.figures import style
from elastid.robot import Robot

_COLUMNS = 3


def hysteresis(gears: GearResult, robot: Robot | None) -> Figure:
    """One panel a gear: torsion, its 95 % band, and the stiffness at zero torque as a line."""
    count = len(gears.sheets)
    columns = min(_COLUMNS, count)
    rows = math.ceil(count / columns)
    size, margins = (style.WIDE, 3.2 * rows + 0.6), (0.8, 0.25, 0.95, 0.6)
    figure, panels = style.panels(rows, columns, size, margins, (0.35, 0.45))
    for spare in panels.flat:
        spare.set_axis_off()
    drawn = []
    for sheet, axes in zip(gears.sheets, panels.flat, strict=False):
        slides = robot is not None and robot.slides(f"motor {sheet.joint}")
        factor, angle, torque = (1e3, "mm", "N") if slides else (ARCMIN, "arcmin", "N·m")
        axes.set_axis_on()
        half = len(sheet.torque) // 2
        for part in (slice(None, half), slice(half, None)):
            rising = np.argsort(sheet.torque[part])
            x, y, std = (each[part][rising] for each in (sheet.torque, sheet.torsion, sheet.torsion_std))
            style.fill_band(axes, x, factor * y, QUANTILE_95 * factor * std, style.FITTED, 0.3, label="95 % band")
        axes.plot(sheet.torque, factor * sheet.torsion, color=style.FITTED, lw=1.2, label="torsion, to and fro")
        stiffness = sheet.number(f"k_{sheet.joint}")
        if stiffness is not None:
            ends = np.array([-1.0, 1.0]) * sheet.peak
            axes.plot(
                ends, factor * ends / stiffness.value, color=style.WEAK, lw=0.9, ls="--", label="k at zero torque"
            )
        style.label(axes, f"torque of the gear in {torque}", f"torsion in {angle}", f"joint {sheet.joint}")
        drawn.append(axes)
    return style.finish(figure, "Torsion of the gears over their torque", drawn, drawn[:1])
