"""A plan against the robot's limits: peaks in % of each, and the signals of the run that comes closest to one."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.design.limit_use import QUANTITIES, UNITS, LimitUse
from elastid.experiment.plan.plan import Plan
from elastid.experiment.plan.rehearsal import Rehearsal
from elastid.report.figures import style

# A signal is drawn as the least and the largest sample of so many pieces of the run.
PIECES = 700
# Part of a limit that a signal must use for the axis to reach the limit.
MIN_USE_SHOWN = 0.2


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
    style.add_title(figure, f"Peaks against limits ({use.margin:.0%} of each kept free)")
    return figure


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
            style.lighten(axes)
        style.label_row(panels[i, -1], name)
    for first, last, kind in zip(panels[0], panels[-1], kinds, strict=True):
        style.label(first, title=f"{QUANTITIES[kind]} in {style.pretty_unit(UNITS[kind])}")
        style.label(last, x="time in s")
        last.set_xlim(t[0], t[-1])
    style.add_title(figure, f"The run nearest to a limit: {run.experiment.name} (position about the configuration)")
    return figure


def _shade_unmeasured(axes: Axes, t: FloatArray, plan: Plan) -> None:
    """Shades hold, ramp and transient periods before the measured ones, ramp and hold after them."""
    begin = plan.transient_periods * plan.period_samples / plan.rate_hz
    end = begin + plan.periods * plan.period_samples / plan.rate_hz
    for low, high in ((t[0], begin), (end, t[-1])):
        axes.axvspan(low, high, color=style.SHADE, lw=0)


def _draw_limit(axes: Axes, peak: float, limit: float, margin: float) -> None:
    """Limit and margin on either side, where the signal comes near them; the part of the limit it uses as a number."""
    if not np.isfinite(limit):
        return
    is_near = peak > MIN_USE_SHOWN * limit
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
    """Least and largest sample of each piece, in turn."""
    step = -(-len(x) // PIECES)
    if step < 4:
        return t, x
    pieces = np.append(x, np.full(-len(x) % step, x[-1])).reshape(-1, step)
    return np.repeat(t[::step], 2), np.stack([pieces.min(axis=1), pieces.max(axis=1)], axis=1).ravel()
