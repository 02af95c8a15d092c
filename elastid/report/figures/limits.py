"""What a plan asks of the robot: peaks against limits, and the signals of the run that comes closest to one."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.design.limits import QUANTITIES, UNITS, LimitUse
from elastid.experiment.plan.plan import Plan
from elastid.experiment.plan.rehearsal import Rehearsal
from elastid.report.figures import style

# A signal is drawn as the least and the largest sample of so many pieces of the run.
PIECES = 700
# Part of a limit that a signal must use for the axis to reach the limit.
NEAR = 0.2
# Cells of peaks that hold a number.
NUMBERED = 400


def peaks_against_limits(peaks: LimitUse) -> Figure:
    """Peaks in % of their limits: configurations (rows) by motors (columns), a panel for each quantity limited."""
    kinds = np.flatnonzero(np.isfinite(peaks.limit).any(axis=(0, 2)))
    names, motors = peaks.configurations, [style.plain(name.removeprefix("motor ")) for name in peaks.inputs]
    height = 1.15 + max(0.28 * len(names), 0.8)
    figure = Figure(figsize=(9.5, height))
    across = figure.subplots(1, len(kinds), squeeze=False)[0]
    figure.subplots_adjust(left=0.12, right=0.99, top=1 - 0.6 / height, bottom=0.45 / height, wspace=0.06)
    for axes, kind in zip(across, kinds, strict=True):
        used = 100 * np.where(np.isfinite(peaks.limit[:, kind]), peaks.used[:, kind], np.nan)
        axes.imshow(used, cmap="Blues", vmin=0, vmax=130, aspect="auto")
        axes.set_title(f"{QUANTITIES[kind]} in % of its limit", fontsize=style.NORMAL)
        axes.set_xticks(range(len(motors)), motors)
        axes.set_xlabel("motor", fontsize=style.NORMAL)
        axes.set_yticks(range(len(names)), [style.plain(name) for name in names] if axes is across[0] else [])
        axes.tick_params(labelsize=style.SMALL, length=2)
        if used.size * len(kinds) <= NUMBERED:
            _numbers(axes, used)
    style.titled(figure, f"Peaks against limits ({peaks.margin:.0%} of each kept free)")
    return figure


def _numbers(axes: Axes, used: FloatArray) -> None:
    for (row, column), value in np.ndenumerate(used):
        if np.isfinite(value):
            color = "white" if value > 70 else "black"
            axes.text(column, row, f"{value:.0f}", ha="center", va="center", fontsize=style.SMALL, color=color)


def time_signals(run: Rehearsal, peaks: LimitUse, plan: Plan | None) -> Figure:
    """Motors (rows) by torque, position about the configuration, velocity, acceleration: those with any limit."""
    q = peaks.configurations.index(run.experiment.configuration.name)
    limit, signals, t = peaks.limit[q], run.signals, run.time_s
    kinds = [kind for kind in range(len(signals)) if kind == 0 or np.isfinite(limit[kind]).any()]
    n_u = len(peaks.inputs)
    height = 1.2 + 1.3 * n_u
    figure = Figure(figsize=(9.5, height))
    grid = {"left": 0.075, "right": 0.965, "top": 1 - 0.65 / height, "bottom": 0.5 / height}
    panels = figure.subplots(
        n_u, len(kinds), sharex=True, squeeze=False, gridspec_kw=grid | {"hspace": 0.16, "wspace": 0.26}
    )
    for i, name in enumerate(peaks.inputs):
        for axes, kind in zip(panels[i], kinds, strict=True):
            if plan is not None:
                _aside(axes, t, plan)
            axes.plot(*_thinned(t, signals[kind, :, i]), color=style.MEASURED, lw=0.6)
            _limited(axes, float(np.abs(signals[kind, :, i]).max()), float(limit[kind, i]), peaks.margin)
            style.light(axes)
        panels[i, -1].annotate(
            style.plain(name), (1.02, 0.5), xycoords="axes fraction", rotation=270, va="center", fontsize=style.NORMAL
        )
    for axes, last, kind in zip(panels[0], panels[-1], kinds, strict=True):
        axes.set_title(f"{QUANTITIES[kind]} in {style.pretty_unit(UNITS[kind])}", fontsize=style.NORMAL)
        last.set_xlabel("time in s", fontsize=style.NORMAL)
        last.set_xlim(t[0], t[-1])
    style.titled(figure, f"The run nearest to a limit: {run.experiment.name} (position about the configuration)")
    return figure


def _aside(axes: Axes, t: FloatArray, plan: Plan) -> None:
    """What is run but not measured: hold, ramp and transient periods before, ramp and hold after."""
    begin = plan.transient_periods * plan.period_samples / plan.rate_hz
    end = begin + plan.periods * plan.period_samples / plan.rate_hz
    for low, high in ((t[0], begin), (end, t[-1])):
        axes.axvspan(low, high, color="#F0F0F0", lw=0)


def _limited(axes: Axes, peak: float, limit: float, margin: float) -> None:
    """Limit and margin on either side, where the signal comes near them; what part of the limit it uses in words."""
    if not np.isfinite(limit):
        return
    is_near = peak > NEAR * limit
    reach = 1.12 * limit if is_near else 1.35 * peak
    axes.set_ylim(-reach, reach)
    if is_near:
        for side in (-1, 1):
            axes.axhline(side * limit, color=style.FITTED, lw=0.9, ls="--")
            axes.axhspan(side * (1 - margin) * limit, side * limit, color=style.FITTED, alpha=0.15, lw=0)
    word = f"{peak / limit:.0%}" if is_near else f"{peak / limit:.1%} of {limit:.4g}"
    box = {"facecolor": "white", "alpha": 0.8, "lw": 0, "pad": 1.0}
    axes.text(0.985, 0.06, word, transform=axes.transAxes, ha="right", va="bottom", fontsize=style.SMALL, bbox=box)


def _thinned(t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and largest sample of each piece, in turn."""
    step = -(-len(x) // PIECES)
    if step < 4:
        return t, x
    pieces = np.append(x, np.full(-len(x) % step, x[-1])).reshape(-1, step)
    return np.repeat(t[::step], 2), np.stack([pieces.min(axis=1), pieces.max(axis=1)], axis=1).ravel()


def excitation(plan: Plan) -> Figure:
    """Amplitude of every line (left) and torque over one period (right) of the plan's first experiment, by input."""
    experiment = plan.experiments[0]
    torque = plan.torque(experiment)
    amplitude = np.abs(plan.R[0, 0, 0])
    t = np.arange(plan.period_samples) / plan.rate_hz
    n_u = len(plan.inputs)
    height = 1.2 + 1.35 * n_u
    grid = {"left": 0.085, "right": 0.97, "top": 1 - 0.65 / height, "bottom": 0.5 / height, "wspace": 0.14}
    figure = Figure(figsize=(9.5, height))
    panels = figure.subplots(n_u, 2, sharex="col", squeeze=False, gridspec_kw=grid | {"hspace": 0.16})
    for j, name in enumerate(plan.inputs):
        spectrum, time = panels[j]
        spectrum.vlines(plan.freq_hz, 0, amplitude[:, j], color=style.MEASURED, lw=0.6)
        spectrum.plot(plan.freq_hz, amplitude[:, j], ls="none", marker="o", ms=2, color=style.MEASURED)
        spectrum.set_ylim(0, 1.15 * amplitude.max())
        time.plot(t, torque[:, j], color=style.MEASURED, lw=0.7)
        time.axhline(np.sqrt(np.mean(torque[:, j] ** 2)), color=style.FITTED, lw=0.8, ls="--", label="rms")
        time.annotate(
            style.plain(name), (1.012, 0.5), xycoords="axes fraction", rotation=270, va="center", fontsize=style.NORMAL
        )
        for axes in (spectrum, time):
            style.light(axes)
    style.log_frequency(panels[0, 0], plan.freq_hz)
    panels[0, 0].set_title("amplitude of the lines in N·m", fontsize=style.NORMAL)
    panels[0, 1].set_title("torque in N·m (dashed: rms)", fontsize=style.NORMAL)
    panels[-1, 0].set_xlabel("frequency in Hz", fontsize=style.NORMAL)
    panels[-1, 1].set_xlabel("time in s", fontsize=style.NORMAL)
    panels[-1, 1].set_xlim(0, t[-1])
    style.titled(figure, f"Excitation: {experiment.name}")
    return figure
