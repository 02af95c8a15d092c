"""Modes of the identified model: bars, sketches of the robot at both ends of its swing; poles of a measurement.

All panels are on one canvas in inches, to one scale: axes of their own would take most of the time of a report.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.display import number
from elastid.modal.modes import Modes
from elastid.model.kinematics import StickKind
from elastid.report.figures import style
from elastid.report.modes import ModeDrawing, ModeRow


def mode_shapes(row: ModeRow, title: str, rate_is_known: bool) -> Figure:
    """A row of bars for each mode, one for every coordinate: its part in phase with the largest one, which is 1.

    The part out of phase (damping that is not proportional) is a dash. Joints are relative angles, motors are on the
    link side: the torsion of a gear spring is the difference of the two.
    """
    shapes, names = row.shapes, row.coordinates
    n, n_m = shapes.shape
    left = 1.25 if rate_is_known else 1.6
    width = float(np.clip(left + 0.45 + 0.42 * n, 4.5, 11.0))
    panel, below = float(np.clip(5.0 / max(n_m, 1), 0.6, 0.9)), 0.3 + 0.065 * max(map(len, names))
    height = 0.85 + n_m * panel + below
    margins = left, 0.15, 0.8, below
    figure, panels = style.panels(n_m, 1, (width, height), margins, (0.0, 0.35), sharex=True, sharey=True)
    x = np.arange(n)
    colors = [style.START if name.startswith("motor") else style.MEASURED for name in names]
    bar = 0.6 * 72 * (width - margins[0] - margins[1]) / n  # points
    for m, axes in enumerate(panels.flat):
        axes.xaxis.set_visible(m == n_m - 1)  # ticks of all panels would take most of the time
        axes.vlines(x, 0, shapes[:, m].real, colors=colors, linewidth=bar)
        axes.plot(x, shapes[:, m].imag, ls="none", marker="_", ms=7, mew=1, color=style.TRUTH)
        axes.axhline(0, color=style.TRUTH, lw=0.5)
        axes.set_yticks([-1, 0, 1])
        axes.set(xlim=(-0.6, n - 0.4), ylim=(-1.15, 1.15))
        axes.set_title(style.plain(row.energy_text[m]), loc="left", fontsize=style.SMALL, pad=2)
        numbers = f"{number(row.frequency_hz[m])} {style.frequency_unit(rate_is_known)}"
        numbers += f"\n{number(100 * row.damping_ratio[m], 2)} %"
        axes.set_ylabel(numbers, rotation=0, ha="right", va="center", fontsize=style.NORMAL, labelpad=4)
    style.set_names(panels[-1, 0].xaxis, names, rotation=90)
    key = "blue: joints, orange: motors (link side); dash: part out of phase"
    figure.text(0.125 / width, 1 - 0.4 / height, key, fontsize=style.SMALL, va="center")
    return style.finish(figure, f"Mode shapes, {title}", panels.flat)


# Inches: the width of a panel, and the room on its left, above it, below it, and above all.
PANEL_WIDTH, LEFT, ABOVE, BELOW, TITLE = 1.4, 0.45, 0.6, 0.42, 0.35
# Small print: letters to an inch, lines above a panel; numbers on an axis.
LETTERS_PER_INCH, MAX_LINES, MAX_TICKS = 15, 3, 4
WIDTHS: dict[StickKind, float] = {"arm": 2.4, "strut": 1.3, "mass": 0.8}


@frozen_value
class Panel:
    """A view of a mode on the canvas, in inches.

    plane: axes of the base frame to the right and upwards.  corner: lower left.  low (2,): the coordinates at the
    corner, m.  inches: to a metre.  hanging: coordinates increase downwards.
    """

    mode: int
    plane: tuple[int, int]
    corner: tuple[float, float]
    size: tuple[float, float]
    low: FloatArray
    inches: float
    hanging: bool

    def placed(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) in m on the canvas (..., 2)."""
        x, y = (self.inches * (points[..., axis] - self.low[i]) for i, axis in enumerate(self.plane))
        y = self.size[1] - y if self.hanging else y
        return np.stack([self.corner[0] + x, self.corner[1] + y], axis=-1)


