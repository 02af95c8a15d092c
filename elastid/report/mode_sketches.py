"""Every mode of the identified model as the robot would show it: at rest, and at both ends of its swing."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from elastid.arrays import FloatArray
from elastid.model.stick_figure import Kind
from elastid.report import style
from elastid.report.mode_drawing import ModeDrawing
from elastid.report.mode_row import ModeRow
from elastid.report.numbers import number

# Panels side by side: at most, at least; in inches: their width, and the room beside, above and below each.
ACROSS, LEAST, WIDE, BESIDE, ABOVE, BELOW = 6, 4, 1.4, 0.45, 0.6, 0.42
# A panel is at least and at most so much higher than wide, whatever the robot.
FLAT, TALL = 0.5, 1.3
# Letters of an inch of a line of small print, and lines above a panel.
LETTERS, LINES = 15, 3
WIDTHS: dict[Kind, float] = {"arm": 2.4, "strut": 1.3, "mass": 0.8}


def mode_sketches(row: ModeRow, drawing: ModeDrawing, title: str, rate_is_known: bool) -> Figure:
    """The sticks of each mode in its one or two best views, all to one scale; above them what stores the energy."""
    views = [drawing.views(mode) for mode in range(len(row.frequency_hz))]
    columns = max(map(len, views))
    modes_a_row = min(ACROSS // columns, max(len(views), LEAST // columns))
    rows = -(-len(views) // modes_a_row)
    middle, (half_wide, half_high) = _middles(drawing, views)
    high = WIDE * half_high / half_wide
    size = modes_a_row * columns * (WIDE + BESIDE) + 0.1, rows * (high + ABOVE + BELOW) + 0.35
    figure = Figure(figsize=size)
    unit = "Hz" if rate_is_known else "of the rate"
    for mode, planes in enumerate(views):
        down, right = divmod(mode, modes_a_row)
        bottom = size[1] - 0.35 - (down + 1) * (high + ABOVE + BELOW) + BELOW
        for column, plane in enumerate(planes):
            left = BESIDE + (right * columns + column) * (WIDE + BESIDE)
            axes = figure.add_axes((left / size[0], bottom / size[1], WIDE / size[0], high / size[1]))
            _panel(axes, drawing, mode, plane)
            center = middle[list(plane)]
            axes.set(xlim=center[0] + half_wide * np.array([-1, 1]), ylim=center[1] + half_high * np.array([-1, 1]))
            if drawing.hanging and plane[1] == drawing.up:
                axes.invert_yaxis()
            if column == 0:
                words = f"mode {mode + 1}: {number(row.frequency_hz[mode])} {unit}, "
                words += f"{number(100 * row.damping_ratio[mode], 2)} %"
                room = int(LETTERS * (columns * (WIDE + BESIDE) - 0.1))
                # A share is not broken.
                shares = row.carried[mode].replace(" ", "\u00a0").replace(",\u00a0", ", ")
                lines = [words, *textwrap.wrap(shares, room)]
                axes.set_title(style.plain("\n".join(lines[:LINES])), loc="left", fontsize=style.SMALL, pad=4)
    style.titled(figure, f"Modes, {title}: frequency, damping ratio, where the energy is")
    return figure


def _middles(
    drawing: ModeDrawing, views: Sequence[tuple[tuple[int, int], ...]]
) -> tuple[FloatArray, tuple[float, float]]:
    """The middle (3,) of what is drawn, and half the width and height that every panel needs, all to one scale."""
    reach = np.abs(drawing.moved.real).max(axis=2, initial=0.0)
    low, high = (drawing.points - reach).min(axis=0), (drawing.points + reach).max(axis=0)
    half = 0.54 * (high - low)
    planes = {plane for pair in views for plane in pair}
    wide, tall = (max(float(half[plane[i]]) for plane in planes) for i in (0, 1))
    wide = max(wide, tall / TALL)
    return (low + high) / 2, (wide, max(tall, FLAT * wide))


def _panel(axes: Axes, drawing: ModeDrawing, mode: int, plane: tuple[int, int]) -> None:
    pairs = [link[:2] for link in drawing.links]
    widths = [WIDTHS[kind] for _, _, kind in drawing.links]
    seen = list(plane)
    for sign, color in ((0, style.WEAK), (-1, style.FITTED), (1, style.MEASURED)):
        points = (drawing.points + sign * drawing.moved[:, :, mode].real)[:, seen]
        lines = LineCollection(
            [points[list(pair)] for pair in pairs], colors=color, linewidths=widths, capstyle="round"
        )
        axes.add_collection(lines)
        joints = points[list(drawing.joints)]
        axes.plot(*joints.T, ls="none", marker="o", ms=3.2, color=color, mec="white", mew=0.4, zorder=3)
    base = drawing.points[0, seen]
    axes.plot(*base, ls="none", marker="s", ms=5, color=style.TRUTH, zorder=4)
    style.light(axes)
    axes.set_aspect("equal")
    axes.locator_params(nbins=4)
    axes.set_xlabel(f"{'xyz'[plane[0]]} in m", fontsize=style.SMALL, labelpad=1)
    axes.set_ylabel(f"{'xyz'[plane[1]]} in m", fontsize=style.SMALL, labelpad=1)
