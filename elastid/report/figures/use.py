"""Figures of use: joint loops, a tuned move, a map of the workspace."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from elastid.report.figures import style
from elastid.use.command.tune import TunedMove
from elastid.use.loops.assess import LoopState
from elastid.use.loops.result import Loops
from elastid.use.loops.sensitivity import LIMIT_DB
from elastid.use.map import WorkspaceMap

LOOP_COLORS = (style.START, style.FITTED)


def loops_figure(loops: Loops) -> Figure:
    """Largest sensitivity of the loops in all postures with 95 % of the draws, and as it was measured."""
    figure, (axes,) = style.column(3.6, (1.0,), 0.0)
    for state, color in zip(loops.states, LOOP_COLORS[-len(loops.states) :], strict=True):
        _plot_sensitivity(axes, state, color)
    for own in loops.measured:
        text = "measured" if own is loops.measured[0] else None
        axes.plot(own.freq_hz, own.sensitivity_db, color=style.MEASURED, ms=2.5, label=text, **style.DOTS)
    axes.axhline(LIMIT_DB, color=style.TRUTH, lw=0.8, ls="--")
    axes.set_ylim(-30, max(10.0, *(float(state.sensitivity_db.max()) + 2 for state in loops.states)))
    style.label(axes, x="frequency in Hz", y="sensitivity in dB")
    lowest, highest = loops.designed.bandwidth_hz.min() / 10, loops.designed.freq_hz[-1]
    style.set_log_frequency(axes, np.geomspace(lowest, highest, 50))
    axes.set_xlim(lowest, highest)
    return style.finish(figure, f"{loops.name}: joint loops at {loops.rate_hz:g} Hz", [axes], [axes], 0.0)


def _plot_sensitivity(axes: Axes, state: LoopState, color: str) -> None:
    low, high = state.sensitivity_low.min(axis=0), state.sensitivity_high.max(axis=0)
    if np.isfinite(low).all():
        axes.fill_between(state.freq_hz, low, high, color=color, alpha=0.3, lw=0)
    for i, row in enumerate(state.sensitivity_db):
        axes.plot(state.freq_hz, row, color=color, lw=0.9, label=style.plain(state.name) if i == 0 else None)


# Unit of a figure and factor, by the SI unit of a quantity.
SHOWN = {"m/N": ("µm/N", 1e6), "m": ("mm", 1e3), "Hz": ("Hz", 1.0)}


def workspace_figure(workspace: WorkspaceMap, quantity: str = "softest_compliance") -> Figure:
    """Positions of the frame, each coloured by the quantity there; the softest posture is marked."""
    own = workspace[quantity]
    unit, factor = SHOWN[own.unit]
    value = factor * np.where(np.isfinite(own.value), own.value, np.nan)
    figure, axes = style.panels(1, 2, (style.WIDE, 4.2), (0.7, 0.3, 0.6, 0.6), (0.25, 0.0))
    finite = value[np.isfinite(value)]
    if not finite.size:
        finite = np.array([0.0, 1.0])
    wide = finite.min() > 0 and finite.max() > 10 * finite.min()
    norm = (LogNorm if wide else Normalize)(finite.min(), finite.max())
    x, y, z = workspace.position.T
    soft = int(workspace.softest[0])
    # The softer ones on top, since they are what is looked for.
    order = np.argsort(np.where(np.isfinite(value), value, -np.inf), kind="stable")
    for ax, (a, b), names in zip(
        axes[0], ((x, y), (np.hypot(x, y), z)), (("x", "y"), ("√(x² + y²)", "z")), strict=True
    ):
        dots = ax.scatter(a[order], b[order], c=value[order], s=9, cmap="viridis", norm=norm, linewidths=0)
        ax.plot(a[soft], b[soft], "o", mfc="none", mec=style.TRUTH, ms=9, mew=1.6)
        ax.set_xlabel(f"{names[0]} in m", fontsize=style.NORMAL)
        ax.set_ylabel(f"{names[1]} in m", fontsize=style.NORMAL)
        ax.set_aspect("equal", adjustable="datalim")
        ax.grid(True, color=style.GRID, lw=0.4)
        ax.tick_params(labelsize=style.SMALL)
    bar = figure.colorbar(dots, ax=axes[0].tolist(), fraction=0.04, pad=0.02)
    bar.set_label(f"{own.text} in {unit}", fontsize=style.SMALL)
    bar.ax.tick_params(labelsize=style.SMALL)
    style.add_title(figure, f"{workspace.name}, {workspace.frame}: {own.text}")
    return figure


MOVE_COLORS = (style.WEAK, style.START, style.FITTED)


def move_figure(tuned: TunedMove) -> Figure:
    """Errors over time in mm, on a logarithmic scale, and below them the torque of each motor over its limit."""
    figure, axes = style.column(6.2, (1.3, 1.0), 0.12)
    error, torque = axes
    floor = 1e-4  # mm: below, a figure shows rounding
    for own, color in zip(tuned.outcomes, MOVE_COLORS, strict=True):
        error.plot(tuned.time_s, np.maximum(1e3 * own.error, floor), color=color, lw=1.2, label=style.plain(own.name))
        if own.low is not None and own.high is not None:
            low, high = (np.maximum(1e3 * end, floor) for end in (own.low, own.high))
            error.fill_between(tuned.time_s, low, high, color=color, alpha=0.3, lw=0, label="95 % of draws")
    error.set_yscale("log")
    style.label(error, y=f"error of {tuned.frame} in mm")
    limits = tuned.limits[3]
    for i, name in enumerate(tuned.joints):
        limit = limits[i] if np.isfinite(limits[i]) else np.abs(tuned.torque[:, i]).max()
        color = style.SERIES[i % len(style.SERIES)]
        torque.plot(tuned.time_s, tuned.torque[:, i] / limit, color=color, lw=1.0, label=style.plain(f"motor {name}"))
    for end in (-1, 1):
        torque.axhline(end, color=style.TRUTH, lw=0.8, ls="--")
    for panel in axes:
        panel.axvspan(0.0, tuned.duration, color=style.SHADE, zorder=0, lw=0)
    style.label(
        torque,
        x="time in s",
        y="torque over its limit" if np.isfinite(limits).all() else "torque over limit or largest",
    )
    return style.finish(figure, f"{tuned.name}: a move of {tuned.duration:.4g} s", axes, axes, 0.0)
