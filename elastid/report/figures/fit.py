"""The fit: parameters with intervals, correlations, information and limits of a plan; torsion of gears."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import BoolArray, FloatArray
from elastid.design.forecast import QUANTITIES, Forecast, LimitUse
from elastid.fit.result import Result
from elastid.nonlinear.gear_result import ARCMIN, GearResult, GearSheet
from elastid.report.content import ParameterRow
from elastid.report.figures import style
from elastid.report.figures.style import Cells, Curve, Panel
from elastid.robot import Robot


def forest(rows: Sequence[ParameterRow]) -> Figure:
    """Left: ratio of start and estimate to a reference; right: deviation from it in percent.

    The reference is the truth, or the estimate where no truth is known. Bars are 95 % intervals.
    """
    y, reference = np.arange(float(len(rows))), np.array([row.reference for row in rows])
    truths = [np.nan if row.truth is None else row.truth for row in rows]
    values = np.array([(row.estimate, *row.interval, truth) for row, truth in zip(rows, truths, strict=True)])
    start = np.array([row.start for row in rows]) / reference
    bounds = np.array([row.bounds for row in rows]).T / reference
    ratios = values / reference[:, None]
    shown = np.concatenate([start, ratios[:, 0], ratios[:, 3]])
    shown = shown[np.isfinite(shown) & (shown > 0)]
    low, high = min(0.5, *shown) / 1.15, max(2.0, *shown) * 1.15
    marks = [Curve(start, y, "start", style.START, True, looks={"ms": 5, "mfc": "none", "mew": 1})]
    near = (bounds > low) & (bounds < high)
    pairs = zip(bounds, near, strict=True)
    marks += [Curve(end[own], y[own], "bound", style.WEAK, True, looks=_BAR) for end, own in pairs if own.any()]
    at_bound = np.array([row.at_bound for row in rows])
    percent = 100 * np.sign(reference)[:, None] * (ratios - 1)  # more is to the right
    half = (percent[:, 2] - percent[:, 1]) / 2
    typical = float(np.percentile(half[np.isfinite(half) & (half > 0)], 25)) if (half > 0).any() else 1.0
    reach = np.abs(percent[:, :3])
    largest = float(np.clip(reach[np.isfinite(reach)].max(initial=typical), 1.5 * typical, 300.0))
    ends = -1.3 * largest, 1.3 * largest
    beyond = np.abs(percent[:, 0]) > ends[1]
    off = Curve(0.92 * ends[1] * np.sign(percent[beyond, 0]), y[beyond], "estimate off the scale", style.FITTED, True)
    known = [row.truth is not None for row in rows]
    to = "truth" if all(known) else "truth (estimate where none is known)" if any(known) else "estimate"
    panels = [
        Panel([*marks, *_values(ratios, at_bound)], f"ratio to the {to}", x_ends=(low, high)),
        Panel([*_values(percent, at_bound), *[off] * bool(beyond.any())], f"deviation from the {to} in %", x_ends=ends),
    ]
    left = min(3.15, 0.35 + 0.075 * max(len(row.name) for row in rows))
    figure = style.matrix("Parameters", [panels], 0.26 * len(rows) + 0.3, left=left, gaps=(0.06, 0.0), sharey=True)
    ratio, deviation = figure.axes
    style.set_names(ratio.yaxis, [row.name for row in rows])
    ratio.set_ylim(len(rows) - 0.4, -0.6)
    ratio.set_xscale("log")
    style.set_plain_ticks(ratio.xaxis, style.round_ticks(low, high, 7))
    deviation.set_xscale("symlog", linthresh=typical)  # 0.1 % and 100 % can be read in one figure
    deviation.set_xlim(*ends)
    decades = [10.0**k for k in range(math.ceil(math.log10(typical)), 4) if 10.0**k <= ends[1]]
    style.set_plain_ticks(deviation.xaxis, [*(-each for each in reversed(decades)), 0.0, *decades])
    return figure


_BAR = {"marker": "|", "ms": 10, "mew": 1.4}


def _values(values: FloatArray, at_bound: BoolArray) -> list[Curve]:
    """values (n, 4): estimate, ends of the interval, truth (NaN where unknown) of the row at 0, 1, 2 ..."""
    y = np.arange(float(len(values)))
    between = np.column_stack([values[:, 1:3], np.full(len(y), np.nan)]).ravel()
    curves = [Curve(between, np.repeat(y, 3), "95 % interval", looks={"lw": 2.2, "alpha": 0.55})]
    for own, text, ink in ((~at_bound, "estimate", style.MEASURED), (at_bound, "estimate at its bound", style.FITTED)):
        curves += [Curve(values[own, 0], y[own], text, ink, True, looks={"ms": 4.5})] if own.any() else []
    truth = Curve(values[:, 3], y, "truth", style.TRUTH, True, looks=_BAR)
    return [*curves, *[truth] * bool(np.isfinite(values[:, 3]).any())]


def identifiability(result: Result) -> Figure:
    """Correlations of the estimates, numbers where |r| > 0.9; singular values of the scaled Jacobian."""
    n = len(result.parameters.asked)
    r, s, names = result.correlation[:n, :n], result.singular_values, result.parameters.free_names[:n]
    cells = Cells(r, names, names, (-1.0, 1.0), lambda v: f"{v:.2f}" if 0.9 < abs(v) < 1 else "", "RdBu_r")
    condition = s[0] / s[-1] if s[-1] > 0 else math.inf
    values = Panel(
        [Curve(np.arange(1, len(s) + 1), s, dots=True, looks={"ms": 4.5})], "number",
        title=f"singular values, condition {condition:.3g}", scale="log" if np.all(s > 0) else "linear",
    )  # fmt: skip
    rows, left = (
        [[Panel(title="correlation of the estimates", cells=cells), values]],
        0.4 + 0.075 * max(map(len, names)),
    )
    title = "How well the data determine the parameters"
    return style.matrix(title, rows, float(np.clip(0.27 * n, 2.4, 7.0)), left=left)


def information(forecast: Forecast) -> Figure:
    """Shares of the expected information in percent: by configuration and octave, by configuration and parameter."""
    names, f = forecast.configurations, forecast.freq_hz
    octave = np.floor(np.log2(f / f[0]) + 1e-9).astype(int)
    by_octave, edges = np.zeros((len(names), octave[-1] + 1)), f[0] * 2.0 ** np.arange(octave[-1] + 1)
    np.add.at(by_octave.T, octave, 100 * forecast.share.mean(axis=2).T)

    def text(value: float) -> str:
        return f"{value:.0f}" if value >= 0.5 else ""

    octaves = [f"{edge:.3g}" for edge in edges]
    all_of = Cells(by_octave, names, octaves, (0.0, max(float(by_octave.max()), 1.0)), text)
    each = Cells(100 * forecast.share.sum(axis=1), (), forecast.parameters, text=text)
    panels = [
        Panel(x="octave above Hz", title="share of all information in %", cells=all_of),
        Panel(title="share of the information on a parameter in %", cells=each),
    ]
    left = 0.4 + 0.075 * max(map(len, names))
    return style.matrix("Expected information by configuration", [panels], 0.3 * len(names) + 0.5, left=left)


def limit_use(use: LimitUse) -> Figure:
    """Peaks in % of their limits: configurations (rows) by motors (columns), a panel for each quantity limited."""
    kinds = np.flatnonzero(np.isfinite(use.limit).any(axis=(0, 2)))
    motors = [name.removeprefix("motor ") for name in use.inputs]
    percent = 100 * np.where(np.isfinite(use.limit), use.used, np.nan)
    panels = [
        Panel(x="motor", title=f"{QUANTITIES[kind]} in % of its limit",
              cells=Cells(percent[:, kind], () if i else use.configurations, motors, (0.0, 130.0)))
        for i, kind in enumerate(kinds)
    ]  # fmt: skip
    title, tall = f"Peaks against limits ({use.margin:.0%} of each kept free)", max(0.28 * len(use.configurations), 0.8)
    return style.matrix(title, [panels], tall, left=0.4 + 0.075 * max(map(len, use.configurations)), gaps=(0.08, 0.0))


def hysteresis(gears: GearResult, robot: Robot | None) -> Figure:
    """Two panels a gear: torsion with its 95 % band; the same less that of the stiffness at zero torque."""
    above, below = [], []
    for sheet in gears.sheets:
        slides = robot is not None and robot.slides(f"motor {sheet.joint}")
        factor, angle, torque = (1e3, "mm", "N") if slides else (ARCMIN, "arcmin", "N·m")
        stiffness = sheet.number(f"k_{sheet.joint}")
        linear = sheet.torque / (math.inf if stiffness is None else stiffness.value)
        straight = Curve(sheet.torque, factor * linear, "k at zero torque", style.WEAK, looks={"ls": "--"})
        label, words = f"torque of the gear in {torque}", f"joint {sheet.joint}"
        above.append(Panel([*_loop(sheet, 0.0 * linear, factor), straight], label, f"torsion in {angle}", words))
        below.append(Panel(_loop(sheet, linear, factor), label, f"less torque / k, {angle}", words))
    rows = [row for pair in zip(style.in_columns(above), style.in_columns(below), strict=True) for row in pair]
    return style.matrix("Torsion of the gears over their torque", rows, 2.4, gaps=(0.35, 0.5))


def _loop(sheet: GearSheet, less: FloatArray, factor: float) -> list[Curve]:
    """To and fro, each half with its own band."""
    y, half = factor * (sheet.torsion - less), len(sheet.torque) // 2
    curves = []
    for part in (slice(None, half), slice(half, None)):
        rising = np.argsort(sheet.torque[part])
        x, own, std = (each[part][rising] for each in (sheet.torque, y, factor * sheet.torsion_std))
        band = style.about(own, std)
        curves.append(Curve(x, own, "torsion, to and fro", style.FITTED, band=band, band_label="95 % band"))
    return curves
