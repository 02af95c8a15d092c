"""The FRF matrix of one configuration, measured against fitted: magnitude with its noise levels, and phase."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.report.figures import style
from elastid.response import FrequencyResponse
from elastid.validation.residual_tests import above_2sigma, smoothed_std


def configuration_title(measured: FrequencyResponse, left_out: bool) -> str:
    """Name, angles of the driven joints, and whether the fit has seen it."""
    angles = ", ".join(f"{angle:.4g}°" for angle in np.degrees(measured.configuration.angles))
    return f"{measured.configuration.name} ({angles}), {'left out of the fit' if left_out else 'fitted'}"


def frf_magnitude(
    measured: FrequencyResponse, modelled: FrequencyResponse, title: str, std: FloatArray | None = None
) -> Figure:
    """|G| in dB of every element (n_y rows, n_u columns) on one y range.

    Measured as points, grey below 2 sigma; the model as a line; the standard deviation of the noise dashed, that of
    noise and nonlinear distortion together dotted; |Ghat - G| thin.  std (F, n_y, n_u): of the model, by what is not
    known of its parameters: a level of its own, and 2 of it as a band about the model.
    """
    above = above_2sigma(measured)
    f = measured.freq_hz
    Ghat_db, G_db, E_db = (style.in_db(G) for G in (measured.G, modelled.G, measured.G - modelled.G))
    levels = {
        label: (style.in_db(smoothed_std(measured, covariance)[0]), color, dashes)
        for covariance, label, color, dashes in (
            (measured.noise, "std of noise", style.NOISE, "--"),
            (measured.total, "std of noise + nonlinear", style.TOTAL, ":"),
        )
        if covariance is not None
    }

    band = None if std is None else _band_db(modelled.G, std)
    if std is not None:
        levels["std of the model"] = (style.in_db(std), style.START, "-.")

    def draw(axes: Axes, i: int, j: int) -> None:
        _points(axes, f, Ghat_db[:, i, j], above[:, i, j])
        if band is not None:
            axes.fill_between(f, band[0][:, i, j], band[1][:, i, j], color=style.FITTED, alpha=0.25, lw=0)
        axes.plot(f, G_db[:, i, j], color=style.FITTED, lw=1.1, zorder=3, label="fitted model")
        axes.plot(f, E_db[:, i, j], color=style.RESIDUAL, lw=0.5, zorder=1, label="|measured − model|")
        for label, (std_db, color, dashes) in levels.items():
            axes.plot(f, std_db[:, i, j], color=color, lw=1.0, ls=dashes, zorder=1.5, label=label)

    figure, corner = _matrix(measured, title, draw)
    low, high = _db_range(np.where(above, Ghat_db, np.nan), np.where(above, G_db, np.nan), levels.values())
    style.db_ticks(corner, low, high, most=6 if len(measured.outputs) <= 3 else 4)
    figure.supylabel(f"|G| in dB re 1 {style.pretty_unit(measured.unit)}", fontsize=style.NORMAL, x=0.015)
    return figure


def _band_db(G: ComplexArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """20 log10 of |G| -+ 2 std, not below a thousandth of |G|."""
    magnitude = np.abs(G)
    low = np.maximum(magnitude - 2 * std, 1e-3 * magnitude)
    return style.in_db(low), style.in_db(magnitude + 2 * std)


def frf_phase(measured: FrequencyResponse, modelled: FrequencyResponse, title: str) -> Figure:
    """Phase of G in degrees of every element, wrapped to (-180, 180]; the model's line is broken where it wraps."""
    above = above_2sigma(measured)
    f = measured.freq_hz

    def draw(axes: Axes, i: int, j: int) -> None:
        _points(axes, f, np.degrees(np.angle(measured.G[:, i, j])), above[:, i, j])
        phase = np.degrees(np.angle(modelled.G[:, i, j]))
        wraps = np.flatnonzero(np.abs(np.diff(phase)) > 180) + 1
        axes.plot(
            np.insert(f, wraps, np.nan),
            np.insert(phase, wraps, np.nan),
            color=style.FITTED,
            lw=1.1,
            label="fitted model",
        )

    figure, corner = _matrix(measured, title, draw)
    corner.set_ylim(-190, 190)
    corner.yaxis.set_major_locator(MultipleLocator(90 if len(measured.outputs) <= 3 else 180))
    figure.supylabel("phase of G in degrees", fontsize=style.NORMAL, x=0.015)
    return figure


