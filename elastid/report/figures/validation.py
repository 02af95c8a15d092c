"""Errors of the model: by configuration and element, of a record replayed in time, and of models on left-out data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.report.figures import style
from elastid.validation.comparison import Comparison
from elastid.validation.results import Agreement, Replay, Validation

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
