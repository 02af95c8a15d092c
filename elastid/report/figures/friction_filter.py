"""A filter over time: what it follows with 95 % bands, and whether its innovations are what it expects."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.friction_study.follow import FollowedFriction
from elastid.friction_study.innovations import NIS_BAND
from elastid.report.figures import style

MINUTE = 60.0
# Longest time in s that is shown in seconds.
SHORT = 300.0
NAMES = {
    "Fc": "Coulomb friction",
    "f": "viscous friction",
    "f+": "viscous friction +",
    "f-": "viscous friction \N{MINUS SIGN}",
    "offset": "offset",
}


def friction_filter(found: FollowedFriction) -> Figure:
    """Followed numbers, NIS with its band, and autocorrelation of the innovations."""
    rows = len(found.names) + 2
    ratios = (*(1.3 for _ in found.names), 0.9, 1.0)
    figure, panels = style.panels(
        rows, 1, (style.WIDE, 1.6 * rows), (0.8, 0.25, 0.85, 0.55), (0.0, 0.42), height_ratios=ratios
    )
    is_short = float(found.time_s[-1]) <= SHORT
    time, unit = (found.time_s, "s") if is_short else (found.time_s / MINUTE, "min")
    for i, name in enumerate(found.names):
        _draw_number(panels[i, 0], found, i, time)
        style.label(panels[i, 0], y=f"{NAMES[name]}\nin {_unit(name, found.slides)}")
    nis, correlation = panels[-2, 0], panels[-1, 0]
    nis.plot(time, found.nis, color=style.TOTAL, lw=0.8, label="mean NIS since the point before")
    nis.axhspan(*NIS_BAND, color=style.FITTED, alpha=0.15, lw=0, label="NIS of an honest filter")
    nis.set_yscale("log")
    style.label(nis, f"time in {unit}", "NIS")
    rho = found.consistency.autocorrelation
    correlation.stem(np.arange(1, len(rho)), rho[1:], linefmt="-", markerfmt=".", basefmt=" ")
    reach = 1.96 / np.sqrt(max(found.consistency.n_eff, 1.0))
    correlation.axhspan(-reach, reach, color=style.FITTED, alpha=0.15, lw=0)
    style.label(correlation, "lag in samples", "autocorrelation")
    for axes in panels[:, 0]:
        style.lighten(axes)
        axes.margins(x=0.01)
    style.add_title(figure, f"joint {found.joint}: friction followed, mean NIS {found.consistency.nis:.2f}")
    style.add_legend(figure, panels[:, 0])
    return figure


def _draw_number(axes: Axes, found: FollowedFriction, i: int, time: np.ndarray) -> None:
    """The band, the estimate, and where the motion tells nothing."""
    axes.fill_between(time, found.low[:, i], found.high[:, i], color=style.FITTED, alpha=0.2, lw=0, label="95 % band")
    axes.plot(time, found.values[:, i], color=style.FITTED, lw=1.2, label="followed")
    held = np.where(found.unknown[:, i], found.values[:, i], np.nan)
    if np.isfinite(held).any():
        axes.plot(time, held, color=style.WEAK, lw=2.0, label="held: the motion tells nothing of it")


def _unit(name: str, slides: bool) -> str:
    torque = "N" if slides else "N*m"
    return {"Fc": torque, "offset": torque}.get(name, "N*s/m" if slides else "N*m*s/rad")
