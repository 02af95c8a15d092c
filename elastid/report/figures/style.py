"""One look for all figures: colours that the colour-blind can tell apart, axes in Hz, text that is never a formula."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator, MultipleLocator, NullLocator, StrMethodFormatter

from elastid.base.arrays import ComplexArray, FloatArray

# Okabe and Ito (2008), by the part they play.
MEASURED = "#0072B2"
FITTED = "#D55E00"
NOISE = "#009E73"
TOTAL = "#CC79A7"
RESIDUAL = "#56B4E9"
START = "#E69F00"
TRUTH = "#000000"
WEAK = "#B8B8B8"
SERIES = (MEASURED, FITTED, NOISE, TOTAL, START, RESIDUAL)

SMALL, NORMAL, LARGE = 7.5, 8.5, 10.0


def plain(text: str) -> str:
    """Text with its dollar signs as they are, not as the start of a formula."""
    return text.replace("$", r"\$")


def pretty_unit(unit: str) -> str:
    """A unit as people write it.

    >>> pretty_unit("(rad/s^2)/(N*m)")
    '(rad/s²)/(N·m)'
    """
    return unit.replace("*", "·").replace("^2", "²")


def frequency_label(rate_is_known: bool) -> str:
    """Axis label; without a sampling rate, frequencies are in units of it."""
    return "frequency in Hz" if rate_is_known else "frequency / sampling rate"


def in_db(values: ComplexArray | FloatArray) -> FloatArray:
    """20 log10 |values|, NaN for zero so that it is not drawn."""
    magnitude = np.abs(values)
    db: FloatArray = 20 * np.log10(np.where(magnitude > 0, magnitude, np.nan))
    return db


def titled(figure: Figure, title: str) -> None:
    """The title at the top left, an eighth of an inch below the edge."""
    width, height = figure.get_size_inches()
    figure.text(0.125 / width, 1 - 0.125 / height, plain(title), fontsize=LARGE, fontweight="bold", va="top")


def legend_above(figure: Figure, axes: Iterable[Axes], markerscale: float = 1.0) -> None:
    """One legend for all axes, each label once, below the title."""
    entries: dict[str, Artist] = {}
    for one in axes:
        handles, labels = one.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    width, height = figure.get_size_inches()
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="upper center",
        bbox_to_anchor=(0.5, 1 - 0.33 / height),
        ncols=len(entries) if width > 8 else 3,
        frameon=False,
        fontsize=SMALL,
        markerscale=markerscale,
    )


def light(axes: Axes) -> None:
    """Thin grid, no box on the right and at the top, small labels."""
    axes.grid(True, linewidth=0.4, color="#DDDDDD")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=SMALL, length=2.5, width=0.6)


def log_frequency(axes: Axes, freq_hz: FloatArray, most: int = 6) -> None:
    """Logarithmic frequency axis over freq_hz with at most so many plain numbers on it."""
    low, high = float(freq_hz[0]), float(freq_hz[-1])
    axes.set_xscale("log")
    axes.set_xlim(low / 1.05, high * 1.05)
    plain_ticks(axes.xaxis, round_ticks(low, high, most))


def plain_ticks(axis: Axis, ticks: Sequence[float]) -> None:
    """Plain numbers where ticks are asked for and none elsewhere, on whatever scale."""
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


def db_ticks(axes: Axes, low: float, high: float, most: int) -> None:
    """Steps of 5, 10, 20, 40 dB, at most so many."""
    step = next((step for step in (5, 10, 20, 40) if (high - low) / step <= most), 80)
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(MultipleLocator(step))
