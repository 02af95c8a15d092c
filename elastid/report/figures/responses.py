"""The response matrix of one configuration, the quality of its measurement, and the poles of its modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.report.figures import style
from elastid.report.figures.style import Curve, Panel, in_db
from elastid.response import Quality, Response
from elastid.validation.residual_tests import above_2sigma

if TYPE_CHECKING:
    from elastid.modal.modes import Modes


def configuration_title(measured: Response, left_out: bool) -> str:
    """Name, angles of the driven joints, and if the configuration was fitted; of a structure the name."""
    if not measured.configuration.angles.size:
        return measured.configuration.name
    angles = ", ".join(f"{angle:.4g}°" for angle in np.degrees(measured.configuration.angles))
    return f"{measured.configuration.name} ({angles}), {'left out of the fit' if left_out else 'fitted'}"


def bode(measured: Response, modelled: Response | None, std: FloatArray | None) -> Figure:
    """A pair of panels for each element, inputs across, outputs down; points are grey below 2 sigma.

    modelled: with the inputs and outputs of `measured`, on any lines.  std (F, n_y, n_u): of it, a band of 2 std.
    """
    rows = []
    above, label = above_2sigma(measured), style.frequency_label(measured.rate_is_known)
    n_y, n_u = len(measured.outputs), len(measured.inputs)
    for i in range(n_y):
        magnitude, phase = [], []
        for j, by in enumerate(measured.inputs):
            seen = _measured(measured, above[:, i, j], measured.G[:, i, j])
            drawn = ([], []) if modelled is None else _modelled(modelled, i, j, std)
            names = (measured.outputs[i], "degrees") if j == 0 else ("", "")
            title = f"by {by}" if i == 0 else ""
            lines = measured.freq_hz
            magnitude.append(Panel([*seen[0], *drawn[0]], y=names[0], title=title, frequency=lines))
            last, ends = label if i == n_y - 1 else "", (-190.0, 190.0)
            phase.append(Panel([*seen[1], *drawn[1]], last, names[1], frequency=lines, y_ends=ends))
        rows += [magnitude, phase]
    unit = style.pretty_unit(measured.unit)
    title = f"{measured.quantity} of {measured.configuration.name}, dB re 1 {unit} and phase"
    return style.matrix(title, rows, 1.4, 1.2 + 3.4 * n_u, gaps=(0.2, 0.15), sharex=True)


def _measured(measured: Response, above: BoolArray, G: ComplexArray) -> tuple[list[Curve], list[Curve]]:
    """Magnitude and phase as points."""
    looks = {"ms": 2.4 if len(above) <= 300 else 1.6, "zorder": 2}
    kinds = ((above, "measured", style.MEASURED), (~above, "measured, below 2 sigma", style.WEAK))
    f = measured.freq_hz
    magnitude, phase = (
        [Curve(f[own], values[own], text, ink, True, looks=looks) for own, text, ink in kinds if own.any()]
        for values in (in_db(G), np.degrees(np.angle(G)))
    )
    return magnitude, phase


def _modelled(model: Response, i: int, j: int, std: FloatArray | None) -> tuple[list[Curve], list[Curve]]:
    """Magnitude with its band, not below a thousandth of it, and phase, which breaks where it wraps."""
    G, f = model.G[:, i, j], model.freq_hz
    size, phase, band = np.abs(G), np.degrees(np.angle(G)), None
    if std is not None:
        spread = 2 * std[:, i, j]
        band = in_db(np.maximum(size - spread, 1e-3 * size)), in_db(size + spread)
    again = phase.copy()
    again[:-1][np.abs(np.diff(phase)) > 180] = np.nan
    looks = {"lw": 1.1, "zorder": 3}
    magnitude = Curve(f, in_db(G), "model", style.FITTED, band=band, band_label="2 std of the model", looks=looks)
    broken = np.stack([phase, again], axis=1).ravel()
    return [magnitude], [Curve(np.repeat(f, 2), broken, "model", style.FITTED, looks=looks)]


def quality_figure(response: Response, quality: Quality, title: str) -> Figure:
    """RMS amplitudes in dB of every output, then the unexplained part of all, and singular values of G and inputs.

    Levels of an experiment's mean over periods, on excited lines, and of nonlinearities of even and odd order; the
    power of the noise is subtracted from that of the detection lines.
    """
    f, label = response.freq_hz, style.frequency_label(response.rate_is_known)
    unit = f"dB re 1 {style.pretty_unit(response.output_unit)}"
    panels = [
        Panel(_levels(f, quality, i), label, unit, f"{response.quantity} at {output}", frequency=f)
        for i, output in enumerate(response.outputs)
    ]
    lost = [
        Curve(f, np.maximum(1 - part, 1e-16), color=style.SERIES[i % len(style.SERIES)])  # less is rounding
        for i, part in enumerate(quality.multiple_coherence.T)
    ]
    panels.append(Panel(lost, label, title="1 − multiple coherence", frequency=f, scale="log"))
    values = ((quality.singular_values, "G"), (quality.input_singular_values, "the inputs"))
    for each, name in values:
        words = f"singular values of {name}, dB; condition {np.median(each[:, 0] / each[:, -1]):.3g}"
        panels.append(Panel([Curve(f, in_db(column)) for column in each.T], label, title=words, frequency=f))
    return style.matrix(title, style.in_columns(panels), gaps=(0.25, 0.45))


def _levels(f: FloatArray, quality: Quality, i: int) -> list[Curve]:
    excited, looks = quality.excited, {"lw": 0.7}
    curves = [
        Curve(f, in_db(excited.amplitude[:, i]), "excited lines", dots=True, looks={"ms": 2}),
        Curve(f, in_db(excited.noise[:, i]), "noise", style.NOISE, looks=looks),
    ]
    if quality.stochastic is not None:
        curves.append(Curve(f, in_db(quality.stochastic[:, i]), "stochastic nonlinear", style.TOTAL, looks=looks))
    for lines, ink, name in ((quality.even, style.FITTED, "even"), (quality.odd, style.START, "odd")):
        if lines is not None:
            level = np.sqrt(np.maximum(lines.amplitude[:, i] ** 2 - lines.noise[:, i] ** 2, 0.0))
            curves.append(Curve(lines.freq_hz, in_db(level), f"nonlinear, {name}", ink, True, looks={"ms": 1.4}))
    return curves


def stabilisation_diagram(modes: Modes, title: str) -> Figure:
    """Poles by frequency and order, lines at the modes; below them the singular values of the response."""
    diagram, stable = modes.diagram, "stable in frequency (1 %) and damping (5 %)"
    poles = [
        Curve(diagram.freq_hz[own], diagram.order[own], text, ink, True)
        for own, text, ink in ((~diagram.stable, "pole", style.WEAK), (diagram.stable, stable, style.MEASURED))
    ]
    top = float(diagram.order.max(initial=1))
    looks = {"lw": 0.8, "zorder": 0.8}
    lines = [Curve([f, f], [0.0, top], "mode", style.FITTED, looks=looks) for f in modes.freq_hz]
    indicators = in_db(modes.indicators + np.finfo(float).tiny)
    values = [Curve(modes.at_hz, column, color=style.WEAK) for column in indicators.T]
    width = modes.at_hz[-1] - modes.at_hz[0]
    ends = float(modes.at_hz[0] - 0.02 * width), float(modes.at_hz[-1] + 0.02 * width)
    unit = "singular values, dB"
    below = Panel(values, style.frequency_label(modes.rate_is_known), unit, x_ends=ends)
    rows = [[Panel([*poles, *lines], y="order", x_ends=ends)], [below]]
    return style.matrix(f"Stabilisation diagram, {title}", rows, (2.6, 1.6), sharex=True, gaps=(0.0, 0.1))
