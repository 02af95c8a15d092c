"""Shapers over frequency: their residual vibration, the modes of the region, and their cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from elastid.report.figures import style
from elastid.use.command.shapers import TOLERATED, RegionModes, Shaper, residual


def shaper_figure(name: str, modes: RegionModes, shapers: Sequence[Shaper]) -> Figure:
    """Residual vibration in %, at the median damping ratio, and below it the modes with their excitation."""
    figure, axes = style.column(5.2, (1.6, 1.0), 0.12)
    vibration, region = axes
    freq_hz = np.linspace(0.5 * modes.freq_hz.min(), 1.2 * modes.freq_hz.max(), 400)
    zeta = np.full(400, np.median(modes.zeta))
    for own, color in zip(shapers, style.SERIES, strict=False):
        text = f"{own.name}: {100 * own.worst:.2g} %, {1e3 * own.delay_s:.0f} ms"
        V = residual(own.amplitude, own.time_s, freq_hz, zeta)
        vibration.plot(freq_hz, 100 * V, color=color, lw=1.4, label=style.plain(text))
    vibration.axhline(100 * TOLERATED, color=style.TRUTH, lw=0.8, ls="--")
    style.label(vibration, y="residual vibration in %")
    region.vlines(modes.freq_hz, 0, modes.share, color=style.MEASURED, lw=1.0)
    style.label(region, x="frequency in Hz", y="excitation of the modes")
    return style.finish(figure, f"{name}: shapers, worst vibration and delay", axes, [vibration], 0.0)
