"""One look for all figures: colour-blind safe colours, panels, labels, legends, heat maps; text is never a formula."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from typing import Any, TypeAlias

import numpy as np
from matplotlib import rc_context, rcdefaults
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.escape import figure_label, figure_text
from elastid.base.statistics import QUANTILE_95

# Okabe and Ito (2008), by role.
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

# Font sizes in points.
TINY, SMALL, NORMAL, LARGE = 5.5, 7.5, 8.5, 10.0
# Width in inches of figures with many panels.
WIDE = 9.5
# Of measured values: points without lines and edges.
DOTS: dict[str, Any] = {"ls": "none", "marker": "o", "mew": 0}
# A heat map of more cells has no numbers in them; above this part of its scale a cell is dark.
MAX_NUMBERED_CELLS, MIN_DARK = 400, 0.6


@contextmanager
def own_style() -> Iterator[None]:
    """Matplotlib's own defaults for the figures that are drawn or saved inside, whatever a matplotlibrc says."""
    with rc_context():
        rcdefaults()
        yield


class ShownFigure(Figure):
    """A figure that a notebook shows as the value of a cell, whether pyplot is loaded or not."""

    @own_style()
    def savefig(self, fname: Any, *, transparent: bool | None = None, **options: Any) -> None:
        """As that of matplotlib, in the style of all figures."""
        super().savefig(fname, transparent=transparent, **options)

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


# Text with its dollar signs as they are, not as the start of a formula; and as a label that a legend shows.
plain, plain_label = figure_text, figure_label


def pretty_unit(unit: str) -> str:
    """A unit as people write it.

    >>> pretty_unit("(rad/s^2)/(N*m)")
    '(rad/s²)/(N·m)'
    """
    return unit.replace("*", "·").replace("^2", "²")


def frequency_label(rate_is_known: bool) -> str:
    """Axis label; without a sampling rate, frequencies are in units of it."""
    return "frequency in Hz" if rate_is_known else "frequency / sampling rate"


def frequency_unit(rate_is_known: bool) -> str:
    """The unit behind the number of a natural frequency in a figure or on paper."""
    return "Hz" if rate_is_known else "× the rate"


def in_db(values: ComplexArray | FloatArray) -> FloatArray:
    """20 log10 |values|, NaN for zero so that it is not drawn."""
    magnitude = np.abs(values)
    return np.asarray(20 * np.log10(np.where(magnitude > 0, magnitude, np.nan)))


def panels(
    rows: int,
    columns: int,
    size: tuple[float, float],
    margins: tuple[float, float, float, float] = (0.8, 0.25, 0.75, 0.5),
    spaces: tuple[float, float] = (0.2, 0.2),
    **options: Any,
) -> tuple[Figure, NDArray[Any]]:
    """A figure and its axes (rows, columns).

    size, margins (left, right, top, bottom): inches.  spaces: between columns and between rows, in panels.
    options: of Figure.subplots, such as sharex.
    """
    (width, height), (left, right, top, bottom) = size, margins
    box = {"left": left / width, "right": 1 - right / width, "top": 1 - top / height, "bottom": bottom / height}
    figure = ShownFigure(figsize=size)
    grid = box | {"wspace": spaces[0], "hspace": spaces[1]}
    return figure, figure.subplots(rows, columns, squeeze=False, gridspec_kw=grid, **options)


def add_title(figure: Figure, title: str) -> None:
    """The title at the top left, an eighth of an inch below the edge."""
    width, height = figure.get_size_inches()
    figure.text(0.125 / width, 1 - 0.125 / height, plain(title), fontsize=LARGE, fontweight="bold", va="top")


def add_legend(figure: Figure, axes: Iterable[Axes], markerscale: float = 1.0) -> None:
    """One legend for all axes, each label once, below the title."""
    entries: dict[str, Artist] = {}
    for panel in axes:
        handles, labels = panel.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    width, height = figure.get_size_inches()
    looks: dict[str, Any] = {"frameon": False, "fontsize": SMALL, "markerscale": markerscale, "loc": "upper center"}
    looks |= {"bbox_to_anchor": (0.5, 1 - 0.33 / height), "ncols": len(entries) if width > 8 else 3}
    figure.legend(list(entries.values()), list(entries), **looks)


def column(height: float, ratios: Sequence[float], space: float, sharex: bool = True) -> tuple[Figure, list[Axes]]:
    """A figure of axes one below the other, with heights in these ratios and a legend above them."""
    size, margins = (WIDE, height), (0.8, 0.25, 0.85, 0.55)
    figure, axes = panels(len(ratios), 1, size, margins, (0.0, space), sharex=sharex, height_ratios=ratios)
    return figure, axes[:, 0].tolist()


Curve: TypeAlias = tuple[FloatArray, str, float, str]


def plot_curves(axes: Axes, x: FloatArray, *curves: Curve, part: slice = slice(None)) -> None:
    """Curves over a part of one x: values, color, width in points and label of each."""
    for values, color, width, text in curves:
        axes.plot(x[part], values[part], color=color, lw=width, label=text)


def plot_intervals(axes: Axes, x: FloatArray, y: FloatArray, std: FloatArray, **looks: Any) -> None:
    """Points with their 95 % intervals."""
    axes.errorbar(x, y, QUANTILE_95 * std, **DOTS | {"elinewidth": 0.8} | looks)


