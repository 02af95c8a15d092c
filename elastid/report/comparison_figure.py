"""How models compare on configurations that they were not fitted to."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from elastid.report import style
from elastid.validation.comparison import Comparison

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
