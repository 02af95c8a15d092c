"""Friction from any motion of an axis: torque over velocity without inertia and gravity, and the torque over time."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.friction_study.least_squares import Regression
from elastid.friction_study.motion import MotionFriction, MotionSamples, motion_samples
from elastid.friction_study.plateaus import distinct_speeds
from elastid.report.figures import style
from elastid.report.figures.friction_curve import POINTS, Z_95, units

# Samples that are drawn.
MOST_SAMPLES = 6000


def friction_motion(found: MotionFriction) -> Figure:
    """Torque less inertia and gravity over velocity, and the regression with its 95 % band; torque over time.

    Dotted lines: speeds that the motion dwells at.  Dashed: with both directions alike and an offset, where the chosen
    regression has each its own.
    """
    samples, slides = motion_samples(found), found.motion.slides
    options = {"height_ratios": (1.7, 1)}
    figure, ((curve,), (over_time,)) = style.panels(
        2, 1, (style.WIDE, 6.0), (0.8, 0.25, 0.85, 0.55), (0.0, 0.28), **options
    )
    speed, torque = units(slides)
    quantity = "force" if slides else "torque"
    _draw_curve(curve, found, samples)
    style.label(curve, f"velocity in {speed}", f"friction in {torque}")
    step = max(1, len(samples.time_s) // MOST_SAMPLES)
    for values, color, width, name in (
        (samples.torque, style.MEASURED, 1.0, "measured"),
        (samples.regressed, style.FITTED, 0.8, "regression"),
        (samples.torque - samples.regressed, style.RESIDUAL, 0.6, "measured − regression"),
    ):
        over_time.plot(samples.time_s[::step], values[::step], color=color, lw=width, label=name)
    style.label(over_time, "time in s", f"{quantity} in {torque}")
    for axes in (curve, over_time):
        style.lighten(axes)
        axes.margins(x=0.01)
    error = f"{100 * found.chosen.relative_error:.3g} % of the {quantity} left"
    style.add_title(figure, f"{found.motion.place}: friction over velocity, {error}")
    style.add_legend(figure, (curve, over_time))
    return figure


def sliding(numbers: Regression, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Friction (n,) at velocities other than 0, both directions' numbers included, and its std."""
    columns = {
        "coulomb": np.sign(v),
        "viscous": v,
        "directions.coulomb": np.ones_like(v),
        "directions.viscous": np.abs(v),
    }
    own = [name for name in columns if name in numbers.names]
    A = np.stack([columns[name] for name in own], axis=1)
    chosen = [numbers.names.index(name) for name in own]
    covariance = numbers.covariance[np.ix_(chosen, chosen)]
    return A @ numbers.values[chosen], np.sqrt(np.einsum("ni,ij,nj->n", A, covariance, A))


def _draw_curve(axes: Axes, found: MotionFriction, samples: MotionSamples) -> None:
    step = max(1, len(samples.velocity) // MOST_SAMPLES)
    looks: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 1.5, "mew": 0, "alpha": 0.5}
    axes.plot(samples.velocity[::step], samples.friction[::step], **looks, color=style.MEASURED)
    for sign in (1.0, -1.0):
        for speed in distinct_speeds([plateau for plateau in found.plateaus if sign * plateau.velocity > 0]):
            axes.axvline(sign * speed, color=style.NOISE, lw=0.8, ls=":", label="speeds dwelt at")
    for low, high in ((float(samples.velocity.min()), 0.0), (0.0, float(samples.velocity.max()))):
        v = np.linspace(low, high, POINTS)[1 if low == 0 else 0 : -1 if high == 0 else None]
        if found.are_apart:
            offset = found.alike["offset"] if "offset" in found.alike.names else 0.0
            axes.plot(
                v,
                sliding(found.alike, v)[0] + offset,
                color=style.TRUTH,
                lw=0.9,
                ls="--",
                label="both directions alike",
            )
        friction, std = sliding(found.chosen, v)
        band = Z_95 * std
        axes.fill_between(v, friction - band, friction + band, color=style.FITTED, alpha=0.3, lw=0)
        axes.plot(v, friction, color=style.FITTED, lw=1.4, label="regression")
