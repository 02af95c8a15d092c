"""Modification indices: the share of the excess that each number or reading would explain alone."""

from __future__ import annotations

from matplotlib.figure import Figure

from elastid.fit.result import FitResult
from elastid.report.figures import style

# Inches: of a bar, and beside the bars.
BAR, WIDTH, LETTER = 0.24, 4.0, 0.075


def modification_shares(result: FitResult) -> Figure:
    """A bar for each, the first of the sequence filled dark."""
    alone = [one for one in result.indices if not one.place][::-1]
    first = {one.name for one in result.indices if one.place == 1}
    left = 0.4 + LETTER * max(len(one.name) for one in alone)
    height = 1.1 + BAR * len(alone)
    figure = Figure(figsize=(left + WIDTH + 0.3, height))
    axes = figure.add_axes((left / (left + WIDTH + 0.3), 0.55 / height, WIDTH / (left + WIDTH + 0.3), 1 - 1.1 / height))
    colors = [style.FITTED if one.name in first else style.MEASURED for one in alone]
    axes.barh(range(len(alone)), [min(100 * one.share, 100.0) for one in alone], color=colors, height=0.7)
    style.set_names(axes.yaxis, [one.name for one in alone])
    axes.set_xlim(0, 100)
    style.label(axes, x="share of the excess of V, %")
    style.lighten(axes)
    style.add_title(figure, "What would explain the residuals beyond the noise")
    return figure
