"""The shape of each mode of the identified model as bars: which coordinates move, how far, and which way."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from elastid.base.numbers import number
from elastid.report.figures import style
from elastid.report.modes.mode_row import ModeRow


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
    figure, panels = style.panels(
        n_m, 1, (width, height), (left, 0.15, 0.8, below), (0.0, 0.35), sharex=True, sharey=True
    )
    x = np.arange(n)
    colors = [style.START if name.startswith("motor") else style.MEASURED for name in names]
    for m, axes in enumerate(panels.flat):
        axes.bar(x, shapes[:, m].real, width=0.6, color=colors)
        axes.plot(x, shapes[:, m].imag, ls="none", marker="_", ms=7, mew=1, color=style.TRUTH)
        axes.axhline(0, color=style.TRUTH, lw=0.5)
        style.lighten(axes)
        axes.set_yticks([-1, 0, 1])
        axes.set_ylim(-1.15, 1.15)
        axes.set_title(style.plain(row.energy_text[m]), loc="left", fontsize=style.SMALL, pad=2)
        numbers = f"{number(row.frequency_hz[m])} {style.frequency_unit(rate_is_known)}"
        numbers += f"\n{number(100 * row.damping_ratio[m], 2)} %"
        axes.set_ylabel(numbers, rotation=0, ha="right", va="center", fontsize=style.NORMAL, labelpad=4)
    style.set_names(panels[-1, 0].xaxis, names, rotation=90)
    style.add_title(figure, f"Mode shapes, {title}")
    key = "blue: joints, orange: motors (link side); dash: part out of phase"
    figure.text(0.125 / width, 1 - 0.4 / height, key, fontsize=style.SMALL, va="center")
    return figure
