"""Figures of the commands map, tune and loops."""

import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.report.figures import style
from elastid.report.figures.style import Curve, Panel
from elastid.use.closed_loops import LIMIT_DB
from elastid.use.loops import Loops
from elastid.use.map import WorkspaceMap
from elastid.use.tune import TunedMove

# Unit and factor of a quantity in a figure, by its SI unit.
DISPLAY_UNITS = {"m/N": ("µm/N", 1e6), "m": ("mm", 1e3), "Hz": ("Hz", 1.0)}


def loops_figure(loops: Loops) -> Figure:
    """Draw the largest sensitivity of the loops in all postures."""
    curves = [
        Curve(freq_hz, row, state.name, color)
        for state, color in zip(loops.states, (style.START, style.FITTED)[-len(loops.states) :], strict=True)
        for freq_hz, row in zip(state.freq_hz, state.sensitivity_db, strict=True)
    ]
    lines = np.array([loops.designed.bandwidth_hz.min() / 10, loops.designed.freq_hz.max()])
    panel = Panel(
        curves, "frequency in Hz", "sensitivity in dB", marks=(LIMIT_DB,), frequency=lines, y_ends=(-30, None)
    )
    return style.matrix(f"{loops.name}: joint loops at {loops.rate_hz:g} Hz", [[panel]])


def workspace_figure(workspace: WorkspaceMap, quantity: str = "softest_compliance") -> Figure:
    """Draw positions of the frame, coloured by a quantity, with a mark at the softest posture."""
    workspace = workspace.sample
    values, (x, y, z), soft = workspace[quantity], workspace.position.T, int(workspace.softest[0])
    unit, factor = DISPLAY_UNITS[values.unit]
    value = factor * np.where(np.isfinite(values.value), values.value, np.nan)
    finite = value[np.isfinite(value)] if np.isfinite(value).any() else np.array([0.0, 1.0])
    wide = finite.min() > 0 and finite.max() > 10 * finite.min()
    norm = (LogNorm if wide else Normalize)(finite.min(), finite.max())
    mark = {"ms": 9, "mfc": "none", "mew": 1.6}
    panels = [
        Panel([Curve(a[[soft]], b[[soft]], color=style.TRUTH, dots=True, looks=mark)], f"{across} in m", f"{up} in m")
        for a, b, across, up in ((x, y, "x", "y"), (np.hypot(x, y), z, "√(x² + y²)", "z"))
    ]
    figure = style.matrix(f"{workspace.name}, {workspace.frame}: {values.text}", [panels], [3.0])
    # Larger values are drawn last, on top.
    order = np.argsort(np.where(np.isfinite(value), value, -np.inf), kind="stable")
    sides = [*figure.axes]
    for axes, (a, b) in zip(sides, ((x, y), (np.hypot(x, y), z)), strict=True):
        dots = axes.scatter(a[order], b[order], c=value[order], s=9, cmap="viridis", norm=norm)
        axes.set_aspect("equal", adjustable="datalim")
    colorbar = figure.colorbar(dots, ax=sides)
    colorbar.set_label(f"{values.text} in {unit}", fontsize=style.SMALL)
    colorbar.ax.tick_params(labelsize=style.SMALL)
    return figure


def move_figure(tuned: TunedMove) -> Figure:
    """Draw path errors over time in mm (logarithmic), and the torque of each motor relative to its limit."""
    t, errors, torques = tuned.time_s, [], []
    for outcome, color in zip(tuned.outcomes, (style.WEAK, style.START, style.FITTED), strict=True):
        band = None if outcome.low is None or outcome.high is None else (_in_mm(outcome.low), _in_mm(outcome.high))
        errors.append(Curve(t, _in_mm(outcome.error), outcome.name, color, band=band, band_label="95 % of draws"))
    limits = tuned.limits[3]
    for i, name in enumerate(tuned.joints):
        limit = limits[i] if np.isfinite(limits[i]) else np.abs(tuned.torque[:, i]).max()
        color = style.SERIES[i % len(style.SERIES)]
        torques.append(Curve(t, tuned.torque[:, i] / limit, f"motor {name}", color))
    label = "torque over its limit" if np.isfinite(limits).all() else "torque over limit or largest"
    span, title = (0.0, tuned.duration), f"{tuned.name}: a move of {tuned.duration:.4g} s"
    rows = [
        [Panel(errors, y=f"error of {tuned.frame} in mm", scale="log", span=span)],
        [Panel(torques, "time in s", label, marks=(-1, 1), span=span)],
    ]
    return style.matrix(title, rows, sharex=True)


def _in_mm(error: FloatArray) -> FloatArray:
    """Convert an error from m to mm; smaller values than 1e-4 mm are rounding errors."""
    return np.maximum(1e3 * error, 1e-4)
