"""Errors of the model: by element, on left-out data, replayed or simulated in time, and of the torque by part."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from elastid.base.arrays import FloatArray
from elastid.report.figures import style
from elastid.report.overview import elements_of
from elastid.validation.comparison import Comparison
from elastid.validation.results import Replay, Validation
from elastid.validation.twin import (
    DRY,
    ELASTICITY,
    FRICTION,
    GRAVITY,
    INERTIA,
    MIN_POWER_SHARE,
    RIGID_BODY,
    VISCOUS,
    TorqueBalance,
)
from elastid.validation.twin_run import TwinRun, TwinSignal

# The quantities that have a map, in the order in which they stand.
MAPS = (
    ("rms_log_db", "magnitude error, dB rms"),
    ("phase_rms_deg", "phase error, degrees rms"),
    ("rms_sigma", "residual / its standard deviation, rms"),
)
# Inches: maps side by side fill at most MAX_WIDTH, else they are one above the other; gaps, and room above.
MAX_WIDTH, MIN_WIDTH, GAP, SPACE, TITLE = 10.0, 4.5, 0.65, 0.4, 0.35
# Of configurations, in turn.
MARKERS = "osD^v<>Ph*"
# Samples of a torque or a run that are drawn.
MOST_SAMPLES = 3000
COLORS = {
    INERTIA: style.TOTAL, RIGID_BODY: style.TOTAL, GRAVITY: style.MEASURED, VISCOUS: style.NOISE, DRY: style.START,
    ELASTICITY: style.TRUTH,
}  # fmt: skip
TORQUE_CAPTION = (
    "torque of the log and of the model for the measured motion; the model's parts; by octave what the model leaves of "
    "the mean square, with friction and without, and the share of the torque's power that lies there."
)
RUN_CAPTION = (
    "the model simulated forwards along the log. Left: measured and simulated over the quarter with the largest error "
    "of the torque; right: error by octave over what the log has there."
)


def model_errors(validation: Validation) -> Figure:
    """Heat maps (configurations down, elements across): magnitude in dB, phase in degrees, residual over sigma."""
    agreements = validation.configurations
    elements = list(dict.fromkeys(name for agreement in agreements for name in elements_of(agreement)))
    maps = [(name, title) for name, title in MAPS if any(np.isfinite(getattr(a, name)).any() for a in agreements)]
    names = [f"{a.configuration}, left out" if a.left_out else a.configuration for a in agreements]
    figure, placed = _map_axes(names, elements, len(maps))
    for (name, title), (axes, bar, is_first, is_last) in zip(maps, placed, strict=True):
        values = np.full((len(names), len(elements)), np.nan)
        for row, agreement in zip(values, agreements, strict=True):
            row[[elements.index(element) for element in elements_of(agreement)]] = getattr(agreement, name).ravel()
        largest = float(np.nanmax(values, initial=0.0))
        # Of residuals over their standard deviation, 1 is as light as 0: noise and no more.
        norm = Normalize(1.0, max(largest, 2.0)) if name == "rms_sigma" else Normalize(0.0, max(largest, 1e-9))
        image = style.heat_map(
            axes, values, norm, lambda value: f"{value:.2g}" if value < 10 else f"{value:.0f}", style.TINY
        )
        style.label(axes, title=title)
        figure.colorbar(image, cax=bar).ax.tick_params(labelsize=style.TINY, length=2)
        style.set_names(axes.yaxis, names if is_first else ())
        style.set_names(axes.xaxis, elements if is_last else (), rotation=90)
    return style.finish(figure, "Errors of the model by configuration and element")


def _map_axes(
    names: Sequence[str], elements: Sequence[str], count: int
) -> tuple[Figure, list[tuple[Axes, Axes, bool, bool]]]:
    """A figure, and for each map its axes, those of its colour bar, and whether it is first in its row, last down."""
    rows, columns = len(names), len(elements)
    left = 0.35 + 0.07 * max(map(len, names))
    below = 0.2 + 0.055 * max(map(len, elements))
    block_width = columns * float(np.clip(8.0 / columns, 0.2, 0.55))
    block_height = rows * float(np.clip(4.0 / rows, 0.17, 0.3))
    across = count if left + count * (block_width + GAP) < MAX_WIDTH else 1
    down = count // across
    width = max(left + across * (block_width + GAP), MIN_WIDTH)
    height = TITLE + down * (block_height + SPACE) + below
    figure = Figure(figsize=(width, height))
    placed = []
    for k in range(count):
        i, j = divmod(k, across)
        x, top = left + j * (block_width + GAP), 2 * TITLE + i * (block_height + SPACE)
        y, high = 1 - (top + block_height) / height, block_height / height
        axes = figure.add_axes((x / width, y, block_width / width, high))
        bar = figure.add_axes(((x + block_width + 0.06) / width, y, 0.09 / width, high))
        placed.append((axes, bar, j == 0, i == down - 1))
    return figure, placed


def _worst_part(error: FloatArray, length: int) -> slice:
    """So many samples about that of the largest error (N,)."""
    start = int(np.clip(int(np.abs(error).argmax()) - length // 2, 0, len(error) - length))
    return slice(start, start + length)


def replay_signals(replay: Replay) -> Figure:
    """Measured and replayed motion of every output and their difference: a whole period, and enlarged at the worst."""
    n_y = len(replay.outputs)
    size = style.WIDE, 1.15 + n_y * float(np.clip(6.0 / n_y, 1.1, 2.0))
    options = {"sharex": "col", "width_ratios": (1, 1.3)}
    figure, panels = style.panels(n_y, 2, size, (0.8, 0.4, 0.75, 0.5), (0.14, 0.35), **options)
    t = np.arange(len(replay.measured)) / replay.rate_hz
    error = replay.measured - replay.replayed
    relative = np.abs(error / np.maximum(np.abs(replay.measured).max(axis=0), 1e-300)).max(axis=1)
    worst = _worst_part(relative, max(2, round(0.1 * len(error))))
    row = replay.records.index(replay.shown)
    for i, (period, enlarged) in enumerate(panels):
        measured = replay.measured[:, i], style.MEASURED, 1.3, "measured"
        replayed = replay.replayed[:, i], style.FITTED, 0.8, "model under the measured torque"
        rest = error[:, i], style.RESIDUAL, 0.7, "measured − model"
        # A period is too dense for two curves: it compares the difference with the motion.
        style.plot_curves(period, t, measured, rest)
        style.plot_curves(enlarged, t, measured, replayed, rest, part=worst)
        fit, reachable = replay.fit_percent[row, i], replay.reachable_percent[row, i]
        text = f"{replay.outputs[i]}: {fit:.1f} % explained"
        text += f" (a true model: {reachable:.1f} %)" if np.isfinite(reachable) else ""
        enlarged.set_title(style.plain(text), fontsize=style.NORMAL, loc="left", pad=3)
        style.label(period, y=style.pretty_unit(replay.units[i]))
        period.axvspan(t[worst][0], t[worst][-1], color=style.SHADE, zorder=0)
    style.label_figure(figure, "time in s" if replay.rate_is_known else "time in samples")
    unit, (low, high) = "Hz" if replay.rate_is_known else "of the sampling rate", replay.band_hz
    title = f"{replay.shown}: {replay.quantity} from {low:.3g} to {high:.3g} {unit}, measured and replayed"
    return style.finish(figure, title, panels.flat, (panels[0, 1],), 0.0)


def left_out_errors(comparison: Comparison) -> Figure:
    """Error over sigma by model, the best at the top: a mark for each configuration, a bar at their rms."""
    rows = [row for row in comparison.rows if row.misfit.size]
    left = 0.4 + 0.075 * max(len(row.name) for row in rows)
    figure, ((axes,),) = style.panels(1, 1, (left + 5.0, 1.25 + 0.28 * len(rows)), (left, 0.2, 0.75, 0.45))
    y = np.arange(len(rows))
    for i, configuration in enumerate(comparison.configurations):
        error = np.sqrt([row.misfit[i] for row in rows])
        color, marker = style.SERIES[i % len(style.SERIES)], MARKERS[i % len(MARKERS)]
        looks = {"ls": "none", "marker": marker, "ms": 4.5, "mfc": "none", "color": color}
        axes.plot(error, y, **looks, label=style.plain_label(configuration))
    mean = [np.sqrt(row.mean_misfit) if np.isfinite(row.mean_misfit) else np.nan for row in rows]
    axes.plot(mean, y, ls="none", marker="|", ms=14, mew=2, color=style.TRUTH, label="root mean square")
    style.set_names(axes.yaxis, [row.name for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    style.label(axes, x="error of left-out responses / sigma")
    return style.finish(figure, "Models on configurations that they were not fitted to", (axes,), (axes,))


def torque_balance_figure(balance: TorqueBalance) -> Figure:
    """Torque measured and modelled; its parts; the share left by octave."""
    figure, panels = style.column(7.4, (1, 1, 1), 0.4, sharex=False)
    total, parts, left = panels
    part = slice(None, None, max(1, len(balance.measured) // MOST_SAMPLES))
    t = np.arange(len(balance.measured)) / balance.rate_hz
    modelled = balance.measured - balance.residual
    curves: list[style.Curve] = [
        (balance.measured, style.MEASURED, 1.2, "measured"),
        (modelled, style.FITTED, 0.8, "model"),
        (balance.residual, style.RESIDUAL, 0.6, "measured − model"),
    ]
    if any(name in FRICTION for name in balance.parts):
        curves.insert(2, (modelled - balance.part(FRICTION), style.WEAK, 0.8, "model without friction"))
    style.plot_curves(total, t, *curves, part=part)
    for name, torque in zip(balance.parts, balance.torques, strict=True):
        parts.plot(t[part], torque[part], color=COLORS[name], lw=0.9, label=name)
    _draw_bands(left, balance)
    for axes in (total, parts):
        axes.margins(x=0.01)
        style.label(axes, y=style.pretty_unit(balance.unit))
    style.label(parts, "time in s" if balance.rate_is_known else "time in samples")
    title = f"{balance.place}, {balance.log}: {100 * balance.left:.2g} % of the mean square is left"
    style.finish(figure, title, panels, [total])
    for axes in (parts, left):
        axes.legend(fontsize=style.SMALL, frameon=False, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 0.98))
    return figure


def octaves_figure(balances: Sequence[TorqueBalance], own: Sequence[TorqueBalance] = ()) -> Figure:
    """Rms of the torque left over its own rms, by axis and octave; own: by a regression of these logs, in brackets."""
    edges = sorted({band.high_hz for balance in balances for band in balance.bands})
    figure, ((axes,),) = style.panels(1, 1, (style.WIDE, 1.3 + 0.3 * len(balances)), (1.8, 0.25, 0.5, 0.55), (0.0, 0.0))
    left = np.full((len(balances), len(edges)), np.nan)
    regressed = {(o.place, o.log, band.high_hz): math.sqrt(band.left) for o in own for band in o.bands}
    for i, balance in enumerate(balances):
        for band in (band for band in balance.bands if band.power >= MIN_POWER_SHARE):
            k = edges.index(band.high_hz)
            left[i, k] = math.sqrt(band.left)
            compared = regressed.get((balance.place, balance.log, band.high_hz))
            text = f"{100 * left[i, k]:.0f}" + ("" if compared is None else f" ({100 * compared:.0f})")
            axes.text(k, i, text, ha="center", va="center", fontsize=style.SMALL)
    axes.imshow(np.minimum(left, 1.0), cmap="Oranges", vmin=0.0, vmax=1.2, aspect="auto")
    axes.set_xticks(range(len(edges)), [f"{edge:.3g}" for edge in edges])
    style.set_names(axes.yaxis, [f"{balance.place}, {balance.log}" for balance in balances])
    known = all(balance.rate_is_known for balance in balances)
    style.label(axes, f"octave below {'Hz' if known else 'sampling rates'}")
    title = "Torque left, % of its rms" + (" (by a regression of these logs)" if own else "")
    return style.finish(figure, title)


def _draw_bands(axes: Axes, balance: TorqueBalance) -> None:
    bands = balance.bands
    x, names = np.arange(len(bands)), [f"{band.low_hz:.3g}–{band.high_hz:.3g}" for band in bands]
    for offset, values, color, name in (
        (-0.27, [band.left for band in bands], style.RESIDUAL, "left"),
        (0.0, [band.left_without_friction for band in bands], style.WEAK, "left without friction"),
        (0.27, [band.power for band in bands], style.MEASURED, "share of the torque's power"),
    ):
        axes.bar(x + offset, 100 * np.maximum(values, 1e-7), 0.25, color=color, label=name)
    axes.set_yscale("log")
    axes.set_xticks(x, names)
    style.label(axes, style.frequency_label(balance.rate_is_known), "%")


def twin_run_figure(run: TwinRun, motor: str) -> Figure:
    """The signals of one motor and of the joint behind it: over time, and by octave."""
    joint = f"joint {motor.removeprefix('motor ')}"
    signals = [signal for signal in run.signals if signal.place in (motor, joint)]
    size = style.WIDE, 1.2 + 2.1 * len(signals)
    options = {"width_ratios": (1.6, 1.0), "sharex": "col"}
    figure, panels = style.panels(len(signals), 2, size, (0.85, 0.25, 0.8, 0.6), (0.22, 0.28), **options)
    torque = next(signal for signal in signals if signal.kind == "torque")
    n = len(torque.measured)
    part = _worst_part(torque.measured - torque.simulated, min(MOST_SAMPLES, max(2, round(0.25 * n))))
    for signal, (over_time, by_octave) in zip(signals, panels, strict=True):
        _draw_time(over_time, signal, run.rate_hz, part)
        _draw_error_bands(by_octave, signal)
    style.label(panels[-1, 0], "time in s")
    style.label(panels[-1, 1], "upper end of the octave in Hz")
    driven = "its torque" if run.drive == "torque" else "its reference"
    return style.finish(figure, f"{run.log}, {motor}: simulated under {driven}", panels.flat, (panels[0, 0],))


def _draw_time(axes: Axes, signal: TwinSignal, rate_hz: float, part: slice) -> None:
    t = np.arange(len(signal.measured)) / rate_hz
    curves = [(signal.measured, style.MEASURED, 1.5, "measured"), (signal.simulated, style.FITTED, 0.9, "simulated")]
    if len(signal.frictionless):
        curves.append((signal.frictionless, style.WEAK, 0.9, "simulated without friction"))
    style.plot_curves(axes, t, *curves, part=part)
    # A twin without friction may run away; the axis is that of the log.
    shown = np.concatenate([signal.measured[part], signal.simulated[part]])
    margin = 0.3 * max(float(np.ptp(shown)), 1e-12)
    axes.set_ylim(float(shown.min()) - margin, float(shown.max()) + margin)
    text = f"{signal.kind}, {signal.place}: error {100 * signal.error:.2g} %"
    axes.set_title(style.plain(text), fontsize=style.NORMAL, loc="left", pad=3)
    style.label(axes, y=style.pretty_unit(signal.unit))
    axes.margins(x=0.01)


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
