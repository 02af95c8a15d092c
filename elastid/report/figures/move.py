"""A tuned move: error of the tool by command, with the band of draws, and torques against their limits."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from elastid.report.figures import style
from elastid.use.command.tune import TunedMove

COLORS = (style.WEAK, style.START, style.FITTED)


def move_figure(tuned: TunedMove) -> Figure:
    """Errors over time in mm, on a logarithmic scale, and below them the torque of each motor over its limit."""
    figure, axes = style.column(6.2, (1.3, 1.0), 0.12)
    error, torque = axes
    floor = 1e-4  # mm: below, a figure shows rounding
    for own, color in zip(tuned.outcomes, COLORS, strict=True):
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
    style.label(torque, x="time in s", y="torque over its limit")
    return style.finish(figure, f"{tuned.name}: a move of {tuned.duration:.4g} s", axes, axes, 0.0)
