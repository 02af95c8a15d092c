"""The torque of a log against its model: over time, part by part, and what is left by octave."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.report.figures import style
from elastid.validation.twin import DRY, ELASTICITY, FRICTION, GRAVITY, INERTIA, RIGID_BODY, VISCOUS, TorqueBalance

# Samples that are drawn.
MOST_SAMPLES = 3000
COLORS = {
    INERTIA: style.TOTAL,
    RIGID_BODY: style.TOTAL,
    GRAVITY: style.MEASURED,
    VISCOUS: style.NOISE,
    DRY: style.START,
    ELASTICITY: style.TRUTH,
}
TORQUE_CAPTION = (
    "torque of the log and of the model for the measured motion; the model's parts; by octave what the model leaves of "
    "the mean square, with friction and without, and the share of the torque's power that lies there."
)


def torque_balance_figure(found: TorqueBalance) -> Figure:
    """Torque measured and modelled; its parts; what is left by octave."""
    figure, panels = style.panels(3, 1, (style.WIDE, 7.4), (0.8, 0.25, 0.85, 0.55), (0.0, 0.4))
    whole, parts, left = panels[:, 0]
    step = max(1, len(found.measured) // MOST_SAMPLES)
    t = (np.arange(len(found.measured)) / found.rate_hz)[::step]
    without = found.measured - found.residual - found.part(FRICTION)
    for values, color, width, name in (
        (found.measured, style.MEASURED, 1.2, "measured"),
        (found.measured - found.residual, style.FITTED, 0.8, "model"),
        (without, style.WEAK, 0.8, "model without friction"),
        (found.residual, style.RESIDUAL, 0.6, "measured − model"),
    ):
        if name != "model without friction" or any(part in FRICTION for part in found.parts):
            whole.plot(t, values[::step], color=color, lw=width, label=name)
    for name, torque in zip(found.parts, found.torques, strict=True):
        parts.plot(t, torque[::step], color=COLORS[name], lw=0.9, label=name)
    _draw_bands(left, found)
    for axes in (whole, parts):
        axes.margins(x=0.01)
        style.label(axes, y=style.pretty_unit(found.unit))
    style.label(parts, "time in s" if found.rate_is_known else "time in samples")
    for axes in panels[:, 0]:
        style.lighten(axes)
    style.add_title(figure, f"{found.place}, {found.log}: {100 * found.left:.2g} % of the mean square is left")
    style.add_legend(figure, (whole,))
    for axes in (parts, left):
        axes.legend(fontsize=style.SMALL, frameon=False, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 0.98))
    return figure


def _draw_bands(axes: Axes, found: TorqueBalance) -> None:
    """Bars side by side for each octave, on a logarithmic axis."""
    x, names = np.arange(len(found.bands)), [f"{band.low_hz:.3g}–{band.high_hz:.3g}" for band in found.bands]
    for offset, values, color, name in (
        (-0.27, [band.left for band in found.bands], style.RESIDUAL, "left"),
        (0.0, [band.left_without_friction for band in found.bands], style.WEAK, "left without friction"),
        (0.27, [band.power for band in found.bands], style.MEASURED, "share of the torque's power"),
    ):
        axes.bar(x + offset, 100 * np.maximum(values, 1e-7), 0.25, color=color, label=name)
    axes.set_yscale("log")
    axes.set_xticks(x, names)
    style.label(axes, style.frequency_label(found.rate_is_known), "%")
