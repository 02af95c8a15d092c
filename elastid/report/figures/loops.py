"""Joint loops: sensitivity over postures with bands and measured lines, loops of each axis, steps on the twin."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.report.figures import style
from elastid.use.loops.assess import LoopState
from elastid.use.loops.result import Loops
from elastid.use.loops.sensitivity import LIMIT_DB

COLORS = (style.START, style.FITTED)


def loops_figure(loops: Loops) -> Figure:
    """Sensitivity, size and phase of the designed loops with 95 % of draws, and steps."""
    figure, axes = style.column(9.0, (1.1, 1.1, 0.9, 1.0), 0.3, sharex=False)
    peaks, sizes, phases, stepped = axes
    for state, color in zip(loops.states, COLORS[-len(loops.states) :], strict=True):
        _plot_sensitivity(peaks, state, color)
    for own in loops.measured:
        text = "measured" if own is loops.measured[0] else None
        peaks.plot(own.freq_hz, own.sensitivity_db, color=style.MEASURED, ms=2.5, label=text, **style.DOTS)
    peaks.axhline(LIMIT_DB, color=style.TRUTH, lw=0.8, ls="--")
    peaks.set_ylim(-30, max(10.0, *(float(state.sensitivity_db.max()) + 2 for state in loops.states)))
    style.label(peaks, y="sensitivity in dB")
    for i, joint in enumerate(loops.joints):
        color = style.SERIES[i % len(style.SERIES)]
        _plot_loop(sizes, phases, loops.designed, i, joint, color)
        if loops.steps is None:
            continue
        rows = loops.steps.response[:, i]
        stepped.fill_between(loops.steps.time_s, rows.min(axis=0), rows.max(axis=0), color=color, alpha=0.3, lw=0)
        stepped.plot(loops.steps.time_s, rows.mean(axis=0), color=color, lw=1.0)
    sizes.axhline(0, color=style.TRUTH, lw=0.8, ls="--")
    sizes.set_ylim(-40, 60)
    style.label(sizes, y="loop, others closed, in dB")
    phases.axhline(-180, color=style.TRUTH, lw=0.8, ls="--")
    phases.set_ylim(-360, 0)
    style.label(phases, x="frequency in Hz", y="phase in deg")
    stepped.axhline(1, color=style.TRUTH, lw=0.8, ls="--")
    style.label(stepped, x="time in s", y="angle over its step")
    lowest, highest = loops.designed.bandwidth_hz.min() / 10, loops.designed.freq_hz[-1]
    for panel in (peaks, sizes, phases):
        style.set_log_frequency(panel, np.geomspace(lowest, highest, 50))
        panel.set_xlim(lowest, highest)
    return style.finish(figure, f"{loops.name}: joint loops at {loops.rate_hz:g} Hz", axes, [peaks, sizes], 0.0)


def _plot_sensitivity(axes: Axes, state: LoopState, color: str) -> None:
    low, high = state.sensitivity_low.min(axis=0), state.sensitivity_high.max(axis=0)
    if np.isfinite(low).all():
        axes.fill_between(state.freq_hz, low, high, color=color, alpha=0.3, lw=0)
    for i, row in enumerate(state.sensitivity_db):
        axes.plot(state.freq_hz, row, color=color, lw=0.9, label=style.plain(state.name) if i == 0 else None)


def _plot_loop(sizes: Axes, phases: Axes, state: LoopState, i: int, joint: str, color: str) -> None:
    low, high = state.loop_low[i].min(axis=0), state.loop_high[i].max(axis=0)
    if np.isfinite(low).all():
        sizes.fill_between(state.freq_hz, low, high, color=color, alpha=0.3, lw=0)
    for q, row in enumerate(state.loop_db[i]):
        sizes.plot(state.freq_hz, row, color=color, lw=0.9, label=style.plain(f"axis {joint}") if q == 0 else None)
        turn = np.degrees(state.loop_phase[i, q]) % 360 - 360
        turn[1:][np.abs(np.diff(turn)) > 180] = np.nan
        phases.plot(state.freq_hz, turn, color=color, lw=0.9)
