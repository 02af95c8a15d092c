"""The fit: parameters with intervals, costs of starts, correlations, singular values, indices; torsion of gears."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.fit.result import FitResult
from elastid.nonlinear.gear_result import ARCMIN, GearResult, GearSheet
from elastid.report.content import ParameterRow
from elastid.report.figures import style
from elastid.robot import Robot

# Inches: the panel of singular values is so wide, and so far from the matrix.
VALUES_WIDTH, GAP = 3.2, 1.5


def identifiability(result: FitResult) -> Figure:
    """Correlations of the estimates, numbers where |r| > 0.9; singular values of the scaled Jacobian."""
    n = len(result.parameters.asked)
    r, s, names = result.correlation[:n, :n], result.singular_values, result.parameters.free_names[:n]
    side = float(np.clip(0.27 * len(r), 2.4, 7.0))
    letters = 0.25 + 0.075 * max(map(len, names))
    left, top, bottom = letters + 0.1, 0.75, max(letters, 0.55)
    width, height = left + side + GAP + VALUES_WIDTH + 0.3, top + side + bottom
    figure = Figure(figsize=(width, height))
    matrix, values, scale = (
        figure.add_axes((x / width, bottom / height, wide / width, side / height))
        for x, wide in ((left, side), (left + side + GAP, VALUES_WIDTH), (left + side + 0.1, 0.1))
    )
    _draw_correlations(matrix, r, names, min(style.SMALL, 72 * side / len(r) * 0.8))
    bar = figure.colorbar(matrix.images[0], cax=scale)
    bar.ax.tick_params(labelsize=style.SMALL, length=2)
    style.label(matrix, title="correlation of the estimates")
    values.plot(np.arange(1, len(s) + 1), s, ls="none", marker="o", ms=4.5, color=style.MEASURED)
    if np.all(s > 0):
        style.set_log_values(values, float(s[-1]), float(s[0]))
    style.set_plain_ticks(values.xaxis, list(range(1, len(s) + 1, math.ceil(len(s) / 10))))
    condition = s[0] / s[-1] if s[-1] > 0 else math.inf
    style.label(values, x="number", title=f"singular values, condition {condition:.3g}")
    return style.finish(figure, "How well the data determine the parameters", (values,))


def _draw_correlations(axes: Axes, r: FloatArray, names: Sequence[str], size: float) -> None:
    axes.set_facecolor(style.SHADE)
    axes.imshow(r, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest", aspect="auto")
    style.set_names(axes.xaxis, names, rotation=90, fontsize=size)
    style.set_names(axes.yaxis, names, fontsize=size)
    axes.tick_params(length=0)
    for i, j in np.argwhere(np.abs(r) > 0.9):
        if i != j:
            axes.text(j, i, f"{r[i, j]:.2f}", ha="center", va="center", color="white", fontsize=0.75 * size)


def forest(rows: Sequence[ParameterRow]) -> Figure:
    """Left: ratio of start and estimate to a reference; right: deviation from it in percent.

    The reference is the truth, or the estimate where no truth is known. Bars are 95 % intervals.
    """
    figure, ratio, percent = _panels(rows)
    y, at_bound = np.arange(float(len(rows))), np.array([row.at_bound for row in rows])
    reference = np.array([row.reference for row in rows])
    start = np.array([row.start for row in rows]) / reference
    bounds = np.array([row.bounds for row in rows]) / reference[:, None]
    truths = [np.nan if row.truth is None else row.truth for row in rows]
    values = np.array([(row.estimate, *row.interval, truth) for row, truth in zip(rows, truths, strict=True)])
    ratios = values / reference[:, None]
    low, high = _ratio_axis(ratio, np.concatenate([start, ratios[:, 0], ratios[:, 3]]))
    ratio.plot(start, y, ls="none", marker="o", ms=5, mfc="none", color=style.START, label="start")
    _draw(ratio, ratios, at_bound)
    near = (bounds > low) & (bounds < high)
    if near.any():
        at = np.broadcast_to(y[:, None], bounds.shape)[near]
        ratio.plot(bounds[near], at, ls="none", marker="|", ms=9, color=style.WEAK, label="bound")
    deviations = 100 * np.sign(reference)[:, None] * (ratios - 1)  # more is to the right
    _draw(percent, deviations, at_bound)
    _percent_axis(percent, deviations)
    return style.finish(figure, "Parameters", (), (ratio, percent))


def _panels(rows: Sequence[ParameterRow]) -> tuple[Figure, Axes, Axes]:
    size = 9.0, 0.26 * len(rows) + 1.7
    left = min(3.15, 0.35 + 0.075 * max(len(row.name) for row in rows))
    figure, ((ratio, percent),) = style.panels(1, 2, size, (left, 0.22, 0.85, 0.6), (0.06, 0.0), sharey=True)
    style.set_names(ratio.yaxis, [row.name for row in rows])
    ratio.set_ylim(len(rows) - 0.4, -0.6)
    known = [row.truth is not None for row in rows]
    to = "truth" if all(known) else "truth (estimate where none is known)" if any(known) else "estimate"
    style.label(ratio, x=f"ratio to the {to}")
    style.label(percent, x=f"deviation from the {to} in %")
    return figure, ratio, percent


def _draw(axes: Axes, values: FloatArray, at_bound: BoolArray) -> None:
    """values (n, 4): estimate, ends of the interval, truth (NaN where unknown) of the row at 0, 1, 2 ..."""
    y = np.arange(float(len(values)))
    axes.hlines(y, *values[:, 1:3].T, color=style.MEASURED, lw=2.2, alpha=0.55, label="95 % interval")
    for keep, marker, size, color, label in (
        (~at_bound, "o", 4.5, style.MEASURED, "estimate"),
        (at_bound, "s", 6.0, style.FITTED, "estimate at its bound"),
    ):
        if keep.any():
            axes.plot(values[keep, 0], y[keep], ls="none", marker=marker, ms=size, color=color, label=label)
    if np.isfinite(values[:, 3]).any():
        axes.plot(values[:, 3], y, ls="none", marker="|", ms=11, mew=1.4, color=style.TRUTH, label="truth")
    style.lighten(axes)
    axes.grid(axis="y", visible=False)


def _ratio_axis(axes: Axes, shown: FloatArray) -> tuple[float, float]:
    """Logarithmic, wide enough for starts, estimates and truths; what is not positive is not drawn."""
    shown = shown[np.isfinite(shown) & (shown > 0)]
    low, high = min(0.5, *shown) / 1.15, max(2.0, *shown) * 1.15
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    style.set_plain_ticks(axes.xaxis, style.round_ticks(low, high, 7))
    return low, high


def _percent_axis(axes: Axes, values: FloatArray) -> None:
    """Linear near zero, logarithmic beyond, so that 0.1 % and 100 % can be read in one figure, up to 300 %."""
    half = (values[:, 2] - values[:, 1]) / 2
    half = half[np.isfinite(half) & (half > 0)]
    typical = float(np.percentile(half, 25)) if half.size else 1.0
    reach = np.abs(values[:, :3])
    largest = float(np.clip(reach[np.isfinite(reach)].max(initial=typical), 1.5 * typical, 300.0))
    smallest = 10.0 ** round(math.log10(typical))
    decades = [smallest * 10.0**decade for decade in range(7)]
    steps = [step for step in sorted([*decades, *(3 * decade for decade in decades)]) if step <= 1.2 * largest]
    # With more than four steps to a side the axis has decades only.
    steps = steps if len(steps) <= 4 else [step for step in decades if step <= 1.2 * largest]
    axes.set_xscale("symlog", linthresh=smallest)
    axes.set_xlim(-1.3 * largest, 1.3 * largest)
    style.set_plain_ticks(axes.xaxis, [*(-step for step in reversed(steps)), 0.0, *steps])
    axes.tick_params(axis="y", length=0)
    axes.axvline(0, color="#999999", lw=0.6, zorder=0)
    for side, marker in ((1, ">"), (-1, "<")):
        beyond = np.flatnonzero(side * values[:, 0] > 1.3 * largest)
        if beyond.size:
            edge = np.full(len(beyond), side * 1.2 * largest)
            axes.plot(edge, beyond, marker, ms=6, color=style.FITTED, label="estimate off the scale")


def hysteresis(gears: GearResult, robot: Robot | None) -> Figure:
    """Two panels a gear: torsion with its 95 % band; the same less that of the stiffness at zero torque."""
    count = len(gears.sheets)
    columns = min(3, count)
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