def fill_band(
    axes: Axes, x: FloatArray, y: FloatArray, half: FloatArray, color: str, alpha: float, **looks: Any
) -> None:
    """A band of half-width `half` about y."""
    axes.fill_between(x, y - half, y + half, color=color, alpha=alpha, lw=0, **looks)


def finish(
    figure: Figure,
    title: str,
    axes: Iterable[Axes] = (),
    legend: Iterable[Axes] | None = None,
    margin: float | None = None,
    markerscale: float = 1.0,
) -> Figure:
    """The figure with a title, thin grids in `axes`, one legend for all of `legend`; margin: at the data's sides."""
    for panel in axes:
        lighten(panel)
        if margin is not None:
            panel.margins(x=margin)
    add_title(figure, title)
    if legend is not None:
        add_legend(figure, legend, markerscale)
    return figure


def label(axes: Axes, x: str = "", y: str = "", title: str = "") -> None:
    """Labels of the axes and the title of the panel, those that are not empty."""
    for text, write in ((x, axes.set_xlabel), (y, axes.set_ylabel), (title, axes.set_title)):
        if text:
            write(plain(text), fontsize=NORMAL)


def label_row(axes: Axes, text: str) -> None:
    """A name for a row of panels, on the right of its last one, read downwards."""
    axes.annotate(plain(text), (1.02, 0.5), xycoords="axes fraction", rotation=270, va="center", fontsize=NORMAL)


def label_figure(figure: Figure, x: str = "", y: str = "") -> None:
    """Labels that all panels share."""
    figure.supxlabel(plain(x), fontsize=NORMAL, y=0.09 / figure.get_figheight())
    figure.supylabel(plain(y), fontsize=NORMAL, x=0.015)


def set_names(axis: Axis, names: Sequence[str], **options: Any) -> None:
    """A name at 0, 1, 2 ...; options: of the text, such as rotation."""
    axis.set_ticks(range(len(names)), [plain(name) for name in names], **options)


def lighten(axes: Axes) -> None:
    """Thin grid, no box on the right and at the top, small labels."""
    axes.grid(True, linewidth=0.4, color=GRID)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=SMALL, length=2.5, width=0.6)


def plot_points(
    axes: Axes, x: FloatArray, values: FloatArray, above: BoolArray, shown: BoolArray | None = None
) -> None:
    """Measured values (F, ...) at x as points, grey where they are not above 2 sigma; of those that are `shown`."""
    size = 2.4 if len(x) <= 300 else 1.6
    looks = DOTS | {"ms": size, "zorder": 2}
    shown = np.ones(above.shape, bool) if shown is None else shown
    axes.plot(x[above & shown], values[above & shown], **looks, color=MEASURED, label="measured")
    if not above.all():
        below = ~above & shown
        axes.plot(x[below], values[below], **looks, color=WEAK, label="measured, below 2 sigma")


def heat_map(
    axes: Axes, values: FloatArray, norm: Normalize, text: Callable[[float], str], size: float = SMALL
) -> AxesImage:
    """Cells (rows, columns) from light to dark, grey where NaN, each with its number where they are few."""
    axes.set_facecolor(SHADE)
    image = axes.imshow(values, cmap="Blues", norm=norm, interpolation="nearest", aspect="auto")
    axes.tick_params(labelsize=SMALL, length=0)
    if values.size <= MAX_NUMBERED_CELLS:
        for (row, column), value in np.ndenumerate(values):
            if np.isfinite(value):
                color = "white" if norm(value) > MIN_DARK else "black"
                axes.text(column, row, text(value), ha="center", va="center", fontsize=size, color=color)
    return image


def set_log_frequency(axes: Axes, freq_hz: FloatArray, most: int = 6) -> None:
    """Logarithmic frequency axis over freq_hz with at most so many plain numbers on it."""
    low, high = float(freq_hz[0]), float(freq_hz[-1])
    axes.set_xscale("log")
    axes.set_xlim(low / 1.05, high * 1.05)
    set_plain_ticks(axes.xaxis, round_ticks(low, high, most))


def set_log_values(axes: Axes, low: float, high: float) -> None:
    """Logarithmic y axis with a few plain numbers, a little wider than low to high."""
    axes.set_yscale("log")
    axes.set_ylim(low / 1.3, high * 1.3)
    set_plain_ticks(axes.yaxis, round_ticks(low / 1.3, high * 1.3, 8))


def set_plain_ticks(axis: Axis, ticks: Sequence[float]) -> None:
    """Plain numbers at the ticks and none elsewhere, on any scale."""
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_locator(NullLocator())


def round_ticks(low: float, high: float, most: int) -> list[float]:
    """Round numbers on a logarithmic axis: 1-2-5 steps, decades where those are too many, even steps where too few.

    >>> round_ticks(2.1, 60.0, 6)
    [2.0, 5.0, 10.0, 20.0, 50.0]
    """
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    for digits in ((1, 2, 5), (1, 3), (1,)):
        ticks = [float(f"{digit}e{decade}") for decade in decades for digit in digits]
        ticks = [tick for tick in ticks if low / 1.05 <= tick <= high * 1.05]
        if len(ticks) <= most:
            break
    if len(ticks) >= 3:
        return ticks
    even = MaxNLocator(min(most, 4)).tick_values(low, high)
    return [round(float(tick), 12) for tick in even if low <= tick <= high]
