"""The plan of an experiment: its information, and its use of the robot's limits."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.design.forecast import QUANTITIES, Forecast, LimitUse
from elastid.report.figures import style


def information(forecast: Forecast) -> Figure:
    """Shares of the expected information: by configuration and frequency (left), by configuration and parameter."""
    names = forecast.configurations
    size = style.WIDE, max(1.5 + 0.3 * len(names), 3.2)
    options = {"sharey": True, "width_ratios": (1.15, 1)}
    figure, ((left, right),) = style.panels(1, 2, size, (0.95, 0.1, 0.62, 0.75), (0.2, 0.0), **options)
    edges = np.geomspace(forecast.freq_hz[0] / 1.01, forecast.freq_hz[-1] * 1.01, 61)
    by_band = 100 * _in_bands(forecast.freq_hz, forecast.share.mean(axis=2), edges)
    left.pcolormesh(edges, np.arange(len(names) + 1) - 0.5, by_band, cmap="Blues", vmin=0)
    left.tick_params(labelsize=style.SMALL, length=0)
    style.set_log_frequency(left, forecast.freq_hz)
    style.label(left, x="frequency in Hz", title="share of all information")
    by_parameter = 100 * forecast.share.sum(axis=1)
    style.heat_map(right, by_parameter, Normalize(0, 100), lambda value: f"{value:.0f}" if value >= 0.5 else "", 6)
    style.set_names(right.xaxis, forecast.parameters, rotation=90)
    style.set_names(left.yaxis, names)
    right.tick_params(labelleft=False)
    style.label(right, title="share of the information on a parameter in %")
    return style.finish(figure, "Expected information by configuration")


def _in_bands(freq_hz: FloatArray, share: FloatArray, edges: FloatArray) -> FloatArray:
    """Shares (Q, F) summed within the bands (Q, 60), NaN where there is no line."""
    band = np.clip(np.searchsorted(edges, freq_hz) - 1, 0, len(edges) - 2)
    total = np.zeros((len(share), len(edges) - 1))
    np.add.at(total.T, band, share.T)
    total[:, np.bincount(band, minlength=len(edges) - 1) == 0] = np.nan
    return total


def limit_use(use: LimitUse) -> Figure:
    """Peaks in % of their limits: configurations (rows) by motors (columns), a panel for each quantity limited."""
    kinds = np.flatnonzero(np.isfinite(use.limit).any(axis=(0, 2)))
    motors = [name.removeprefix("motor ") for name in use.inputs]
    size = style.WIDE, 1.15 + max(0.28 * len(use.configurations), 0.8)
    figure, (across,) = style.panels(1, len(kinds), size, (1.15, 0.1, 0.6, 0.45), (0.06, 0.0))
    for axes, kind in zip(across, kinds, strict=True):
        percent = 100 * np.where(np.isfinite(use.limit[:, kind]), use.used[:, kind], np.nan)
        style.heat_map(axes, percent, Normalize(0, 130), lambda value: f"{value:.0f}")
        style.set_names(axes.xaxis, motors)
        style.set_names(axes.yaxis, use.configurations if axes is across[0] else ())
        style.label(axes, x="motor", title=f"{QUANTITIES[kind]} in % of its limit")
    return style.finish(figure, f"Peaks against limits ({use.margin:.0%} of each kept free)")
