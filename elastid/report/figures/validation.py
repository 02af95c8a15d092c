"""Errors of the model on left-out data, and of the torque by part."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.report.figures import style
from elastid.validation.twin import (
    DRY,
    ELASTICITY,
    FRICTION,
    GRAVITY,
    INERTIA,
    MIN_POWER_SHARE,
    RIGID_BODY,
    VISCOUS,
    TorqueBalance,
)

# Samples of a torque that are drawn.
MOST_SAMPLES = 3000
COLORS = {
    INERTIA: style.TOTAL, RIGID_BODY: style.TOTAL, GRAVITY: style.MEASURED, VISCOUS: style.NOISE, DRY: style.START,
    ELASTICITY: style.TRUTH,
}  # fmt: skip
TORQUE_CAPTION = (
    "torque of the log and of the model for the measured motion; the model's parts; by octave what the model leaves of "
    "the mean square, with friction and without, and the share of the torque's power that lies there."
)


def torque_balance_figure(balance: TorqueBalance) -> Figure:
    """Torque measured and modelled; its parts; the share left by octave."""
    figure, panels = style.column(7.4, (1, 1, 1), 0.4, sharex=False)
    total, parts, left = panels
    part = slice(None, None, max(1, len(balance.measured) // MOST_SAMPLES))
    t = np.arange(len(balance.measured)) / balance.rate_hz
    modelled = balance.measured - balance.residual
    curves: list[style.Curve] = [
        (balance.measured, style.MEASURED, 1.2, "measured"),
        (modelled, style.FITTED, 0.8, "model"),
        (balance.residual, style.RESIDUAL, 0.6, "measured − model"),
    ]
    if any(name in FRICTION for name in balance.parts):
        curves.insert(2, (modelled - balance.part(FRICTION), style.WEAK, 0.8, "model without friction"))
    style.plot_curves(total, t, *curves, part=part)
    for name, torque in zip(balance.parts, balance.torques, strict=True):
        parts.plot(t[part], torque[part], color=COLORS[name], lw=0.9, label=name)
    _draw_bands(left, balance)
    for axes in (total, parts):
        axes.margins(x=0.01)
        style.label(axes, y=style.pretty_unit(balance.unit))
    style.label(parts, "time in s" if balance.rate_is_known else "time in samples")
    title = f"{balance.place}, {balance.log}: {100 * balance.left:.2g} % of the mean square is left"
    style.finish(figure, title, panels, [total])
    for axes in (parts, left):
        axes.legend(fontsize=style.SMALL, frameon=False, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 0.98))
    return figure


def octaves_figure(balances: Sequence[TorqueBalance], own: Sequence[TorqueBalance] = ()) -> Figure:
    """Rms of the torque left over its own rms, by axis and octave; own: by a regression of these logs, in brackets."""
    edges = sorted({band.high_hz for balance in balances for band in balance.bands})
    figure, ((axes,),) = style.panels(1, 1, (style.WIDE, 1.3 + 0.3 * len(balances)), (1.8, 0.25, 0.5, 0.55), (0.0, 0.0))
    left = np.full((len(balances), len(edges)), np.nan)
    regressed = {(o.place, o.log, band.high_hz): math.sqrt(band.left) for o in own for band in o.bands}
    for i, balance in enumerate(balances):
        for band in (band for band in balance.bands if band.power >= MIN_POWER_SHARE):
            k = edges.index(band.high_hz)
            left[i, k] = math.sqrt(band.left)
            compared = regressed.get((balance.place, balance.log, band.high_hz))
            text = f"{100 * left[i, k]:.0f}" + ("" if compared is None else f" ({100 * compared:.0f})")
            axes.text(k, i, text, ha="center", va="center", fontsize=style.SMALL)
    axes.imshow(np.minimum(left, 1.0), cmap="Oranges", vmin=0.0, vmax=1.2, aspect="auto")
    axes.set_xticks(range(len(edges)), [f"{edge:.3g}" for edge in edges])
    style.set_names(axes.yaxis, [f"{balance.place}, {balance.log}" for balance in balances])
    known = all(balance.rate_is_known for balance in balances)
    style.label(axes, f"octave below {'Hz' if known else 'sampling rates'}")
    title = "Torque left, % of its rms" + (" (by a regression of these logs)" if own else "")
    return style.finish(figure, title)


def _draw_bands(axes: Axes, balance: TorqueBalance) -> None:
    bands = balance.bands
    x, names = np.arange(len(bands)), [f"{band.low_hz:.3g}–{band.high_hz:.3g}" for band in bands]
    for offset, values, color, name in (
        (-0.27, [band.left for band in bands], style.RESIDUAL, "left"),
        (0.0, [band.left_without_friction for band in bands], style.WEAK, "left without friction"),
        (0.27, [band.power for band in bands], style.MEASURED, "share of the torque's power"),
    ):
        axes.bar(x + offset, 100 * np.maximum(values, 1e-7), 0.25, color=color, label=name)
    axes.set_yscale("log")
    axes.set_xticks(x, names)
    style.label(axes, style.frequency_label(balance.rate_is_known), "%")
