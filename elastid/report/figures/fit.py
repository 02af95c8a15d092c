"""How the fit went and how well the data determine it: multistart costs, correlations, singular values."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.fit.result import FitResult
from elastid.report.figures import style


def multistart(result: FitResult) -> Figure:
    """V of every start, sorted; those that reached the best one filled, those whose solver gave up crossed."""
    cost = np.array([start.cost for start in result.starts])
    rank = np.arange(1, len(cost) + 1)
    converged = np.array([start.converged for start in result.starts])
    hit = rank <= result.hits
    figure = Figure(figsize=(6.5, 3.2))
    axes = figure.subplots(gridspec_kw={"left": 0.12, "right": 0.97, "top": 0.72, "bottom": 0.16})
    axes.axhline(result.cost_expected, color=style.NOISE, lw=1, ls="--", label="expected from the noise")
    for keep, marker, face, color, label in (
        (hit, "o", style.MEASURED, style.MEASURED, "reached the best cost"),
        (~hit & converged, "o", "none", style.FITTED, "ended elsewhere"),
        (~hit & ~converged, "x", style.WEAK, style.WEAK, "did not converge"),
    ):
        if keep.any():
            axes.plot(rank[keep], cost[keep], ls="none", marker=marker, ms=5, mfc=face, color=color, label=label)
    shown = np.append(cost[np.isfinite(cost)], result.cost_expected)
    if shown.min() > 0 and shown.max() > 5 * shown.min():
        _log_values(axes, float(shown.min()), float(shown.max()))
    style.plain_ticks(axes.xaxis, rank[:: math.ceil(len(rank) / 10)].tolist())
    axes.set_xlim(0.3, len(cost) + 0.7)
    axes.set_xlabel("start, sorted by cost", fontsize=style.NORMAL)
    axes.set_ylabel("cost V", fontsize=style.NORMAL)
    style.light(axes)
    style.titled(figure, f"Multistart: {result.hits} of {len(cost)} starts reached the best cost")
    style.legend_above(figure, (axes,))
    return figure


def identifiability(result: FitResult) -> Figure:
    """Correlations of the estimates, numbers where |r| > 0.9; singular values of the scaled Jacobian beside them."""
    r = result.correlation
    n = len(r)
    side = float(np.clip(0.27 * n, 2.4, 7.0))
    names = 0.25 + 0.075 * max(len(name) for name in result.parameters.free_names)
    left, gap, right, top, bottom = names + 0.1, 1.5, 0.3, 0.75, max(names, 0.55)
    width, height = left + side + gap + 3.2 + right, top + side + bottom
    figure = Figure(figsize=(width, height))
    matrix = figure.add_axes((left / width, bottom / height, side / width, side / height))
    values = figure.add_axes(((left + side + gap) / width, bottom / height, 3.2 / width, side / height))
    _correlations(matrix, r, result.parameters.free_names, min(style.SMALL, 72 * side / n * 0.8))
    bar = figure.add_axes(((left + side + 0.1) / width, bottom / height, 0.1 / width, side / height))
    figure.colorbar(matrix.images[0], cax=bar).ax.tick_params(labelsize=style.SMALL, length=2)
    s = result.singular_values
    values.plot(np.arange(1, len(s) + 1), s, ls="none", marker="o", ms=4.5, color=style.MEASURED)
    if np.all(s > 0):
        _log_values(values, float(s[-1]), float(s[0]))
    style.plain_ticks(values.xaxis, list(range(1, len(s) + 1, math.ceil(len(s) / 10))))
    values.set_xlabel("number", fontsize=style.NORMAL)
    condition = s[0] / s[-1] if s[-1] > 0 else math.inf
    values.set_title(f"singular values, condition {condition:.3g}", fontsize=style.NORMAL)
    style.light(values)
    matrix.set_title("correlation of the estimates", fontsize=style.NORMAL)
    style.titled(figure, "How well the data determine the parameters")
    return figure


def _log_values(axes: Axes, low: float, high: float) -> None:
    """Logarithmic y axis with a few plain numbers."""
    axes.set_yscale("log")
    axes.set_ylim(low / 1.3, high * 1.3)
    style.plain_ticks(axes.yaxis, style.round_ticks(low / 1.3, high * 1.3, 8))


def _correlations(axes: Axes, r: FloatArray, names: Sequence[str], size: float) -> None:
    axes.set_facecolor("#EEEEEE")
    axes.imshow(r, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest", aspect="auto")
    labels = [style.plain(name) for name in names]
    axes.set_xticks(np.arange(len(r)), labels, rotation=90, fontsize=size)
    axes.set_yticks(np.arange(len(r)), labels, fontsize=size)
    axes.tick_params(length=0)
    for i, j in np.argwhere(np.abs(r) > 0.9):
        if i != j:
            axes.text(j, i, f"{r[i, j]:.2f}", ha="center", va="center", color="white", fontsize=0.75 * size)
