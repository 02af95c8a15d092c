"""A matrix of equal panels over one logarithmic frequency axis, all on one canvas in inches.

Axes of their own would take most of the time of a report: a response of six motors has 36 panels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from elastid.base.arrays import BoolArray, FloatArray
from elastid.report.figures import style

# Inches: left of all panels, right, above and below; between columns and between rows.
LEFT, RIGHT, TOP, BOTTOM = 0.75, 0.3, 1.0, 0.55
GAP_X, GAP_Y = 0.09, 0.13


@dataclass(frozen=True)
class PanelMatrix:
    """Where values at freq_hz (F,) of every element (n_y rows, n_u columns) are on the canvas.

    y: the least and the largest value of all panels.  panel: width and height in inches.
    """

    freq_hz: FloatArray
    y: tuple[float, float]
    rows: int
    columns: int

    @property
    def panel(self) -> tuple[float, float]:
        """Width and height in inches."""
        return float(np.clip(8.6 / self.columns, 1.5, 6.0)) - GAP_X, float(np.clip(5.4 / self.rows, 1.1, 3.2)) - GAP_Y

    @property
    def size(self) -> tuple[float, float]:
        """Of the canvas."""
        width, height = self.panel
        return (
            LEFT + self.columns * (width + GAP_X) - GAP_X + RIGHT,
            TOP + self.rows * (height + GAP_Y) - GAP_Y + BOTTOM,
        )

    @property
    def corners(self) -> tuple[FloatArray, FloatArray]:
        """Left edges (columns,) and lower edges (rows,), the first row at the top."""
        width, height = self.panel
        x = LEFT + np.arange(self.columns) * (width + GAP_X)
        return np.asarray(x), np.asarray(BOTTOM + np.arange(self.rows)[::-1] * (height + GAP_Y))

    def x_within(self, freq_hz: FloatArray) -> FloatArray:
        """Inches from the left edge of a panel; the panel is a twentieth wider than the lines on either side."""
        low, high = np.log(self.freq_hz[0] / 1.05), np.log(self.freq_hz[-1] * 1.05)
        return np.asarray(self.panel[0] * (np.log(freq_hz) - low) / (high - low))

    def y_within(self, values: FloatArray) -> FloatArray:
        """Inches from the lower edge of a panel."""
        low, high = self.y
        return np.asarray(self.panel[1] * (values - low) / (high - low))

    def placed(self, freq_hz: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """x and y (n, rows, columns) on the canvas of values (n, rows, columns) at freq_hz (n,)."""
        left, bottom = self.corners
        x = np.broadcast_to(left + self.x_within(freq_hz)[:, None, None], values.shape)
        return x, np.asarray(bottom[:, None] + self.y_within(values))

    def inside(self, values: FloatArray) -> BoolArray:
        """Which values are within the range of y."""
        return np.asarray((values >= self.y[0]) & (values <= self.y[1]))

    def curve(self, freq_hz: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """One line through all panels, broken between them, where values are not finite and beyond the range of y."""
        seen = self.inside(values)
        seen[1:] |= self.inside(values)[:-1]
        seen[:-1] |= self.inside(values)[1:]
        x, y = self.placed(freq_hz, np.where(seen, np.clip(values, *self.y), np.nan))
        return _joined(x), _joined(y)

    def band(
        self, low: FloatArray, high: FloatArray, freq_hz: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, lower and upper edge of a band through all panels, broken as a curve is; on lines of its own if given."""
        f = self.freq_hz if freq_hz is None else freq_hz
        seen = (high >= self.y[0]) & (low <= self.y[1])
        edges = [np.where(seen, np.clip(edge, *self.y), np.nan) for edge in (low, high)]
        (x, below), (_, above) = (self.placed(f, edge) for edge in edges)
        return _joined(x), _joined(below), _joined(above)


def _joined(values: FloatArray) -> FloatArray:
    """(n, rows, columns) element by element in one row, NaN between them."""
    broken = np.concatenate([values, np.full((1, *values.shape[1:]), np.nan)])
    return np.asarray(broken.reshape(len(broken), -1).T.ravel())


def empty_panels(matrix: PanelMatrix, y_ticks: Sequence[float]) -> tuple[Figure, Axes]:
    """The canvas with a thin grid in every panel, and numbers on the left of and below all."""
    figure = Figure(figsize=matrix.size)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, matrix.size[0]), ylim=(0, matrix.size[1]), autoscale_on=False)
    axes.axis("off")
    low, high = float(matrix.freq_hz[0]), float(matrix.freq_hz[-1])
    x_ticks = style.round_ticks(low, high, 6 if matrix.columns <= 3 else 3)
    x, y = matrix.x_within(np.array(x_ticks)), matrix.y_within(np.array(y_ticks))
    (width, height), (left, bottom) = matrix.panel, matrix.corners
    upright = [[(a + at, b), (a + at, b + height)] for a in left for b in bottom for at in x]
    across = [[(a, b + at), (a + width, b + at)] for a in left for b in bottom for at in y]
    frames = [[(a, b + height), (a, b), (a + width, b)] for a in left for b in bottom]
    axes.add_collection(LineCollection(upright + across, colors=style.GRID, linewidths=0.4, zorder=0.5))
    axes.add_collection(LineCollection(frames, colors=style.TRUTH, linewidths=0.8, zorder=2.5))
    for at, value in [(a + at, value) for a in left for at, value in zip(x, x_ticks, strict=True)]:
        axes.text(at, bottom[-1] - 0.06, f"{value:g}", ha="center", va="top", fontsize=style.SMALL)
    for at, value in [(b + at, value) for b in bottom for at, value in zip(y, y_ticks, strict=True)]:
        text = f"{value:g}".replace("-", "−")
        axes.text(left[0] - 0.06, at, text, ha="right", va="center", fontsize=style.SMALL)
    return figure, axes


def name_panels(axes: Axes, matrix: PanelMatrix, rows: Sequence[str], columns: Sequence[str]) -> None:
    """Names of the columns above the first row, of the rows on the right of the last column, read downwards."""
    (width, height), (left, bottom) = matrix.panel, matrix.corners
    for at, name in zip(left, columns, strict=True):
        middle, above = at + width / 2, bottom[0] + height + 0.08
        axes.text(middle, above, style.plain(name), ha="center", va="bottom", fontsize=style.NORMAL)
    for at, name in zip(bottom, rows, strict=True):
        beside, middle = left[-1] + width + 0.06, at + height / 2
        axes.text(beside, middle, style.plain(name), rotation=270, va="center", fontsize=style.NORMAL)
