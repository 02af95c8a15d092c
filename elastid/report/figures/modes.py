"""Modes of a measurement: shapes as bars, and poles over the order of the estimator."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from elastid.base.display import number
from elastid.modal.modes import Modes
from elastid.report.figures import style
from elastid.report.modes import ModeRow


def mode_shapes(row: ModeRow, title: str, rate_is_known: bool) -> Figure:
    """A row of bars for each mode, one for every coordinate: its part in phase with the largest one, which is 1.

    The part out of phase (damping that is not proportional) is a dash. Joints are relative angles, motors are on the
    link side: the torsion of a gear spring is the difference of the two.
    """
    shapes, names = row.shapes, row.coordinates
    n, n_m = shapes.shape
    left = 1.25 if rate_is_known else 1.6
    width = float(np.clip(left + 0.45 + 0.42 * n, 4.5, 11.0))
    panel, below = float(np.clip(5.0 / max(n_m, 1), 0.6, 0.9)), 0.3 + 0.065 * max(map(len, names))
    height = 0.85 + n_m * panel + below
    margins = left, 0.15, 0.8, below
    figure, panels = style.panels(n_m, 1, (width, height), margins, (0.0, 0.35), sharex=True, sharey=True)
    x = np.arange(n)
    colors = [style.START if name.startswith("motor") else style.MEASURED for name in names]
    bar = 0.6 * 72 * (width - margins[0] - margins[1]) / n  # points
    for m, axes in enumerate(panels.flat):
        axes.xaxis.set_visible(m == n_m - 1)  # ticks of all panels would take most of the time
        axes.vlines(x, 0, shapes[:, m].real, colors=colors, linewidth=bar)
        axes.plot(x, shapes[:, m].imag, ls="none", marker="_", ms=7, mew=1, color=style.TRUTH)
        axes.axhline(0, color=style.TRUTH, lw=0.5)
        axes.set_yticks([-1, 0, 1])
        axes.set(xlim=(-0.6, n - 0.4), ylim=(-1.15, 1.15))
        axes.set_title(style.plain(row.energy_text[m]), loc="left", fontsize=style.SMALL, pad=2)
        numbers = f"{number(row.frequency_hz[m])} {style.frequency_unit(rate_is_known)}"
        numbers += f"\n{number(100 * row.damping_ratio[m], 2)} %"
        axes.set_ylabel(numbers, rotation=0, ha="right", va="center", fontsize=style.NORMAL, labelpad=4)
    style.set_names(panels[-1, 0].xaxis, names, rotation=90)
    key = "blue: joints, orange: motors (link side); dash: part out of phase"
    figure.text(0.125 / width, 1 - 0.4 / height, key, fontsize=style.SMALL, va="center")
    return style.finish(figure, f"Mode shapes, {title}", panels.flat)


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
