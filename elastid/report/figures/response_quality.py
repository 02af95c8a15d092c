"""Quality of a measured response: levels of the outputs with noise and nonlinearities, coherence, singular values."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from elastid.report.figures import style
from elastid.response import FrequencyResponse, Quality


def levels(response: FrequencyResponse, quality: Quality, title: str) -> Figure:
    """RMS amplitude in dB of every output: excited lines, nonlinearities of even and odd order, stochastic, noise.

    Levels of an experiment's mean over periods; the power of the noise is subtracted from that of the detection lines.
    """
    n_y = len(response.outputs)
    columns = min(n_y, 3)
    figure, panels = _panels(-(-n_y // columns), columns, 2.3)
    for i, output in enumerate(response.outputs):
        axes = panels.flat[i]
        _plot_levels(axes, response, quality, i)
        style.label(axes, title=f"{response.quantity} at {output}")
    for spare in panels.flat[n_y:]:
        spare.set_axis_off()
    _finish(figure, response, title, f"RMS amplitude in dB re 1 {style.pretty_unit(response.output_unit)}")
    style.add_legend(figure, figure.axes, markerscale=2.0)
    return figure


def coherence(response: FrequencyResponse, quality: Quality, title: str) -> Figure:
    """1 - multiple coherence of every output, singular values of G, and those of the inputs with their condition."""
    figure, ((lost, gains, inputs),) = _panels(1, 3, 2.6)
    f = response.freq_hz
    for i, output in enumerate(response.outputs):
        unexplained = np.maximum(1 - quality.multiple_coherence[:, i], 1e-16)  # less is rounding
        lost.plot(f, unexplained, lw=0.8, color=style.SERIES[i % len(style.SERIES)], label=style.plain_label(output))
    lost.set_yscale("log")
    gains.plot(f, style.in_db(quality.singular_values), lw=0.8, color=style.MEASURED)
    inputs.plot(f, style.in_db(quality.input_singular_values), lw=0.8, color=style.START)
    style.label(lost, title="1 − multiple coherence")
    style.label(gains, title="singular values of G in dB")
    style.label(inputs, title=f"singular values of the inputs in dB, condition {np.median(quality.condition):.3g}")
    _finish(figure, response, title)
    style.add_legend(figure, [lost])
    return figure


def _plot_levels(axes: Axes, response: FrequencyResponse, quality: Quality, i: int) -> None:
    f, excited = response.freq_hz, quality.excited
    axes.plot(f, style.in_db(excited.amplitude[:, i]), **style.DOTS, ms=2, color=style.MEASURED, label="excited lines")
    axes.plot(f, style.in_db(excited.noise[:, i]), lw=0.7, color=style.NOISE, label="noise")
    if quality.stochastic is not None:
        axes.plot(f, style.in_db(quality.stochastic[:, i]), lw=0.7, color=style.TOTAL, label="stochastic nonlinear")
    for lines, color, label in (
        (quality.even, style.FITTED, "nonlinear, even"),
        (quality.odd, style.START, "nonlinear, odd"),
    ):
        if lines is not None:
            level = np.sqrt(np.maximum(lines.amplitude[:, i] ** 2 - lines.noise[:, i] ** 2, 0.0))
            axes.plot(lines.freq_hz, style.in_db(level), **style.DOTS, ms=1.4, color=color, label=label)


def _panels(rows: int, columns: int, panel_height: float) -> tuple[Figure, NDArray[Any]]:
    return style.panels(rows, columns, (style.WIDE, 1.25 + rows * panel_height), spaces=(0.25, 0.25), sharex=True)


def _finish(figure: Figure, response: FrequencyResponse, title: str, y_label: str = "") -> None:
    for axes in figure.axes:
        style.lighten(axes)
    style.set_log_frequency(figure.axes[0], response.freq_hz, most=4)
    style.label_figure(figure, style.frequency_label(response.rate_is_known), y_label)
    style.add_title(figure, title)