def mode_sketches(row: ModeRow, drawing: ModeDrawing, title: str, rate_is_known: bool) -> Figure:
    """The sticks of each mode in its one or two best views, the energy of its springs above them."""
    size, panels = _lay_out(drawing)
    figure = Figure(figsize=size)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, size[0]), ylim=(0, size[1]))
    axes.axis("off")
    for panel in panels:
        _draw_axes(axes, panel)
    _draw_sticks(axes, drawing, panels)
    columns = max(len(drawing.views(mode)) for mode in range(len(row.frequency_hz)))
    for mode in range(len(row.frequency_hz)):
        first = next(panel for panel in panels if panel.mode == mode)
        lines = _caption(row, mode, rate_is_known, columns * (PANEL_WIDTH + LEFT) - 0.1)
        x, y = first.corner[0], first.corner[1] + first.size[1] + 0.07
        axes.text(x, y, style.plain("\n".join(lines)), fontsize=style.SMALL, va="bottom", linespacing=1.3)
    return style.finish(figure, f"Modes, {title}: frequency, damping ratio, energy by spring")


def _caption(row: ModeRow, mode: int, rate_is_known: bool, width: float) -> list[str]:
    frequency = f"{number(row.frequency_hz[mode])} {style.frequency_unit(rate_is_known)}"
    first = f"mode {mode + 1}: {frequency}, {number(100 * row.damping_ratio[mode], 2)} %"
    # No line break within a share.
    shares = row.energy_text[mode].replace(" ", "\u00a0").replace(",\u00a0", ", ")
    return [first, *textwrap.wrap(shares, int(LETTERS_PER_INCH * width))][:MAX_LINES]


