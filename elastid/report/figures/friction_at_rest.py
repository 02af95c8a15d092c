"""Stiffness and damping of the bristles at rest over the torque's amplitude, extrapolated to none."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.friction_study.at_rest import AtRest
from elastid.report.figures import style
from elastid.report.figures.friction_curve import Z_95, units


def friction_at_rest(place: str, found: AtRest, slides: bool = False) -> Figure:
    """sigma_0 and sigma_1 with 95 % intervals, at each amplitude and extrapolated to none."""
    figure, ((spring, damper),) = style.panels(1, 2, (style.WIDE, 3.9), (0.9, 0.25, 0.85, 0.55), (0.28, 0.0))
    torque = units(slides)[1]
    amplitude = np.array([point.torque for point in found.points])
    std = np.sqrt(np.diag(found.covariance))
    unit = "N/m" if slides else "N·m/rad"
    for axes, values, errors, limit, of_limit in (
        (spring, [p.stiffness for p in found.points], [p.stiffness_std for p in found.points], found.sigma_0, std[0]),
        (damper, [p.damping for p in found.points], [p.damping_std for p in found.points], found.sigma_1, std[1]),
    ):
        _draw(axes, amplitude, np.array(values), np.array(errors), (limit, float(of_limit)))
    style.label(spring, f"amplitude in {torque}", f"stiffness σ₀ in {unit}")
    style.label(damper, f"amplitude in {torque}", f"damping σ₁ in {unit.replace('/', '·s/')}")
    words = ", falling with the logarithm of the amplitude as of Maxwell slip" if found.falls else ""
    style.add_title(figure, f"{place}: bristles at rest{words}")
    style.add_legend(figure, (spring, damper))
    return figure


def _draw(axes: Axes, amplitude: FloatArray, values: FloatArray, std: FloatArray, limit: tuple[float, float]) -> None:
    """One number over amplitude; limit: at amplitude 0, and its std."""
    looks: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 4, "mew": 0, "elinewidth": 1, "capsize": 3}
    order = np.argsort(amplitude)
    x, y = np.append(0.0, amplitude[order]), np.append(limit[0], values[order])
    axes.plot(x, y, color=style.WEAK, lw=0.9, ls="--", zorder=1)
    axes.errorbar(amplitude, values, Z_95 * std, **looks, color=style.MEASURED, label="measured")
    axes.errorbar([0.0], limit[:1], Z_95 * limit[1], **looks, color=style.FITTED, label="extrapolated")
    axes.margins(x=0.06)
    style.lighten(axes)
