"""The fit: costs of the multistart, correlations of the estimates, singular values of the scaled Jacobian."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.fit.result import FitResult
from elastid.report.figures import style

# Correlations of more are written into the matrix.
MIN_WRITTEN_CORRELATION = 0.9
# Costs further apart than by this factor are on a logarithmic axis.
MAX_LINEAR_RATIO = 5.0
# Inches: the panel of singular values is so wide, and so far from the matrix.
VALUES_WIDTH, GAP = 3.2, 1.5


def multistart_costs(result: FitResult) -> Figure:
    """V of every start, sorted; those that reached the best one filled, those that did not converge crossed."""
    cost = np.array([start.cost for start in result.starts])
    converged = np.array([start.converged for start in result.starts])
    rank = np.arange(1, len(cost) + 1)
    hit = rank <= result.hits
    figure, ((axes,),) = style.panels(1, 1, (6.5, 3.2), (0.8, 0.2, 0.9, 0.5))
    axes.axhline(result.cost_expected, color=style.NOISE, lw=1, ls="--", label="expected from the noise")
    for keep, marker, face, color, label in (
        (hit, "o", style.MEASURED, style.MEASURED, "reached the best cost"),
        (~hit & converged, "o", "none", style.FITTED, "ended elsewhere"),
        (~hit & ~converged, "x", style.WEAK, style.WEAK, "did not converge"),
    ):
        if keep.any():
            axes.plot(rank[keep], cost[keep], ls="none", marker=marker, ms=5, mfc=face, color=color, label=label)
    shown = np.append(cost[np.isfinite(cost)], result.cost_expected)
    if shown.min() > 0 and shown.max() > MAX_LINEAR_RATIO * shown.min():
        style.set_log_values(axes, float(shown.min()), float(shown.max()))
    style.set_plain_ticks(axes.xaxis, rank[:: math.ceil(len(rank) / 10)].tolist())
    axes.set_xlim(0.3, len(cost) + 0.7)
    style.label(axes, x="start, sorted by cost", y="cost V")
    style.lighten(axes)
    style.add_title(figure, f"Multistart: {result.hits} of {len(cost)} starts reached the best cost")
    style.add_legend(figure, (axes,))
    return figure


def identifiability(result: FitResult) -> Figure:
    """Correlations of the estimates, numbers where |r| > 0.9; singular values of the scaled Jacobian beside them."""
    r, names = result.correlation, result.parameters.free_names
    side = float(np.clip(0.27 * len(r), 2.4, 7.0))
    letters = 0.25 + 0.075 * max(map(len, names))
    left, top, bottom = letters + 0.1, 0.75, max(letters, 0.55)
    width, height = left + side + GAP + VALUES_WIDTH + 0.3, top + side + bottom
    figure = Figure(figsize=(width, height))

    def axes_at(x: float, wide: float) -> Axes:
        return figure.add_axes((x / width, bottom / height, wide / width, side / height))

    matrix, values = axes_at(left, side), axes_at(left + side + GAP, VALUES_WIDTH)
    _draw_correlations(matrix, r, names, min(style.SMALL, 72 * side / len(r) * 0.8))
    bar = figure.colorbar(matrix.images[0], cax=axes_at(left + side + 0.1, 0.1))
    bar.ax.tick_params(labelsize=style.SMALL, length=2)
    style.label(matrix, title="correlation of the estimates")
    s = result.singular_values
    values.plot(np.arange(1, len(s) + 1), s, ls="none", marker="o", ms=4.5, color=style.MEASURED)
    if np.all(s > 0):
        style.set_log_values(values, float(s[-1]), float(s[0]))
    style.set_plain_ticks(values.xaxis, list(range(1, len(s) + 1, math.ceil(len(s) / 10))))
    condition = s[0] / s[-1] if s[-1] > 0 else math.inf
    style.label(values, x="number", title=f"singular values, condition {condition:.3g}")
    style.lighten(values)
    style.add_title(figure, "How well the data determine the parameters")
    return figure


def _draw_correlations(axes: Axes, r: FloatArray, names: Sequence[str], size: float) -> None:
    axes.set_facecolor(style.SHADE)
    axes.imshow(r, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest", aspect="auto")
    style.set_names(axes.xaxis, names, rotation=90, fontsize=size)
    style.set_names(axes.yaxis, names, fontsize=size)
    axes.tick_params(length=0)
    for i, j in np.argwhere(np.abs(r) > MIN_WRITTEN_CORRELATION):
        if i != j:
            axes.text(j, i, f"{r[i, j]:.2f}", ha="center", va="center", color="white", fontsize=0.75 * size)
