"""Errors of the model: by element, on left-out data, replayed or simulated in time, and of the torque by part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from elastid.base.arrays import FloatArray
from elastid.report.figures import style
from elastid.validation.comparison import Comparison
from elastid.validation.results import Agreement, Replay, Validation
from elastid.validation.twin import DRY, ELASTICITY, FRICTION, GRAVITY, INERTIA, RIGID_BODY, VISCOUS, TorqueBalance
from elastid.validation.twin_run import TwinRun, TwinSignal

# The quantities that have a map, in the order in which they stand.
MAPS = (
    ("rms_log_db", "magnitude error, dB rms"),
    ("phase_rms_deg", "phase error, degrees rms"),
    ("rms_sigma", "residual / its standard deviation, rms"),
)
# Inches: maps side by side fill at most MAX_WIDTH, else they stand one above the other; beside, between and above them.
MAX_WIDTH, MIN_WIDTH, BESIDE, BETWEEN, TITLE = 10.0, 4.5, 0.65, 0.4, 0.35
# Part of a period that is drawn enlarged beside the whole.
ENLARGED_SHARE = 0.1
# Of configurations; more than these are drawn alike.
MARKERS = "osD^v<>Ph*"


def model_errors(validation: Validation) -> Figure:
    """Heat maps (configurations down, elements across): magnitude in dB, phase in degrees, residual over sigma."""
    agreements = validation.configurations
    elements = list(dict.fromkeys(name for agreement in agreements for name in _elements(agreement)))
    maps = [(name, title) for name, title in MAPS if any(np.isfinite(getattr(a, name)).any() for a in agreements)]
    names = [f"{a.configuration}, left out" if a.left_out else a.configuration for a in agreements]
    figure, placed = _map_axes(names, elements, len(maps))
    for (name, title), (axes, bar, is_first, is_last) in zip(maps, placed, strict=True):
        values = np.full((len(names), len(elements)), np.nan)
        for row, agreement in zip(values, agreements, strict=True):
            row[[elements.index(element) for element in _elements(agreement)]] = getattr(agreement, name).ravel()
        largest = float(np.nanmax(values, initial=0.0))
        # Of residuals over their standard deviation, 1 is as light as 0: noise and no more.
        norm = Normalize(1.0, max(largest, 2.0)) if name == "rms_sigma" else Normalize(0.0, max(largest, 1e-9))
        image = style.heat_map(axes, values, norm, _two_digits, style.TINY)
        style.label(axes, title=title)
        figure.colorbar(image, cax=bar).ax.tick_params(labelsize=style.TINY, length=2)
        style.set_names(axes.yaxis, names if is_first else ())
        style.set_names(axes.xaxis, elements if is_last else (), rotation=90)
    style.add_title(figure, "Errors of the model by configuration and element")
    return figure


def _elements(agreement: Agreement) -> list[str]:
    """In the order of its arrays, row by row."""
    return [f"{source} → {output}" for output in agreement.outputs for source in agreement.inputs]


def _two_digits(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _map_axes(
    names: Sequence[str], elements: Sequence[str], count: int
) -> tuple[Figure, list[tuple[Axes, Axes, bool, bool]]]:
    """A figure, and for each map its axes, those of its colour bar, and whether it is first in its row, last down."""
    rows, columns = len(names), len(elements)
    left = 0.35 + 0.07 * max(map(len, names))
    below = 0.2 + 0.055 * max(map(len, elements))
    block_width = columns * float(np.clip(8.0 / columns, 0.2, 0.55))
    block_height = rows * float(np.clip(4.0 / rows, 0.17, 0.3))
    across = count if left + count * (block_width + BESIDE) < MAX_WIDTH else 1
    down = count // across
    width = max(left + across * (block_width + BESIDE), MIN_WIDTH)
    height = TITLE + down * (block_height + BETWEEN) + below
    figure = Figure(figsize=(width, height))
    placed = []
    for k in range(count):
        i, j = divmod(k, across)
        x, top = left + j * (block_width + BESIDE), 2 * TITLE + i * (block_height + BETWEEN)
        y, high = 1 - (top + block_height) / height, block_height / height
        axes = figure.add_axes((x / width, y, block_width / width, high))
        bar = figure.add_axes(((x + block_width + 0.06) / width, y, 0.09 / width, high))
        placed.append((axes, bar, j == 0, i == down - 1))
    return figure, placed


def replay_signals(replay: Replay) -> Figure:
    """Measured and replayed motion of every output and their difference: a whole period, and enlarged at the worst."""
    n_y = len(replay.outputs)
    size = style.WIDE, 1.15 + n_y * float(np.clip(6.0 / n_y, 1.1, 2.0))
    options = {"sharex": "col", "width_ratios": (1, 1.3)}
    figure, panels = style.panels(n_y, 2, size, (0.8, 0.4, 0.75, 0.5), (0.14, 0.35), **options)
    t = np.arange(len(replay.measured)) / replay.rate_hz
    error = replay.measured - replay.replayed
    worst = _worst_part(error / np.maximum(np.abs(replay.measured).max(axis=0), 1e-300))
    row = replay.records.index(replay.shown)
    for i, (whole, enlarged) in enumerate(panels):
        for axes, part in ((whole, slice(None)), (enlarged, worst)):
            for values, color, width, label in (
                (replay.measured, style.MEASURED, 1.3, "measured"),
                (replay.replayed, style.FITTED, 0.8, "model under the measured torque"),
                (error, style.RESIDUAL, 0.7, "measured − model"),
            ):
                # A whole period is too dense for two curves: it compares the difference with the motion.
                if axes is enlarged or values is not replay.replayed:
                    axes.plot(t[part], values[part, i], color=color, lw=width, label=label)
            style.lighten(axes)
            axes.margins(x=0)
        fit, reachable = replay.fit_percent[row, i], replay.reachable_percent[row, i]
        text = f"{replay.outputs[i]}: {fit:.1f} % explained"
        text += f" (a true model: {reachable:.1f} %)" if np.isfinite(reachable) else ""
        enlarged.set_title(style.plain(text), fontsize=style.NORMAL, loc="left", pad=3)
        style.label(whole, y=style.pretty_unit(replay.units[i]))
        whole.axvspan(t[worst][0], t[worst][-1], color=style.SHADE, zorder=0)
    style.label_figure(figure, "time in s" if replay.rate_is_known else "time in samples")
    unit, (low, high) = "Hz" if replay.rate_is_known else "of the sampling rate", replay.band_hz
    style.add_title(
        figure, f"{replay.shown}: {replay.quantity} from {low:.3g} to {high:.3g} {unit}, measured and replayed"
    )
    style.add_legend(figure, (panels[0, 1],))
    return figure


def _worst_part(error: FloatArray) -> slice:
    """A part of the period about the sample of the largest error (N, n_y) of any output."""
    n = len(error)
    length = max(2, round(ENLARGED_SHARE * n))
    worst = int(np.abs(error).max(axis=1).argmax())
    start = int(np.clip(worst - length // 2, 0, n - length))
    return slice(start, start + length)


def left_out_errors(comparison: Comparison) -> Figure:
    """Error over sigma by model, the best at the top: a mark for each configuration, a bar at their rms."""
    rows = [row for row in comparison.rows if row.misfit.size]
    left = 0.4 + 0.075 * max(len(row.name) for row in rows)
    figure, ((axes,),) = style.panels(1, 1, (left + 5.0, 1.25 + 0.28 * len(rows)), (left, 0.2, 0.75, 0.45))
    y = np.arange(len(rows))
    for i, configuration in enumerate(comparison.configurations):
        error = np.sqrt([row.misfit[i] for row in rows])
        color, marker = style.SERIES[i % len(style.SERIES)], MARKERS[i % len(MARKERS)]
        axes.plot(
            error, y, ls="none", marker=marker, ms=4.5, mfc="none", color=color, label=style.plain_label(configuration)
        )
    mean = [np.sqrt(row.mean_misfit) if np.isfinite(row.mean_misfit) else np.nan for row in rows]
    axes.plot(mean, y, ls="none", marker="|", ms=14, mew=2, color=style.TRUTH, label="root mean square")
    style.set_names(axes.yaxis, [row.name for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    style.label(axes, x="error of left-out responses / sigma")
    style.lighten(axes)
    style.add_title(figure, "Models on configurations that they were not fitted to")
    style.add_legend(figure, (axes,))
    return figure


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
    part = _torque_part(next(signal for signal in signals if signal.kind == "torque"))
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


def _torque_part(torque: TwinSignal) -> slice:
    """The samples about the largest error of the torque."""
    n = len(torque.measured)
    length = min(MOST_SAMPLES, max(2, round(SHOWN_SHARE * n)))
    worst = int(np.abs(torque.measured - torque.simulated).argmax())
    start = int(np.clip(worst - length // 2, 0, n - length))
    return slice(start, start + length)
