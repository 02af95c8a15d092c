"""The twin of a log: torque part by part and by octave, motion with and without friction, error by octave."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from elastid.report.figures import style
from elastid.validation.twin import DRY, ELASTICITY, FRICTION, GRAVITY, INERTIA, RIGID_BODY, VISCOUS, TorqueBalance
from elastid.validation.twin_run import TwinRun, TwinSignal

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


# Of a run, the part that is enlarged over time.
SHOWN_SHARE = 0.25

RUN_CAPTION = (
    "the model simulated forwards along the log. Left: measured and simulated over the quarter with the largest error "
    "of the torque; right: error by octave over what the log has there."
)


def twin_run_figure(run: TwinRun, motor: str) -> Figure:
    """The signals of one motor and of the joint behind it: over time, and by octave."""
    joint = f"joint {motor.removeprefix('motor ')}"
    signals = [signal for signal in run.signals if signal.place in (motor, joint)]
    size = style.WIDE, 1.2 + 2.1 * len(signals)
    options = {"width_ratios": (1.6, 1.0), "sharex": "col"}
    figure, panels = style.panels(len(signals), 2, size, (0.85, 0.25, 0.8, 0.6), (0.22, 0.28), **options)
    part = _worst_part(next(signal for signal in signals if signal.kind == "torque"))
    for signal, (over_time, by_octave) in zip(signals, panels, strict=True):
        _draw_time(over_time, signal, run.rate_hz, part)
        _draw_error_bands(by_octave, signal)
    style.label(panels[-1, 0], "time in s")
    style.label(panels[-1, 1], "upper end of the octave in Hz")
    driven = "its torque" if run.drive == "torque" else "its reference"
    style.add_title(figure, f"{run.log}, {motor}: simulated under {driven}")
    style.add_legend(figure, (panels[0, 0],))
    return figure


def _draw_time(axes: Axes, signal: TwinSignal, rate_hz: float, part: slice) -> None:
    t = np.arange(len(signal.measured)) / rate_hz
    curves = [(signal.measured, style.MEASURED, 1.5, "measured"), (signal.simulated, style.FITTED, 0.9, "simulated")]
    if len(signal.frictionless):
        curves.append((signal.frictionless, style.WEAK, 0.9, "simulated without friction"))
    for values, color, width, name in curves:
        axes.plot(t[part], values[part], color=color, lw=width, label=name)
    # A twin without friction may run away; the log decides what is seen.
    seen = np.concatenate([signal.measured[part], signal.simulated[part]])
    margin = 0.3 * max(float(np.ptp(seen)), 1e-12)
    axes.set_ylim(float(seen.min()) - margin, float(seen.max()) + margin)
    text = f"{signal.kind}, {signal.place}: error {100 * signal.error:.2g} %"
    axes.set_title(style.plain(text), fontsize=style.NORMAL, loc="left", pad=3)
    style.label(axes, y=style.pretty_unit(signal.unit))
    axes.margins(x=0.01)
    style.lighten(axes)


def _draw_error_bands(axes: Axes, signal: TwinSignal) -> None:
    x, names = np.arange(len(signal.bands)), [f"{band.high_hz:.2g}" for band in signal.bands]
    for offset, values, color in (
        (-0.2, [band.error for band in signal.bands], style.FITTED),
        (0.2, [band.error_without_friction for band in signal.bands], style.WEAK),
    ):
        axes.bar(x + offset, 100 * np.nan_to_num(values), 0.38, color=color)
    axes.set_yscale("log")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xticks(x, names)
    style.label(axes, y="error in %")
    style.lighten(axes)


def _worst_part(torque: TwinSignal) -> slice:
    """The samples about the largest error of the torque."""
    n = len(torque.measured)
    length = min(MOST_SAMPLES, max(2, round(SHOWN_SHARE * n)))
    worst = int(np.abs(torque.measured - torque.simulated).argmax())
    start = int(np.clip(worst - length // 2, 0, n - length))
    return slice(start, start + length)
