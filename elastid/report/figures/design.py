"""The plan of an experiment: where its information comes from, the robot in each configuration, the excitation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.design.forecast import Forecast
from elastid.experiment.plan.plan import Plan
from elastid.model.kinematics import link_angles
from elastid.model.stick_figure import StickKind, stick_figure
from elastid.record import Configuration
from elastid.report.figures import style
from elastid.robot import Robot

# Columns of the frequency axis: lines closer than this are drawn together.
BANDS = 60
# Shares of less are not written, in %.
MIN_WRITTEN_PERCENT = 0.5
# Stick figures side by side; width and height of each, and the room above all, in inches.
MAX_COLUMNS, PANEL, ABOVE = 4, (2.4, 2.7), 0.3
LOOKS: dict[StickKind, tuple[str, float]] = {
    "arm": (style.MEASURED, 3.0),
    "mass": (style.FITTED, 1.5),
    "strut": (style.NOISE, 2.0),
}


def information(forecast: Forecast) -> Figure:
    """Shares of the expected information: by configuration and frequency (left), by configuration and parameter."""
    names = forecast.configurations
    size = style.WIDE, max(1.5 + 0.3 * len(names), 3.2)
    figure, ((left, right),) = style.panels(
        1, 2, size, (0.95, 0.1, 0.62, 0.75), (0.2, 0.0), sharey=True, width_ratios=(1.15, 1)
    )
    edges = np.geomspace(forecast.freq_hz[0] / 1.01, forecast.freq_hz[-1] * 1.01, BANDS + 1)
    by_band = 100 * _in_bands(forecast.freq_hz, forecast.share.mean(axis=2), edges)
    left.pcolormesh(edges, np.arange(len(names) + 1) - 0.5, by_band, cmap="Blues", vmin=0)
    left.tick_params(labelsize=style.SMALL, length=0)
    style.set_log_frequency(left, forecast.freq_hz)
    style.label(left, x="frequency in Hz", title="share of all information")
    by_parameter = 100 * forecast.share.sum(axis=1)
    style.heat_map(
        right,
        by_parameter,
        Normalize(0, 100),
        lambda value: f"{value:.0f}" if value >= MIN_WRITTEN_PERCENT else "",
        size=6,
    )
    style.set_names(right.xaxis, forecast.parameters, rotation=90)
    style.set_names(left.yaxis, names)
    right.tick_params(labelleft=False)
    style.label(right, title="share of the information on a parameter in %")
    style.add_title(figure, "Expected information by configuration")
    return figure


def _in_bands(freq_hz: FloatArray, share: FloatArray, edges: FloatArray) -> FloatArray:
    """Shares (Q, F) summed within the bands (Q, BANDS), NaN where there is no line."""
    band = np.clip(np.searchsorted(edges, freq_hz) - 1, 0, len(edges) - 2)
    total = np.zeros((len(share), len(edges) - 1))
    np.add.at(total.T, band, share.T)
    total[:, np.bincount(band, minlength=len(edges) - 1) == 0] = np.nan
    return total


def configuration_sketches(robot: Robot, configurations: Sequence[Configuration], captions: Sequence[str]) -> Figure:
    """The robot as a stick figure in each configuration, all to one scale; a caption below each name."""
    angles = np.stack([configuration.angles for configuration in configurations])
    sketches = [stick_figure(robot, q) for q in link_angles(robot, angles)]
    up = int(np.argmax(np.abs(robot.gravity))) if any(robot.gravity) else 2
    upwards = -np.sign(robot.gravity[up]) or 1.0
    order = [(up + 1) % 3, (up + 2) % 3, up]
    points = np.stack([sketch.points for sketch in sketches])[:, :, order] * [1, 1, upwards]
    # All to one scale, the base in the middle.
    side = max(float(np.abs(points[:, :, :2]).max()), 0.5 * float(np.abs(points[:, :, 2]).max()), 1e-6)
    bottom, top = min(0.0, float(points[:, :, 2].min())), max(float(points[:, :, 2].max()), 1e-6)
    columns = min(MAX_COLUMNS, len(configurations))
    rows = -(-len(configurations) // columns)
    height = PANEL[1] * rows + ABOVE
    figure = Figure(figsize=(PANEL[0] * columns, height))
    for i, (configuration, caption) in enumerate(zip(configurations, captions, strict=True)):
        axes = figure.add_subplot(rows, columns, i + 1, projection="3d")
        for a, b, kind in sketches[i].links:
            color, width = LOOKS[kind]
            axes.plot(*points[i, [a, b]].T, color=color, lw=width, solid_capstyle="round")
            axes.plot(*points[i, [a, b], :2].T, [bottom, bottom], color=style.WEAK, lw=1)
        axes.plot(*points[i, list(sketches[i].joints)].T, ls="none", marker="o", ms=4, color=style.TRUTH)
        axes.set(xlim=(-side, side), ylim=(-side, side), zlim=(bottom, top))
        axes.set_box_aspect((2 * side, 2 * side, top - bottom), zoom=1.1)
        axes.tick_params(labelsize=5, pad=-3)
        axes.locator_params(nbins=3)
        axes.set_title(style.plain(f"{configuration.name}\n{caption}"), fontsize=style.SMALL, pad=-2)
    figure.subplots_adjust(left=0.02, right=0.98, top=1 - 0.65 / height, bottom=0.03, wspace=0.1, hspace=0.25)
    style.add_title(figure, "Configurations (m; orange: to a centre of mass, green: rods and struts)")
    return figure


def excitation(plan: Plan) -> Figure:
    """Amplitude of every line (left) and torque over one period (right) of the plan's first experiment, by input."""
    experiment = plan.experiments[0]
    torque, amplitude = plan.torque(experiment), np.abs(plan.R[0, 0, 0])
    t = np.arange(plan.period_samples) / plan.rate_hz
    n_u = len(plan.inputs)
    size, margins = (style.WIDE, 1.2 + 1.35 * n_u), (0.8, 0.29, 0.65, 0.5)
    figure, panels = style.panels(n_u, 2, size, margins, (0.14, 0.16), sharex="col")
    for j, ((spectrum, time), name) in enumerate(zip(panels, plan.inputs, strict=True)):
        spectrum.vlines(plan.freq_hz, 0, amplitude[:, j], color=style.MEASURED, lw=0.6)
        spectrum.plot(plan.freq_hz, amplitude[:, j], ls="none", marker="o", ms=2, color=style.MEASURED)
        spectrum.set_ylim(0, 1.15 * amplitude.max())
        time.plot(t, torque[:, j], color=style.MEASURED, lw=0.7)
        time.axhline(np.sqrt(np.mean(torque[:, j] ** 2)), color=style.FITTED, lw=0.8, ls="--")
        time.set_xlim(0, t[-1])
        style.label_row(time, name)
        for axes in (spectrum, time):
            style.lighten(axes)
    style.set_log_frequency(panels[0, 0], plan.freq_hz)
    style.label(panels[0, 0], title="amplitude of the lines in N·m")
    style.label(panels[0, 1], title="torque in N·m (dashed: rms)")
    style.label(panels[-1, 0], x="frequency in Hz")
    style.label(panels[-1, 1], x="time in s")
    style.add_title(figure, f"Excitation: {experiment.name}")
    return figure
