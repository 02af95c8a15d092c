"""Modes of a measured response: stabilisation diagram over mode indicator functions, error of the synthesis."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from elastid.modal.modes import Modes
from elastid.report.figures import style

# Poles shown are within this part of the band beyond its ends.
BEYOND = 0.02


def stabilisation_diagram(modes: Modes, title: str) -> Figure:
    """Poles by frequency and order over the singular values of the response; lines at the modes."""
    figure, panels = style.panels(1, 1, (style.WIDE, 4.2), (0.8, 0.8, 0.85, 0.55), (0.0, 0.0))
    axes, diagram = panels[0, 0], modes.diagram
    indicators = axes.twinx()
    floor = np.finfo(float).tiny
    indicators.plot(modes.at_hz, style.in_db(modes.indicators + floor), color=style.WEAK, lw=0.8, zorder=1)
    style.label(indicators, y=f"singular values, dB re 1 {style.pretty_unit(modes.unit)}")
    for stable, marker, color, text in (
        (False, ".", style.WEAK, "pole"), (True, "o", style.MEASURED, "stable in frequency (1 %) and damping (5 %)"),
    ):  # fmt: skip
        own = diagram.stable == stable
        axes.plot(diagram.freq_hz[own], diagram.order[own], ls="none", marker=marker, ms=3, color=color, label=text)
    for i, freq_hz in enumerate(modes.freq_hz):
        axes.axvline(freq_hz, color=style.FITTED, lw=0.8, zorder=0.8, label="mode" if i == 0 else None)
    axes.set_zorder(2)
    axes.patch.set_visible(False)
    width = modes.at_hz[-1] - modes.at_hz[0]
    axes.set_xlim(modes.at_hz[0] - BEYOND * width, modes.at_hz[-1] + BEYOND * width)
    style.label(axes, style.frequency_label(modes.rate_is_known), "order")
    return style.finish(figure, f"Stabilisation diagram, {title}", [axes], [axes])


def synthesis_error(modes: Modes, title: str) -> Figure:
    """The error of the modal model line by line, and the part of it that the noise of the response explains."""
    figure, panels = style.panels(1, 1, (style.WIDE, 2.8), (0.8, 0.25, 0.85, 0.55), (0.0, 0.0))
    axes, f = panels[0, 0], modes.at_hz
    curves = ((100 * modes.error, style.RESIDUAL, 0.8, "modal model"), (100 * modes.stated, style.NOISE, 1.0, "noise"))
    style.plot_curves(axes, f, *curves)
    axes.set_yscale("log")
    style.label(axes, style.frequency_label(modes.rate_is_known), "% of |G|, RMS over elements")
    return style.finish(figure, f"Error of the synthesis, {title}", [axes], [axes])
