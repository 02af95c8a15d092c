"""Common style of all figures: colours for colour-blind readers, and a matrix of panels; text is never a formula."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib import rc_context, rcdefaults
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator, StrMethodFormatter
from numpy.typing import ArrayLike

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.statistics import QUANTILE_95

# Colours of Okabe and Ito (2008) by role.
MEASURED = "#0072B2"
FITTED = "#D55E00"
NOISE = "#009E73"
TOTAL = "#CC79A7"
RESIDUAL = "#56B4E9"
START = "#E69F00"
TRUTH = "#000000"
WEAK = "#B8B8B8"
SERIES = (MEASURED, FITTED, NOISE, TOTAL, START, RESIDUAL)
GRID, SHADE = "#DDDDDD", "#EEEEEE"

TINY, SMALL, NORMAL, LARGE = 5.5, 7.5, 8.5, 10.0  # font sizes in points
WIDE = 9.5  # width in inches of figures with many panels
DOTS: dict[str, Any] = {"ls": "none", "marker": "o", "mew": 0}  # points without lines and edges
MAX_SAMPLES = 6000  # samples of a log that are drawn
MAX_NUMBERED_CELLS = 400  # a larger heat map has no numbers in its cells
MIN_DARK = 0.6  # fraction of the colour scale above which a cell is dark


@contextmanager
def default_style() -> Iterator[None]:
    """Use Matplotlib's defaults for figures that are drawn or saved inside, instead of a matplotlibrc."""
    with rc_context():
        rcdefaults()
        yield


class NotebookFigure(Figure):
    """Figure that a notebook shows as the value of a cell, also without pyplot."""

    @default_style()
    def savefig(self, fname: Any, *, transparent: bool | None = None, **options: Any) -> None:
        """Save the figure as matplotlib does, with the default style."""
        super().savefig(fname, transparent=transparent, **options)

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def plain(text: str) -> str:
    """Escape dollar signs, which otherwise begin a formula."""
    return text.replace("$", r"\$")


def plain_label(text: str) -> str:
    """Escape a label of a legend, which would omit a label with a leading underscore."""
    return f" {plain(text)}" if text.startswith("_") else plain(text)


def pretty_unit(unit: str) -> str:
    """Format a unit with typographic signs.

    >>> pretty_unit("(rad/s^2)/(N*m)")
    '(rad/s²)/(N·m)'
    """
    return unit.replace("*", "·").replace("^2", "²")


def frequency_label(has_rate: bool) -> str:
    """Return the label of a frequency axis; without a known rate, frequencies are relative to it."""
    return "frequency in Hz" if has_rate else "frequency / sampling rate"


def frequency_unit(has_rate: bool) -> str:
    """Return the unit of a natural frequency in a text."""
    return "Hz" if has_rate else "× the rate"


def in_db(values: ComplexArray | FloatArray) -> FloatArray:
    """Return 20 log10 |values|; NaN for zero, so that it is not drawn."""
    magnitude = np.abs(values)
    return 20 * np.log10(np.where(magnitude > 0, magnitude, np.nan))


