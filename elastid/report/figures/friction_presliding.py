"""Friction before it slides: hysteresis loops, and stiffness and damping of the bristles at rest."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import BoolArray, FloatArray
from elastid.friction_study.at_rest import AtRest
from elastid.friction_study.presliding import Elements, Loops, Presliding
from elastid.report.figures import style
from elastid.report.figures.friction_curve import units


def friction_loops(loops: Loops, presliding: Presliding, slides: bool = False) -> Figure:
    """Torque over displacement, measured and replayed; torque of each threshold; errors by number of elements."""
    options = {"width_ratios": (1.5, 1.1, 0.9)}
    margins = 0.75, 0.25, 1.05, 0.55
    figure, (panels,) = style.panels(1, 3, (style.WIDE, 4.1), margins, (0.3, 0.0), **options)
    loop, spectrum, errors = panels
    torque, length = ("N", "mm") if slides else ("N·m", "mrad")
    _draw_loops(loop, loops, presliding)
    style.label(loop, f"displacement in {length}", f"{'force' if slides else 'torque'} in {torque}", "loops")
    few = len(presliding.few.stiffness)
    name = f"spectrum of {len(presliding.spectrum.stiffness)} thresholds"
    _draw_spectrum(spectrum, presliding.spectrum, style.MEASURED, 3.0, name)
    _draw_spectrum(spectrum, presliding.few, style.FITTED, 5.0, f"{few} element{'s' if few > 1 else ''}")
    spectrum.set_ylim(bottom=0)
    style.set_log_frequency(spectrum, 1e3 * presliding.spectrum.threshold[[0, -1]], 5)
    style.label(spectrum, f"threshold D in {length}", f"k D in {torque}", "spectrum")
    _draw_errors(errors, presliding)
    break_away = f"{presliding.spectrum.break_away:.3g} {torque}"
    style.finish(figure, f"{loops.place}: presliding, elements of {break_away} in all", panels, panels)
    return figure


def _draw_loops(axes: Axes, loops: Loops, presliding: Presliding) -> None:
    used: BoolArray = np.arange(len(loops.position)) >= loops.settled
    q = presliding.position
    x = 1e3 * (q - q[used].mean())
    axes.plot(x[used], loops.torque[used], color=style.MEASURED, lw=0.7, alpha=0.7, label="measured")
    axes.plot(x[used], presliding.few.torque(q)[used], color=style.FITTED, lw=0.8, label="replayed")


def _draw_spectrum(axes: Axes, elements: Elements, color: str, size: float, name: str) -> None:
    shares = elements.stiffness * elements.threshold
    used = shares > 1e-4 * elements.break_away
    x = 1e3 * elements.threshold[used]
    axes.vlines(x, 0, shares[used], color=color, lw=1.0)
    axes.plot(x, shares[used], **style.DOTS, ms=size, color=color, label=name)


def _draw_errors(axes: Axes, presliding: Presliding) -> None:
    """Cross-validated rms error, in percent of break-away."""
    scale = 100 / presliding.spectrum.break_away
    few = len(presliding.few.stiffness)
    counts = np.arange(1, len(presliding.errors) + 1) if len(presliding.errors) > 1 else np.array([few])
    text = "error of unseen parts"
    axes.plot(counts, scale * presliding.errors, color=style.NOISE, marker="o", ms=3.5, lw=0.8, label=text)
    chosen = presliding.errors[np.flatnonzero(counts == few)]
    axes.plot([few], scale * chosen, ls="none", marker="o", ms=7, mfc="none", color=style.FITTED)
    axes.axhline(scale * presliding.spectrum_error, color=style.MEASURED, lw=0.8, ls="--", label="of the spectrum")
    axes.set_xticks(counts)
    axes.set_ylim(bottom=0)
    style.label(axes, "elements", "% of break-away", "cross-validation")


def friction_at_rest(place: str, at_rest: AtRest, slides: bool = False) -> Figure:
    """sigma_0 and sigma_1 with 95 % intervals, at each amplitude and extrapolated to none."""
    figure, (panels,) = style.panels(1, 2, (style.WIDE, 3.9), (0.9, 0.25, 0.85, 0.55), (0.28, 0.0))
    spring, damper = panels
    torque = units(slides)[1]
    amplitude = np.array([point.torque for point in at_rest.points])
    std = np.sqrt(np.diag(at_rest.covariance))
    unit = "N/m" if slides else "N·m/rad"
    for axes, values, errors, limit, of_limit in (
        (
            spring,
            [p.stiffness for p in at_rest.points],
            [p.stiffness_std for p in at_rest.points],
            at_rest.sigma_0,
            std[0],
        ),
        (damper, [p.damping for p in at_rest.points], [p.damping_std for p in at_rest.points], at_rest.sigma_1, std[1]),
    ):
        _draw(axes, amplitude, np.array(values), np.array(errors), (limit, float(of_limit)))
    style.label(spring, f"amplitude in {torque}", f"stiffness σ₀ in {unit}")
    style.label(damper, f"amplitude in {torque}", f"damping σ₁ in {unit.replace('/', '·s/')}")
    words = ", falling with the logarithm of the amplitude as of Maxwell slip" if at_rest.falls else ""
    style.finish(figure, f"{place}: bristles at rest{words}", panels, panels)
    return figure


def _draw(axes: Axes, amplitude: FloatArray, values: FloatArray, std: FloatArray, limit: tuple[float, float]) -> None:
    """One number over amplitude; limit: at amplitude 0, and its std."""
    looks: dict[str, Any] = {"ms": 4, "elinewidth": 1, "capsize": 3}
    order = np.argsort(amplitude)
    x, y = np.append(0.0, amplitude[order]), np.append(limit[0], values[order])
    axes.plot(x, y, color=style.WEAK, lw=0.9, ls="--", zorder=1)
    style.plot_intervals(axes, amplitude, values, std, **looks, color=style.MEASURED, label="measured")
    style.plot_intervals(
        axes, np.zeros(1), *np.array(limit)[:, None], **looks, color=style.FITTED, label="extrapolated"
    )
    axes.margins(x=0.06)
