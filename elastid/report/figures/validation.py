"""Where the model fails: errors by configuration and element, and a record beside its replay in time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.report.figures import style
from elastid.validation.agreement import Agreement, Validation
from elastid.validation.compare import Comparison
from elastid.validation.replay import Replay

# The part of a period that is drawn large beside all of it.
CLOSE = 0.1
# Maps stand side by side up to this width, in inches, else one above the other.
WIDEST = 10.0
# Cells have numbers in them up to so many.
NUMBERED = 400


def errors(validation: Validation) -> Figure:
    """Heat maps (configurations down, elements across): magnitude in dB, phase in degrees, residual over sigma."""
    agreements = validation.configurations
    elements = list(dict.fromkeys(name for agreement in agreements for name in _elements(agreement)))
    quantities = (
        ("rms_log_db", "magnitude error, dB rms"),
        ("phase_rms_deg", "phase error, degrees rms"),
        ("rms_sigma", "residual / its standard deviation, rms"),
    )
    shown = [
        (name, title) for name, title in quantities if any(np.isfinite(getattr(a, name)).any() for a in agreements)
    ]
    rows, columns = len(agreements), len(elements)
    names = 0.35 + 0.07 * max(len(_named(a)) for a in agreements)
    below = 0.2 + 0.055 * max(map(len, elements))
    cell_width, cell_height = float(np.clip(8.0 / columns, 0.2, 0.55)), float(np.clip(4.0 / rows, 0.17, 0.3))
    across = len(shown) if names + len(shown) * (columns * cell_width + 0.65) < WIDEST else 1
    down = len(shown) // across
    block_width, block_height = columns * cell_width, rows * cell_height
    width = names + across * (block_width + 0.65)
    height = 0.35 + down * (block_height + 0.4) + below
    figure = Figure(figsize=(max(width, 4.5), height))
    width = figure.get_figwidth()
    for k, (name, title) in enumerate(shown):
        i, j = divmod(k, across)
        left, top = names + j * (block_width + 0.65), 0.7 + i * (block_height + 0.4)
        box = (left / width, 1 - (top + block_height) / height, block_width / width, block_height / height)
        axes = figure.add_axes(box)
        bar = figure.add_axes((box[0] + box[2] + 0.06 / width, box[1], 0.09 / width, box[3]))
        values = np.full((rows, columns), np.nan)
        for row, agreement in zip(values, agreements, strict=True):
            row[[elements.index(element) for element in _elements(agreement)]] = getattr(agreement, name).ravel()
        _heat(axes, bar, values, title, name == "rms_sigma")
        axes.set_yticks(range(rows), [style.plain(_named(a)) for a in agreements] if j == 0 else [])
        axes.set_xticks(range(columns), [style.plain(e) for e in elements] if i == down - 1 else [], rotation=90)
        axes.tick_params(labelsize=style.SMALL, length=0)
    style.titled(figure, "Errors of the model by configuration and element")
    return figure


def _elements(agreement: Agreement) -> list[str]:
    """In the order of its arrays, row by row."""
    return [f"{source} → {output}" for output in agreement.outputs for source in agreement.inputs]


def _named(agreement: Agreement) -> str:
    return f"{agreement.configuration}, left out" if agreement.left_out else agreement.configuration


def _heat(axes: Axes, bar: Axes, values: FloatArray, title: str, of_noise: bool) -> None:
    """One map; of residuals over their standard deviation, 1 is as light as 0: noise and no more."""
    high = float(np.nanmax(values, initial=0.0))
    norm = Normalize(1.0, max(high, 2.0)) if of_noise else Normalize(0.0, max(high, 1e-9))
    axes.set_facecolor("#EEEEEE")
    image = axes.imshow(values, cmap="Blues", norm=norm, interpolation="nearest", aspect="auto")
    axes.set_title(title, fontsize=style.NORMAL)
    if values.size <= NUMBERED:
        for (row, column), value in np.ndenumerate(values):
            if np.isfinite(value):
                color = "white" if norm(value) > 0.6 else "black"
                text = f"{value:.2g}" if value < 10 else f"{value:.0f}"
                axes.text(column, row, text, ha="center", va="center", fontsize=5.5, color=color)
    axes.figure.colorbar(image, cax=bar).ax.tick_params(labelsize=5.5, length=2)


def replayed(replay: Replay, title: str) -> Figure:
    """Measured and replayed motion of every output and their difference: one period, and close up where it is worst."""
    n_y = len(replay.outputs)
    panel = float(np.clip(6.0 / n_y, 1.1, 2.0))
    width, height = 9.5, 1.15 + n_y * panel
    figure = Figure(figsize=(width, height))
    grid = {"left": 0.085, "right": 0.96, "top": 1 - 0.75 / height, "bottom": 0.5 / height}
    panels = figure.subplots(
        n_y,
        2,
        sharex="col",
        squeeze=False,
        gridspec_kw=grid | {"wspace": 0.14, "hspace": 0.35, "width_ratios": (1, 1.3)},
    )
    t = np.arange(len(replay.measured)) / replay.rate_hz
    error = replay.measured - replay.replayed
    close = _worst_part(error / np.maximum(np.abs(replay.measured).max(axis=0), 1e-300))
    row = replay.records.index(replay.shown)
    for i, output in enumerate(replay.outputs):
        for axes, part in zip(panels[i], (slice(None), close), strict=True):
            for values, color, width_, label in (
                (replay.measured, style.MEASURED, 1.3, "measured"),
                (replay.replayed, style.FITTED, 0.8, "model under the measured torque"),
                (error, style.RESIDUAL, 0.7, "measured − model"),
            ):
                # All of a period is too dense for two curves: it shows how large the difference is beside the motion.
                if axes is panels[i, 1] or values is not replay.replayed:
                    axes.plot(t[part], values[part, i], color=color, lw=width_, label=label)
            style.light(axes)
            axes.margins(x=0)
        fit, reachable = replay.fit_percent[row, i], replay.reachable_percent[row, i]
        words = f"{output}: {fit:.1f} % explained" + (
            f" ({reachable:.1f} % were it only for noise)" if reachable == reachable else ""
        )
        panels[i, 1].set_title(style.plain(words), fontsize=style.NORMAL, loc="left", pad=3)
        panels[i, 0].set_ylabel(style.pretty_unit(replay.units[i]), fontsize=style.NORMAL)
        panels[i, 0].axvspan(t[close][0], t[close][-1], color="#EEEEEE", zorder=0)
    label = "time in s" if replay.rate_is_known else "time in samples"
    figure.supxlabel(label, fontsize=style.NORMAL, y=0.09 / height)
    style.titled(figure, title)
    style.legend_above(figure, (panels[0, 1],))
    return figure


def replay_title(replay: Replay) -> str:
    """What is compared: quantity, band, record."""
    unit = "Hz" if replay.rate_is_known else "of the sampling rate"
    low, high = replay.band_hz
    return f"{replay.shown}: {replay.quantity} from {low:.3g} to {high:.3g} {unit}, measured and replayed"


def _worst_part(error: FloatArray) -> slice:
    """A part of the period about the sample where an output is furthest off."""
    n = len(error)
    length = max(2, round(CLOSE * n))
    worst = int(np.abs(error).max(axis=1).argmax())
    start = int(np.clip(worst - length // 2, 0, n - length))
    return slice(start, start + length)


# More configurations than colours are drawn alike.
_MARKERS = "osD^v<>Ph*"


def left_out_errors(comparison: Comparison) -> Figure:
    """Error over sigma by model, the best at the top: a mark for each configuration, a bar at their rms."""
    rows = [row for row in comparison.rows if row.misfit.size]
    left = 0.4 + 0.075 * max(len(row.name) for row in rows)
    height = 1.25 + 0.28 * len(rows)
    figure = Figure(figsize=(left + 5.0, height))
    box = {"left": left / (left + 5.0), "right": 0.97, "top": 1 - 0.75 / height, "bottom": 0.45 / height}
    axes = figure.subplots(gridspec_kw=box)
    y = np.arange(len(rows))
    for i, configuration in enumerate(comparison.configurations):
        error = np.sqrt([row.misfit[i] for row in rows])
        color, marker = style.SERIES[i % len(style.SERIES)], _MARKERS[i % len(_MARKERS)]
        axes.plot(error, y, ls="none", marker=marker, ms=4.5, mfc="none", color=color, label=style.plain(configuration))
    mean = [np.sqrt(row.mean_misfit) if np.isfinite(row.mean_misfit) else np.nan for row in rows]
    axes.plot(mean, y, ls="none", marker="|", ms=14, mew=2, color=style.TRUTH, label="root mean square")
    axes.set_yticks(y, [style.plain(row.name) for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlabel("error of left-out responses / sigma", fontsize=style.NORMAL)
    style.light(axes)
    style.titled(figure, "Models on configurations that they were not fitted to")
    style.legend_above(figure, (axes,))
    return figure