def thinned(n: int) -> slice:
    """Return the slice of at most about `MAX_SAMPLES` of n samples that are drawn."""
    return slice(None, None, max(1, n // MAX_SAMPLES))


@dataclass(frozen=True)
class Curve:
    """Curve y (n,) over x (n,), a line or dots, with an interval band; looks: options of matplotlib."""

    x: ArrayLike
    y: ArrayLike
    label: str = ""
    color: str = MEASURED
    dots: bool = False
    band: tuple[FloatArray, FloatArray] | None = None
    band_label: str = ""
    looks: Mapping[str, Any] = field(default_factory=dict)

    def draw(self, axes: Axes) -> None:
        """Draw the curve, with its interval as a band, or as bars for dots."""
        looks = (DOTS | {"ms": 3.0} if self.dots else {"lw": 1.0}) | {"color": self.color, **self.looks}
        if self.band is not None and self.dots:
            y = np.asarray(self.y)
            ends = np.abs(np.stack([y - self.band[0], self.band[1] - y]))
            axes.errorbar(self.x, y, ends, label=plain_label(self.label), **looks)
            return
        if self.band is not None:
            text = plain_label(self.band_label)
            axes.fill_between(np.asarray(self.x), *self.band, facecolor=self.color, alpha=0.25, label=text)
        axes.plot(self.x, self.y, label=plain_label(self.label), **looks)


def band_95(y: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both ends of the 95 % intervals of y (n,) with standard deviations std (n,)."""
    return y - QUANTILE_95 * std, y + QUANTILE_95 * std


@dataclass(frozen=True)
class Cells:
    """Heat map: values (rows, columns), names of rows and columns, ends of the colour scale, and text of a value."""

    values: FloatArray
    rows: Sequence[str] = ()
    columns: Sequence[str] = ()
    ends: tuple[float, float] = (0.0, 100.0)
    text: Callable[[float], str] = "{:.0f}".format
    colors: str = "Blues"

    def draw(self, axes: Axes) -> None:
        """Draw cells from light to dark, NaN grey, with numbers up to `MAX_NUMBERED_CELLS`."""
        axes.set_facecolor(SHADE)
        low, high = self.ends
        axes.imshow(self.values, cmap=self.colors, vmin=low, vmax=high, interpolation="nearest", aspect="auto")
        across = max(map(len, self.columns), default=0) * len(self.columns) > 60
        set_names(axes.xaxis, self.columns, rotation=90 if across else 0, fontsize=SMALL)
        set_names(axes.yaxis, self.rows, fontsize=SMALL)
        for (row, column), value in np.ndenumerate(self.values):
            if np.isfinite(value) and self.values.size <= MAX_NUMBERED_CELLS:
                dark = (abs(value) if low < 0 else value - low) / (high - max(low, 0.0)) > MIN_DARK
                ink, size = "white" if dark else "black", SMALL if len(self.columns) < 13 else TINY
                axes.text(column, row, self.text(float(value)), ha="center", va="center", color=ink, fontsize=size)


@dataclass(frozen=True)
class Panel:
    """Panel of a figure: curves or a heat map, labels, and dashed horizontal lines at `marks`.

    frequency: lines (F,), whose ends limit a logarithmic x axis.  scale: of y.  span: shaded range of x.  columns:
    names at x = 0, 1, 2 ..., vertical if there are many.
    """

    curves: Sequence[Curve] = ()
    x: str = ""
    y: str = ""
    title: str = ""
    cells: Cells | None = None
    marks: Sequence[float] = ()
    frequency: FloatArray | None = None
    scale: str = "linear"
    x_ends: tuple[float, float] | None = None
    y_ends: tuple[float | None, float | None] | None = None
    span: tuple[float, float] | None = None
    columns: Sequence[str] = ()

    @property
    def height(self) -> float:
        """Height in inches; for a heat map by the number of rows."""
        return 1.8 if self.cells is None else 0.4 + 0.3 * len(self.cells.values)

    def draw(self, axes: Axes) -> None:
        """Draw curves, marks, cells and labels of the panel."""
        for curve in self.curves:
            curve.draw(axes)
        for mark in self.marks:
            axes.axhline(mark, color=TRUTH, ls="--")
        if self.span is not None:
            axes.axvspan(*self.span, facecolor=SHADE, zorder=0)
        if self.cells is not None:
            self.cells.draw(axes)
        else:
            axes.grid(color=GRID)
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
            axes.tick_params(labelsize=SMALL)
            axes.set_yscale(self.scale)
        if self.columns:
            set_names(axes.xaxis, self.columns, rotation=90 if len(self.columns) > 12 else 0)
        if self.frequency is not None:
            low, high = float(self.frequency[0]), float(self.frequency[-1])
            axes.set_xscale("log")
            axes.set_xlim(low / 1.05, high * 1.05)
            set_plain_ticks(axes.xaxis, round_ticks(low, high, 6))
        axes.set(**{k: v for k, v in (("xlim", self.x_ends), ("ylim", self.y_ends)) if v is not None})
        label(axes, self.x, self.y, self.title)


def matrix(
    title: str, rows: Sequence[Sequence[Panel | None]], heights: Sequence[float] = (), width: float = WIDE,
    left: float = 0.0, **options: Any,
) -> Figure:  # fmt: skip
    """Arrange panels in rows and columns under a title and one legend with each label once.

    heights: of the rows in inches, by default of their panels.  width: of the figure.  left: space for labels, by
    default for the names of rows.  options: of Figure.subplots, such as sharex.
    """
    rows = [row for row in rows if any(row)]
    heights = heights or [max(panel.height for panel in row if panel is not None) for row in rows]
    panels = [panel for row in rows for panel in row if panel is not None]
    texts = {text for panel in panels for curve in panel.curves for text in (curve.label, curve.band_label) if text}
    columns = max(1, int((width - 0.3) / (0.065 * max(map(len, texts), default=1) + 0.5)))
    below = max((len(name) for panel in panels for name in (panel.cells or panel).columns), default=0)
    names = [name for panel in panels if panel.cells for name in panel.cells.rows]
    left = left or max([0.85, *(0.4 + 0.075 * len(name) for name in names)])
    top = 0.4 + 0.17 * -(-len(texts) // columns) + 0.3 * any(panel.title for panel in panels)
    bottom = 0.55 + 0.06 * below
    # Space between rows for labels and titles.
    apart = 0.2 + 0.3 * any(panel.title for row in rows[1:] for panel in row if panel is not None)
    apart += 0.4 * any(panel.x for row in rows[:-1] for panel in row if panel is not None)
    beside, across = 0.8, max(map(len, rows))  # space between columns, number of columns
    panel_width = (width - 0.3 - left - (across - 1) * beside) / across
    tall, width = round(top + bottom + sum(heights) + (len(rows) - 1) * apart, 1), round(width, 1)  # whole pixels
    box = {"left": left / width, "right": 1 - 0.3 / width, "top": 1 - top / tall, "bottom": bottom / tall}
    figure = NotebookFigure(figsize=(width, tall))
    spaces = box | {
        "wspace": beside / panel_width,
        "hspace": apart * len(rows) / sum(heights),
        "height_ratios": heights,
    }
    axes = figure.subplots(len(rows), across, squeeze=False, gridspec_kw=spaces, **options)
    for row, row_axes in zip(rows, axes, strict=True):
        for panel, ax in zip([*row, *[None] * (len(row_axes) - len(row))], row_axes, strict=True):
            ax.set_axis_off() if panel is None else panel.draw(ax)
    figure.text(0.125 / width, 1 - 0.125 / tall, plain(title), fontsize=LARGE, fontweight="bold", va="top")
    entries: dict[str, Artist] = {}
    for ax in axes.flat:
        entries |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    if entries:
        figure.legend(
            list(entries.values()), list(entries), loc="upper left", bbox_to_anchor=(0.06 / width, 1 - 0.33 / tall),
            ncols=columns, frameon=False, fontsize=SMALL,
        )  # fmt: skip
    return figure


def in_columns(*panels: Sequence[Panel | None]) -> list[list[Panel | None]]:
    """Arrange panels in three columns; rows of the sequences alternate."""
    return [list(row[i : i + 3]) for i in range(0, len(panels[0]), 3) for row in panels]


def label(axes: Axes, x: str = "", y: str = "", title: str = "") -> None:
    """Set nonempty labels of the axes and the title of the panel."""
    for text, write in ((x, axes.set_xlabel), (y, axes.set_ylabel), (title, axes.set_title)):
        if text:
            write(plain(text), fontsize=NORMAL)


def set_names(axis: Axis, names: Sequence[str], **options: Any) -> None:
    """Set names at the ticks 0, 1, 2 ... with options of the text, such as rotation."""
    axis.set_ticks(range(len(names)), [plain(name) for name in names], **options)


def set_plain_ticks(axis: Axis, ticks: Sequence[float]) -> None:
    """Set plain numbers at the ticks and none elsewhere, on any scale."""
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_locator(NullLocator())


def round_ticks(low: float, high: float, max_count: int) -> list[float]:
    """Return round numbers on a logarithmic axis: 1-2-5 steps; decades if there are too many, even steps if too few.

    >>> round_ticks(2.1, 60.0, 6)
    [2.0, 5.0, 10.0, 20.0, 50.0]
    """
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    for digits in ((1, 2, 5), (1, 3), (1,)):
        ticks = [float(f"{digit}e{decade}") for decade in decades for digit in digits]
        ticks = [tick for tick in ticks if low / 1.05 <= tick <= high * 1.05]
        if len(ticks) <= max_count:
            break
    if len(ticks) >= 3:
        return ticks
    return [float(tick) for tick in MaxNLocator(min(max_count, 4)).tick_values(low, high) if low <= tick <= high]
