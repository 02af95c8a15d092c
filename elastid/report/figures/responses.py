"""The response matrix of one configuration, measured and modelled, and the quality of its measurement."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.report.figures import style
from elastid.response import FrequencyResponse, Quality
from elastid.validation.residual_tests import above_2sigma

# Of the panels of a Bode plot.
PANEL_WIDTH, PANEL_HEIGHT = 3.4, 1.5


def configuration_title(measured: FrequencyResponse, left_out: bool) -> str:
    """Name, angles of the driven joints, and if the configuration was fitted; of a structure the name."""
    if not measured.configuration.angles.size:
        return measured.configuration.name
    angles = ", ".join(f"{angle:.4g}°" for angle in np.degrees(measured.configuration.angles))
    return f"{measured.configuration.name} ({angles}), {'left out of the fit' if left_out else 'fitted'}"


def _unwrapped(modelled: FrequencyResponse) -> tuple[FloatArray, FloatArray]:
    """Every line twice, (2 F,), and the phase (2 F, n_y, n_u) in degrees: NaN the second time where it wraps."""
    phase = np.degrees(np.angle(modelled.G))
    again = phase.copy()
    again[:-1][np.abs(np.diff(phase, axis=0)) > 180] = np.nan
    return np.repeat(modelled.freq_hz, 2), np.stack([phase, again], axis=1).reshape(-1, *phase.shape[1:])


def _band_db(G: ComplexArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """20 log10 of |G| -+ 2 std, not below a thousandth of |G|."""
    magnitude = np.abs(G)
    return style.in_db(np.maximum(magnitude - 2 * std, 1e-3 * magnitude)), style.in_db(magnitude + 2 * std)


def bode(measured: FrequencyResponse, modelled: FrequencyResponse | None, std: FloatArray | None) -> Figure:
    """A pair of panels for each element, inputs across, outputs down; points are grey below 2 sigma.

    modelled: with the inputs and outputs of `measured`, on any lines.  std (F, n_y, n_u): of it, a band of 2 std.
    """
    n_y, n_u = len(measured.outputs), len(measured.inputs)
    left, right, top, bottom = margins = 0.9, 0.3, 1.0, 0.55
    size = left + n_u * PANEL_WIDTH + right, top + 2 * n_y * PANEL_HEIGHT + bottom
    figure, panels = style.panels(2 * n_y, n_u, size, margins, (0.25, 0.15), sharex=True)
    above = above_2sigma(measured)
    for i, j in np.ndindex(n_y, n_u):
        magnitude, phase = panels[2 * i, j], panels[2 * i + 1, j]
        f, G = measured.freq_hz, measured.G[:, i, j]
        style.plot_points(magnitude, f, style.in_db(G), above[:, i, j])
        style.plot_points(phase, f, np.degrees(np.angle(G)), above[:, i, j])
        if modelled is not None:
            _draw_model(magnitude, phase, modelled, i, j, std)
        _label(magnitude, phase, measured, i, j)
    style.set_log_frequency(panels[0, 0], measured.freq_hz)
    style.label_figure(figure, style.frequency_label(measured.rate_is_known))
    title = f"{measured.quantity} of {measured.configuration.name}"
    return style.finish(figure, title, panels.flat, panels.flat, markerscale=2.0)


def _draw_model(magnitude: Axes, phase: Axes, model: FrequencyResponse, i: int, j: int, std: FloatArray | None) -> None:
    f, G = model.freq_hz, model.G[:, i, j]
    if std is not None:
        looks: dict[str, Any] = {"color": style.FITTED, "alpha": 0.25, "lw": 0, "label": "2 std of the model"}
        magnitude.fill_between(f, *_band_db(G, std[:, i, j]), **looks)
    magnitude.plot(f, style.in_db(G), color=style.FITTED, lw=1.1, zorder=3, label="model")
    lines, degrees = _unwrapped(model)
    phase.plot(lines, degrees[:, i, j], color=style.FITTED, lw=1.1)


def _label(magnitude: Axes, phase: Axes, measured: FrequencyResponse, i: int, j: int) -> None:
    phase.set_ylim(-190, 190)
    phase.yaxis.set_major_locator(MultipleLocator(90))
    if i == 0:
        style.label(magnitude, title=f"by {measured.inputs[j]}")
    if j == 0:
        style.label(magnitude, y=f"dB re 1 {style.pretty_unit(measured.unit)}")
        style.label(phase, y="phase in degrees")
    if j == len(measured.inputs) - 1:
        style.label_row(magnitude, measured.outputs[i])


def levels(response: FrequencyResponse, quality: Quality, title: str) -> Figure:
    """RMS amplitude in dB of every output: excited lines, nonlinearities of even and odd order, stochastic, noise.

    Levels of an experiment's mean over periods; the power of the noise is subtracted from that of the detection lines.
    """
    n_y = len(response.outputs)
    columns = min(n_y, 3)
    figure, panels = _quality_panels(-(-n_y // columns), columns, 2.3)
    for i, (output, axes) in enumerate(zip(response.outputs, panels.flat, strict=False)):
        _plot_levels(axes, response, quality, i)
        style.label(axes, title=f"{response.quantity} at {output}")
    for spare in panels.flat[n_y:]:
        spare.set_axis_off()
    _label_quality(figure, response, f"RMS amplitude in dB re 1 {style.pretty_unit(response.output_unit)}")
    return style.finish(figure, title, figure.axes, figure.axes, markerscale=2.0)


def coherence(response: FrequencyResponse, quality: Quality, title: str) -> Figure:
    """1 - multiple coherence of every output, singular values of G, and those of the inputs with their condition."""
    figure, ((lost, gains, inputs),) = _quality_panels(1, 3, 2.6)
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
    _label_quality(figure, response)
    return style.finish(figure, title, figure.axes, [lost])


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


def _quality_panels(rows: int, columns: int, panel_height: float) -> tuple[Figure, NDArray[Any]]:
    return style.panels(rows, columns, (style.WIDE, 1.25 + rows * panel_height), spaces=(0.25, 0.25), sharex=True)


def _label_quality(figure: Figure, response: FrequencyResponse, y_label: str = "") -> None:
    style.set_log_frequency(figure.axes[0], response.freq_hz, most=4)
    style.label_figure(figure, style.frequency_label(response.rate_is_known), y_label)
