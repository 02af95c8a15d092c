"""What a plan is expected to tell and where from, and the robot as a stick figure in each configuration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.design.forecast import Forecast
from elastid.model.kinematics import link_angles
from elastid.model.stick_figure import Kind, stick_figure
from elastid.record import Configuration
from elastid.report.figures import style
from elastid.robot import Robot

# Columns of the frequency axis: lines closer than this are drawn together.
BANDS = 60
# Stick figures side by side.
ACROSS = 4
LOOKS: dict[Kind, tuple[str, float]] = {
    "arm": (style.MEASURED, 3.0),
    "mass": (style.FITTED, 1.5),
    "strut": (style.NOISE, 2.0),
}


def information(forecast: Forecast) -> Figure:
    """Where what is known comes from: by configuration and frequency (left), by configuration and parameter (right)."""
    names, parameters = forecast.configurations, forecast.parameters
    height = max(1.5 + 0.3 * len(names), 3.2)
    figure = Figure(figsize=(9.5, height))
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1))
    figure.subplots_adjust(left=0.1, right=0.99, top=1 - 0.62 / height, bottom=0.75 / height, wspace=0.2)
    edges = np.geomspace(forecast.freq_hz[0] / 1.01, forecast.freq_hz[-1] * 1.01, BANDS + 1)
    by_line = _in_bands(forecast.freq_hz, forecast.share.mean(axis=2), edges)
    rows = np.arange(len(names) + 1) - 0.5
    left.pcolormesh(edges, rows, 100 * by_line, cmap="Blues", vmin=0)
    style.log_frequency(left, forecast.freq_hz)
    left.set_xlabel("frequency in Hz", fontsize=style.NORMAL)
    left.set_title("part of all information", fontsize=style.NORMAL)
    by_parameter = 100 * forecast.share.sum(axis=1)
    right.pcolormesh(np.arange(len(parameters) + 1) - 0.5, rows, by_parameter, cmap="Blues", vmin=0, vmax=100)
    right.set_xticks(range(len(parameters)), [style.plain(name) for name in parameters], rotation=90)
    right.set_title("part of what is known about a parameter in %", fontsize=style.NORMAL)
    if len(names) * len(parameters) <= 400:
        _numbers(right, by_parameter)
    for axes in (left, right):
        axes.set_yticks(range(len(names)), [style.plain(name) for name in names] if axes is left else [])
        axes.invert_yaxis()
        axes.tick_params(labelsize=style.SMALL, length=2)
    style.titled(figure, "Expected information by configuration")
    return figure


def _in_bands(freq_hz: FloatArray, share: FloatArray, edges: FloatArray) -> FloatArray:
    """Shares (Q, F) summed within the bands (Q, BANDS), NaN where there is no line."""
    band = np.clip(np.searchsorted(edges, freq_hz) - 1, 0, len(edges) - 2)
    total = np.zeros((len(share), len(edges) - 1))
    np.add.at(total.T, band, share.T)
    total[:, np.bincount(band, minlength=len(edges) - 1) == 0] = np.nan
    return total


def _numbers(axes: object, values: FloatArray) -> None:
    for (row, column), value in np.ndenumerate(values):
        if value >= 0.5:
            color = "white" if value > 60 else "black"
            axes.text(column, row, f"{value:.0f}", ha="center", va="center", fontsize=6, color=color)  # type: ignore[attr-defined]


def postures(robot: Robot, configurations: Sequence[Configuration], words: Sequence[str]) -> Figure:
    """The robot as a stick figure in each configuration, all to one scale; words below each name."""
    angles = np.stack([configuration.angles for configuration in configurations])
    drawn = [stick_figure(robot, q) for q in link_angles(robot, angles)]
    up = int(np.argmax(np.abs(robot.gravity))) if any(robot.gravity) else 2
    order = [(up + 1) % 3, (up + 2) % 3, up]
    down = -np.sign(robot.gravity[up]) or 1.0
    stand = np.stack([figure.points for figure in drawn])[:, :, order] * [1, 1, down]
    # All to one scale, the base in the middle.
    side = max(float(np.abs(stand[:, :, :2]).max()), 0.5 * float(np.abs(stand[:, :, 2]).max()), 1e-6)
    bottom, top = min(0.0, float(stand[:, :, 2].min())), max(float(stand[:, :, 2].max()), 1e-6)
    across = min(ACROSS, len(configurations))
    rows = -(-len(configurations) // across)
    figure = Figure(figsize=(2.4 * across, 2.7 * rows + 0.3))
    for i, (configuration, word) in enumerate(zip(configurations, words, strict=True)):
        axes = figure.add_subplot(rows, across, i + 1, projection="3d")
        points = stand[i]
        for a, b, kind in drawn[i].links:
            color, width = LOOKS[kind]
            axes.plot(*points[[a, b]].T, color=color, lw=width, solid_capstyle="round")
            axes.plot(*points[[a, b], :2].T, [bottom, bottom], color=style.WEAK, lw=1)
        axes.plot(*points[list(drawn[i].joints)].T, ls="none", marker="o", ms=4, color=style.TRUTH)
        axes.set(xlim=(-side, side), ylim=(-side, side), zlim=(bottom, top))
        axes.set_box_aspect((2 * side, 2 * side, top - bottom), zoom=1.1)
        axes.tick_params(labelsize=5, pad=-3)
        axes.locator_params(nbins=3)
        axes.set_title(style.plain(f"{configuration.name}\n{word}"), fontsize=style.SMALL, pad=-2)
    figure.subplots_adjust(
        left=0.02, right=0.98, top=1 - 0.65 / (2.7 * rows + 0.3), bottom=0.03, wspace=0.1, hspace=0.25
    )
    style.titled(figure, "Configurations (m; orange: to a centre of mass, green: rods and struts)")
    return figure
