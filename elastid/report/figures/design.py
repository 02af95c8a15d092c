"""The plan of an experiment: information, configurations, excitation, and its use of the robot's limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.design.forecast import QUANTITIES, UNITS, Forecast, LimitUse
from elastid.experiment.plan.movement import Rehearsal
from elastid.experiment.plan.plan import Plan
from elastid.model.closed_posture import followed
from elastid.model.kinematics import StickKind, stick_figure
from elastid.record import Configuration
from elastid.report.figures import style
from elastid.robot import Robot

# Width and height of a stick figure in inches.
PANEL = (2.4, 2.7)
LOOKS: dict[StickKind, tuple[str, float]] = {
    "arm": (style.MEASURED, 3.0),
    "mass": (style.FITTED, 1.5),
    "strut": (style.NOISE, 2.0),
}


def information(forecast: Forecast) -> Figure:
    """Shares of the expected information: by configuration and frequency (left), by configuration and parameter."""
    names = forecast.configurations
    size = style.WIDE, max(1.5 + 0.3 * len(names), 3.2)
    options = {"sharey": True, "width_ratios": (1.15, 1)}
    figure, ((left, right),) = style.panels(1, 2, size, (0.95, 0.1, 0.62, 0.75), (0.2, 0.0), **options)
    edges = np.geomspace(forecast.freq_hz[0] / 1.01, forecast.freq_hz[-1] * 1.01, 61)
    by_band = 100 * _in_bands(forecast.freq_hz, forecast.share.mean(axis=2), edges)
    left.pcolormesh(edges, np.arange(len(names) + 1) - 0.5, by_band, cmap="Blues", vmin=0)
    left.tick_params(labelsize=style.SMALL, length=0)
    style.set_log_frequency(left, forecast.freq_hz)
    style.label(left, x="frequency in Hz", title="share of all information")
    by_parameter = 100 * forecast.share.sum(axis=1)
    style.heat_map(right, by_parameter, Normalize(0, 100), lambda value: f"{value:.0f}" if value >= 0.5 else "", 6)
    style.set_names(right.xaxis, forecast.parameters, rotation=90)
    style.set_names(left.yaxis, names)
    right.tick_params(labelleft=False)
    style.label(right, title="share of the information on a parameter in %")
    return style.finish(figure, "Expected information by configuration")


def _in_bands(freq_hz: FloatArray, share: FloatArray, edges: FloatArray) -> FloatArray:
    """Shares (Q, F) summed within the bands (Q, 60), NaN where there is no line."""
    band = np.clip(np.searchsorted(edges, freq_hz) - 1, 0, len(edges) - 2)
    total = np.zeros((len(share), len(edges) - 1))
    np.add.at(total.T, band, share.T)
    total[:, np.bincount(band, minlength=len(edges) - 1) == 0] = np.nan
    return total


def configuration_sketches(robot: Robot, configurations: Sequence[Configuration], captions: Sequence[str]) -> Figure:
    """The robot as a stick figure in each configuration, all to one scale; a caption below each name."""
    angles = np.stack([configuration.angles for configuration in configurations])
    sketches = [stick_figure(robot, q) for q in followed(robot, angles)]
    up = int(np.argmax(np.abs(robot.gravity))) if any(robot.gravity) else 2
    upwards = -np.sign(robot.gravity[up]) or 1.0
    order = [(up + 1) % 3, (up + 2) % 3, up]
    points = np.stack([sketch.points for sketch in sketches])[:, :, order] * [1, 1, upwards]
    # All to one scale, the base in the middle.
    side = max(float(np.abs(points[:, :, :2]).max()), 0.5 * float(np.abs(points[:, :, 2]).max()), 1e-6)
    bottom, top = min(0.0, float(points[:, :, 2].min())), max(float(points[:, :, 2].max()), 1e-6)
    columns = min(4, len(configurations))
    rows = -(-len(configurations) // columns)
    height = PANEL[1] * rows + 0.3
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
    return style.finish(figure, "Configurations (m; orange: to a centre of mass, green: rods and struts)")


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
    style.set_log_frequency(panels[0, 0], plan.freq_hz)
    style.label(panels[0, 0], title="amplitude of the lines in N·m")
    style.label(panels[0, 1], title="torque in N·m (dashed: rms)")
    style.label(panels[-1, 0], x="frequency in Hz")
    style.label(panels[-1, 1], x="time in s")
    return style.finish(figure, f"Excitation: {experiment.name}", panels.flat)


def limit_use(use: LimitUse) -> Figure:
    """Peaks in % of their limits: configurations (rows) by motors (columns), a panel for each quantity limited."""
    kinds = np.flatnonzero(np.isfinite(use.limit).any(axis=(0, 2)))
    motors = [name.removeprefix("motor ") for name in use.inputs]
    size = style.WIDE, 1.15 + max(0.28 * len(use.configurations), 0.8)
    figure, (across,) = style.panels(1, len(kinds), size, (1.15, 0.1, 0.6, 0.45), (0.06, 0.0))
    for axes, kind in zip(across, kinds, strict=True):
        percent = 100 * np.where(np.isfinite(use.limit[:, kind]), use.used[:, kind], np.nan)
        style.heat_map(axes, percent, Normalize(0, 130), lambda value: f"{value:.0f}")
        style.set_names(axes.xaxis, motors)
        style.set_names(axes.yaxis, use.configurations if axes is across[0] else ())
        style.label(axes, x="motor", title=f"{QUANTITIES[kind]} in % of its limit")
    return style.finish(figure, f"Peaks against limits ({use.margin:.0%} of each kept free)")


def nearest_run_signals(run: Rehearsal, use: LimitUse, plan: Plan | None) -> Figure:
    """Motors (rows) by torque, position about the configuration, velocity, acceleration: those with any limit."""
    q = use.configurations.index(run.experiment.configuration.name)
    limit, signals, t = use.limit[q], run.signals, run.time_s
    kinds = [kind for kind in range(len(signals)) if kind == 0 or np.isfinite(limit[kind]).any()]
    n_u = len(use.inputs)
    size, margins = (style.WIDE, 1.2 + 1.3 * n_u), (0.7, 0.33, 0.65, 0.5)
    figure, panels = style.panels(n_u, len(kinds), size, margins, (0.26, 0.16), sharex=True)
    for i, name in enumerate(use.inputs):
        for axes, kind in zip(panels[i], kinds, strict=True):
            if plan is not None:
                _shade_unmeasured(axes, t, plan)
            axes.plot(*_thinned(t, signals[kind, :, i]), color=style.MEASURED, lw=0.6)
            _draw_limit(axes, float(np.abs(signals[kind, :, i]).max()), float(limit[kind, i]), use.margin)
        style.label_row(panels[i, -1], name)
    for first, last, kind in zip(panels[0], panels[-1], kinds, strict=True):
        style.label(first, title=f"{QUANTITIES[kind]} in {style.pretty_unit(UNITS[kind])}")
        style.label(last, x="time in s")
        last.set_xlim(t[0], t[-1])
    title = f"The run nearest to a limit: {run.experiment.name} (position about the configuration)"
    return style.finish(figure, title, panels.flat)


def _shade_unmeasured(axes: Axes, t: FloatArray, plan: Plan) -> None:
    begin = plan.transient_periods * plan.period_samples / plan.rate_hz
    end = begin + plan.periods * plan.period_samples / plan.rate_hz
    for low, high in ((t[0], begin), (end, t[-1])):
        axes.axvspan(low, high, color=style.SHADE, lw=0)


def _draw_limit(axes: Axes, peak: float, limit: float, margin: float) -> None:
    """Limit and margin on either side, where the signal comes near them; the part of the limit it uses as a number."""
    if not np.isfinite(limit):
        return
    is_near = peak > 0.2 * limit
    reach = 1.12 * limit if is_near or peak == 0 else 1.35 * peak
    axes.set_ylim(-reach, reach)
    if is_near:
        for side in (-1, 1):
            axes.axhline(side * limit, color=style.FITTED, lw=0.9, ls="--")
            axes.axhspan(side * (1 - margin) * limit, side * limit, color=style.FITTED, alpha=0.15, lw=0)
    used = f"{peak / limit:.0%}" if is_near else f"{peak / limit:.1%} of {limit:.4g}"
    box = {"facecolor": "white", "alpha": 0.8, "lw": 0, "pad": 1.0}
    axes.text(0.985, 0.06, used, transform=axes.transAxes, ha="right", va="bottom", fontsize=style.SMALL, bbox=box)


def _thinned(t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and largest sample of each of 700 pieces, in turn."""
    step = -(-len(x) // 700)
    if step < 4:
        return t, x
    pieces = np.append(x, np.full(-len(x) % step, x[-1])).reshape(-1, step)
    return np.repeat(t[::step], 2), np.stack([pieces.min(axis=1), pieces.max(axis=1)], axis=1).ravel()
