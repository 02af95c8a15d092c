"""Magnitude and phase of a response in one figure, measured and modelled on lines of their own."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.report.figures import style
from elastid.response import FrequencyResponse
from elastid.validation.residual_tests import above_2sigma

# The band of the model ends at this part of |G|.
MIN_BAND = 1e-3
PANEL_WIDTH, PANEL_HEIGHT = 3.4, 1.5


def bode(measured: FrequencyResponse, modelled: FrequencyResponse | None, std: FloatArray | None) -> Figure:
    """A pair of panels for each element, inputs across, outputs down; points are grey below 2 sigma.

    modelled: with the inputs and outputs of `measured`, on any lines.  std (F, n_y, n_u): of it, drawn as a band of
    2 std.
    """
    n_y, n_u = len(measured.outputs), len(measured.inputs)
    left, right, top, bottom = margins = 0.9, 0.3, 1.0, 0.55
    size = left + n_u * PANEL_WIDTH + right, top + 2 * n_y * PANEL_HEIGHT + bottom
    figure, panels = style.panels(2 * n_y, n_u, size, margins, (0.25, 0.15), sharex=True)
    above = above_2sigma(measured)
    for i in range(n_y):
        for j in range(n_u):
            magnitude, phase = panels[2 * i, j], panels[2 * i + 1, j]
            f, G, kept = measured.freq_hz, measured.G[:, i, j], above[:, i, j]
            style.plot_points(magnitude, f, style.in_db(G), kept)
            style.plot_points(phase, f, np.degrees(np.angle(G)), kept)
            if modelled is not None:
                spread = None if std is None else std[:, i, j]
                _draw_model(magnitude, phase, modelled.freq_hz, modelled.G[:, i, j], spread)
            _label(magnitude, phase, measured, i, j)
    style.set_log_frequency(panels[0, 0], measured.freq_hz)
    style.label_figure(figure, style.frequency_label(measured.rate_is_known))
    style.add_title(figure, f"{measured.quantity} of {measured.configuration.name}")
    style.add_legend(figure, panels.flat, markerscale=2.0)
    return figure


def _draw_model(magnitude: Axes, phase: Axes, freq_hz: FloatArray, G: ComplexArray, std: FloatArray | None) -> None:
    if std is not None:
        size = np.abs(G)
        ends = style.in_db(np.maximum(size - 2 * std, MIN_BAND * size)), style.in_db(size + 2 * std)
        magnitude.fill_between(freq_hz, *ends, color=style.FITTED, alpha=0.25, lw=0, label="2 std of the model")
    magnitude.plot(freq_hz, style.in_db(G), color=style.FITTED, lw=1.1, zorder=3, label="model")
    degrees = np.degrees(np.angle(G))
    wraps = np.flatnonzero(np.abs(np.diff(degrees)) > 180) + 1
    phase.plot(np.insert(freq_hz, wraps, np.nan), np.insert(degrees, wraps, np.nan), color=style.FITTED, lw=1.1)


def _label(magnitude: Axes, phase: Axes, measured: FrequencyResponse, i: int, j: int) -> None:
    phase.set_ylim(-190, 190)
    phase.yaxis.set_major_locator(MultipleLocator(90))
    style.lighten(magnitude)
    style.lighten(phase)
    if i == 0:
        style.label(magnitude, title=f"by {measured.inputs[j]}")
    if j == 0:
        style.label(magnitude, y=f"dB re 1 {style.pretty_unit(measured.unit)}")
        style.label(phase, y="phase in degrees")
    if j == len(measured.inputs) - 1:
        style.label_row(magnitude, measured.outputs[i])
