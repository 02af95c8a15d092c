"""The twin along a log: motion, torque and link motion over time, with friction and without; error by octave."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from elastid.report.figures import style
from elastid.validation.twin_run import TwinRun, TwinSignal

# Of a run, the part that is enlarged over time.
SHOWN_SHARE = 0.25
MOST_SAMPLES = 3000
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
        _draw_bands(by_octave, signal)
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


def _draw_bands(axes: Axes, signal: TwinSignal) -> None:
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