def _points(axes: Axes, f: FloatArray, values: FloatArray, above: BoolArray) -> None:
    size = 2.4 if len(f) <= 300 else 1.6
    for keep, color, label in ((above, style.MEASURED, "measured"), (~above, style.WEAK, "measured, below 2 sigma")):
        if keep.any() or label == "measured":
            axes.plot(f[keep], values[keep], ls="none", marker="o", ms=size, mew=0, zorder=2, color=color, label=label)


def _matrix(response: FrequencyResponse, title: str, draw: Callable[[Axes, int, int], None]) -> tuple[Figure, Axes]:
    """One panel for each element, inputs across, outputs down, axes shared, one legend; and the corner panel."""
    n_y, n_u = len(response.outputs), len(response.inputs)
    figure, panels = _panels(n_y, n_u)
    for i, output in enumerate(response.outputs):
        for j in range(n_u):
            draw(panels[i, j], i, j)
            style.light(panels[i, j])
        where = style.plain(f"{response.quantity} at {output}" if n_y <= 3 else output)
        panels[i, -1].annotate(
            where, (1.02, 0.5), xycoords="axes fraction", rotation=270, va="center", fontsize=style.NORMAL
        )
    for j, source in enumerate(response.inputs):
        panels[0, j].set_title(style.plain(f"torque at {source}"), fontsize=style.NORMAL)
    corner: Axes = panels[0, 0]
    style.log_frequency(corner, response.freq_hz, most=6 if n_u <= 3 else 3)
    label = style.frequency_label(response.rate_is_known)
    figure.supxlabel(label, fontsize=style.NORMAL, y=0.09 / figure.get_figheight())
    style.titled(figure, title)
    style.legend_above(figure, panels.flat, markerscale=2.0)
    return figure, corner


def _panels(n_y: int, n_u: int) -> tuple[Figure, Any]:
    """An empty figure with a grid (n_y, n_u) of axes; sizes in inches, so that any matrix has the same margins."""
    panel_width, panel_height = float(np.clip(8.6 / n_u, 1.5, 6.0)), float(np.clip(5.4 / n_y, 1.1, 3.2))
    left, right, top, bottom = 0.75, 0.3, 1.0, 0.55
    width, height = left + n_u * panel_width + right, top + n_y * panel_height + bottom
    figure = Figure(figsize=(width, height))
    grid = {"left": left / width, "right": 1 - right / width, "top": 1 - top / height, "bottom": bottom / height}
    spaces = {"wspace": 0.06, "hspace": 0.09}
    return figure, figure.subplots(n_y, n_u, sharex=True, sharey=True, squeeze=False, gridspec_kw=grid | spaces)


def _db_range(
    Ghat_db: FloatArray, G_db: FloatArray, levels: Iterable[tuple[FloatArray, str, str]]
) -> tuple[float, float]:
    """One range for the matrix: the judged points, the model there, and the noise down to 30 dB below them."""
    shown = np.concatenate([Ghat_db.ravel(), G_db.ravel()])
    shown = shown[np.isfinite(shown)]
    if shown.size == 0:
        return -100.0, 0.0
    high, low = float(shown.max()), float(np.percentile(shown, 1))
    lowest = low - 30
    for std_db, _, _ in levels:
        if np.isfinite(std_db).any():
            low = min(low, float(np.nanpercentile(std_db, 10)) - 10)
    low = max(low, lowest, high - 120)
    margin = 0.05 * (high - low) + 1
    return low - margin, high + margin