def _lay_out(drawing: ModeDrawing) -> tuple[tuple[float, float], list[Panel]]:
    views = [drawing.views(mode) for mode in range(drawing.moved.shape[2])]
    columns = max(map(len, views))
    modes_a_row = min(6 // columns, max(len(views), 4 // columns))  # four to six panels side by side
    middle, half = _middle(drawing, views)
    inches = PANEL_WIDTH / (2 * half[0])
    panel = PANEL_WIDTH, 2 * half[1] * inches
    pitch_x, pitch_y = PANEL_WIDTH + LEFT, panel[1] + ABOVE + BELOW
    size = modes_a_row * columns * pitch_x + 0.1, -(-len(views) // modes_a_row) * pitch_y + TITLE
    panels = []
    for mode, planes in enumerate(views):
        down, right = divmod(mode, modes_a_row)
        for column, plane in enumerate(planes):
            corner = LEFT + (right * columns + column) * pitch_x, size[1] - TITLE - (down + 1) * pitch_y + BELOW
            hanging = drawing.hanging and plane[1] == drawing.up
            panels.append(Panel(mode, plane, corner, panel, middle[list(plane)] - half, inches, hanging))
    return size, panels


def _middle(drawing: ModeDrawing, views: Sequence[tuple[tuple[int, int], ...]]) -> tuple[FloatArray, FloatArray]:
    """The middle (3,) of the motion, and half the width and height (2,) of a panel that holds any view of it."""
    reach = np.abs(drawing.moved.real).max(axis=2)
    low, high = (drawing.points - reach).min(axis=0), (drawing.points + reach).max(axis=0)
    planes = [plane for pair in views for plane in pair]
    wide, tall = (max(float((high - low)[plane[i]]) for plane in planes) / (2 / 1.08) for i in (0, 1))
    wide = max(wide, tall / 1.3)  # a panel's height over its width, whatever the robot
    return (low + high) / 2, np.array([wide, max(tall, 0.5 * wide)])


def _draw_sticks(axes: Axes, drawing: ModeDrawing, panels: Sequence[Panel]) -> None:
    """Grey at rest, below orange and blue at the ends of the swing; joints are dots, the base is a square."""
    pairs = np.array([link[:2] for link in drawing.links])
    widths = [WIDTHS[kind] for _, _, kind in drawing.links] * len(panels)
    for sign, color in ((0, style.WEAK), (-1, style.FITTED), (1, style.MEASURED)):
        points = [panel.placed(drawing.points + sign * drawing.moved[:, :, panel.mode].real) for panel in panels]
        segments = np.concatenate([placed[pairs] for placed in points])
        axes.add_collection(LineCollection(list(segments), colors=color, linewidths=widths, capstyle="round"))
        joints = np.concatenate([placed[list(drawing.joints)] for placed in points])
        axes.plot(*joints.T, ls="none", marker="o", ms=3.2, color=color, mec="white", mew=0.4)
    base = np.array([panel.placed(drawing.points[0]) for panel in panels])
    axes.plot(*base.T, ls="none", marker="s", ms=5, color=style.TRUTH)


def _draw_axes(axes: Axes, panel: Panel) -> None:
    (left, bottom), (wide, high) = panel.corner, panel.size
    grid = []
    small: dict[str, Any] = {"fontsize": style.SMALL - 0.5}
    for value in _ticks(panel, 0):
        x = panel.placed(np.full(3, value))[0]
        grid.append([(x, bottom), (x, bottom + high)])
        axes.text(x, bottom - 0.05, f"{value:g}", ha="center", va="top", **small)
    for value in _ticks(panel, 1):
        y = panel.placed(np.full(3, value))[1]
        grid.append([(left, y), (left + wide, y)])
        axes.text(left - 0.05, y, f"{value:g}", ha="right", va="center", **small)
    x_name, y_name = (f"{'xyz'[axis]} in m" for axis in panel.plane)
    axes.text(left + wide / 2, bottom - 0.27, x_name, ha="center", va="center", **small)
    axes.text(left - 0.36, bottom + high / 2, y_name, ha="center", va="center", rotation=90.0, **small)
    axes.add_collection(LineCollection(grid, colors=style.GRID, linewidths=0.4))
    corner = [(left, bottom + high), (left, bottom), (left + wide, bottom)]
    axes.add_collection(LineCollection([corner], colors=style.TRUTH, linewidths=0.6))


def _ticks(panel: Panel, i: int) -> list[float]:
    low, high = panel.low[i], panel.low[i] + panel.size[i] / panel.inches
    values = MaxNLocator(MAX_TICKS, steps=[1, 2, 5, 10]).tick_values(low, high)
    return [round(float(value), 12) + 0.0 for value in values if low <= value <= high]


# Poles shown are within this part of the band beyond its ends.
BEYOND = 0.02


def stabilisation_diagram(modes: Modes, title: str) -> Figure:
    """Poles by frequency and order over the singular values of the response; lines at the modes."""
    figure, panels = style.panels(1, 1, (style.WIDE, 4.2), (0.8, 0.8, 0.85, 0.55), (0.0, 0.0))
    axes, diagram = panels[0, 0], modes.diagram
    indicators = axes.twinx()
    floor = np.finfo(float).tiny
    indicators.plot(modes.at_hz, style.in_db(modes.indicators + floor), color=style.WEAK, lw=0.8, zorder=1)
    style.label(indicators, y=f"singular values, dB re 1 {style.pretty_unit(modes.unit)}")
    for stable, marker, color, text in (
        (False, ".", style.WEAK, "pole"), (True, "o", style.MEASURED, "stable in frequency (1 %) and damping (5 %)"),
    ):  # fmt: skip
        own = diagram.stable == stable
        axes.plot(diagram.freq_hz[own], diagram.order[own], ls="none", marker=marker, ms=3, color=color, label=text)
    for i, freq_hz in enumerate(modes.freq_hz):
        axes.axvline(freq_hz, color=style.FITTED, lw=0.8, zorder=0.8, label="mode" if i == 0 else None)
    axes.set_zorder(2)
    axes.patch.set_visible(False)
    width = modes.at_hz[-1] - modes.at_hz[0]
    axes.set_xlim(modes.at_hz[0] - BEYOND * width, modes.at_hz[-1] + BEYOND * width)
    style.label(axes, style.frequency_label(modes.rate_is_known), "order")
    return style.finish(figure, f"Stabilisation diagram, {title}", [axes], [axes])


def synthesis_error(modes: Modes, title: str) -> Figure:
    """The error of the modal model line by line, and the part of it that the noise of the response explains."""
    figure, panels = style.panels(1, 1, (style.WIDE, 2.8), (0.8, 0.25, 0.85, 0.55), (0.0, 0.0))
    axes, f = panels[0, 0], modes.at_hz
    curves = ((100 * modes.error, style.RESIDUAL, 0.8, "modal model"), (100 * modes.stated, style.NOISE, 1.0, "noise"))
    style.plot_curves(axes, f, *curves)
    axes.set_yscale("log")
    style.label(axes, style.frequency_label(modes.rate_is_known), "% of |G|, RMS over elements")
    return style.finish(figure, f"Error of the synthesis, {title}", [axes], [axes])
