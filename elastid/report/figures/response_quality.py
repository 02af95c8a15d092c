"""How well a configuration was measured: its outputs with noise and nonlinearities, coherence, singular values."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.report.figures import style
from elastid.response import FrequencyResponse, Quality


def levels(response: FrequencyResponse, quality: Quality, title: str) -> Figure:
    """RMS amplitude in dB of every output: excited lines, nonlinearities of even and odd order, stochastic, noise.

    Levels of an experiment's mean over periods; the detection lines with their noise taken off in power.
    """
    n_y = len(response.outputs)
    columns = min(n_y, 3)
    rows = -(-n_y // columns)
    figure, panels = _panels(rows, columns, 2.3)
    for i, output in enumerate(response.outputs):
        _levels_of(panels[i // columns, i % columns], response, quality, i)
        panels[i // columns, i % columns].set_title(
            style.plain(f"{response.quantity} at {output}"), fontsize=style.NORMAL
        )
    for spare in range(n_y, rows * columns):
        panels[spare // columns, spare % columns].set_axis_off()
    _finished(figure, panels[0, 0], response, title)
    unit = style.pretty_unit(response.output_unit)
    figure.supylabel(f"RMS amplitude in dB re 1 {unit}", fontsize=style.NORMAL, x=0.015)
    style.legend_above(figure, figure.axes, markerscale=2.0)
    return figure


def coherence(response: FrequencyResponse, quality: Quality, title: str) -> Figure:
    """1 - multiple coherence of every output, singular values of G, and those of the inputs with their condition."""
    figure, panels = _panels(1, 3, 2.6)
    lost, gains, inputs = panels[0]
    f = response.freq_hz
    for i, output in enumerate(response.outputs):
        unexplained = np.maximum(1 - quality.multiple_coherence[:, i], 1e-16)
        lost.plot(f, unexplained, lw=0.8, color=style.SERIES[i % len(style.SERIES)], label=style.plain(output))
    lost.set_yscale("log")
    lost.set_title("1 − multiple coherence", fontsize=style.NORMAL)
    gains.plot(f, style.in_db(quality.singular_values), lw=0.8, color=style.MEASURED)
    gains.set_title("singular values of G in dB", fontsize=style.NORMAL)
    inputs.plot(f, style.in_db(quality.input_singular_values), lw=0.8, color=style.START)
    inputs.set_title(
        f"singular values of the inputs in dB, condition {np.median(quality.condition):.3g}",
        fontsize=style.NORMAL,
    )
    _finished(figure, lost, response, title)
    style.legend_above(figure, [lost])
    return figure


def _levels_of(axes: Axes, response: FrequencyResponse, quality: Quality, i: int) -> None:
    f, excited = response.freq_hz, quality.excited
    points: dict[str, Any] = {"ls": "none", "mew": 0, "marker": "o"}
    axes.plot(f, style.in_db(excited.amplitude[:, i]), **points, ms=2, color=style.MEASURED, label="excited lines")
    axes.plot(f, style.in_db(excited.noise[:, i]), lw=0.7, color=style.NOISE, label="noise")
    if quality.stochastic is not None:
        axes.plot(f, style.in_db(quality.stochastic[:, i]), lw=0.7, color=style.TOTAL, label="stochastic nonlinear")
    for found, color, label in (
        (quality.even, style.FITTED, "nonlinear, even"),
        (quality.odd, style.START, "nonlinear, odd"),
    ):
        if found is not None:
            level = np.sqrt(np.maximum(found.amplitude[:, i] ** 2 - found.noise[:, i] ** 2, 0.0))
            axes.plot(found.freq_hz, style.in_db(level), **points, ms=1.4, color=color, label=label)


def _panels(rows: int, columns: int, panel_height: float) -> tuple[Figure, FloatArray]:
    width, height = 9.5, 1.15 + rows * panel_height
    figure = Figure(figsize=(width, height))
    grid = {"left": 0.085, "right": 0.98, "top": 1 - 0.75 / height, "bottom": 0.5 / height}
    panels = figure.subplots(
        rows, columns, sharex=True, squeeze=False, gridspec_kw=grid | {"wspace": 0.25, "hspace": 0.25}
    )
    return figure, panels


def _finished(figure: Figure, corner: Axes, response: FrequencyResponse, title: str) -> None:
    for axes in figure.axes:
        style.light(axes)
    style.log_frequency(corner, response.freq_hz, most=4)
    label = style.frequency_label(response.rate_is_known)
    figure.supxlabel(label, fontsize=style.NORMAL, y=0.09 / figure.get_figheight())
    style.titled(figure, title)
