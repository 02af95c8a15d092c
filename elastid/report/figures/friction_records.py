"""Friction in records: motions, and a filter."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.filter_consistency import FILTER
from elastid.friction_study.follow import FollowedFriction
from elastid.friction_study.least_squares import Regression
from elastid.friction_study.motion import MotionFriction, MotionSamples, motion_samples
from elastid.friction_study.passes import distinct_speeds
from elastid.report.figures import style
from elastid.report.figures.friction import POINTS, quantity, units

# Samples of a motion that are drawn.
MOST_SAMPLES = 6000
# Of numbers that are followed.
NAMES = {
    "Fc": "Coulomb friction",
    "f": "viscous friction",
    "f+": "viscous friction +",
    "f-": "viscous friction \N{MINUS SIGN}",
    "offset": "offset",
}


def friction_motion(friction: MotionFriction) -> Figure:
    """Torque less inertia and gravity over velocity, and the regression with its 95 % band; torque over time.

    Dotted lines: speeds that the motion dwells at.  Dashed: with the same numbers in both directions and an offset,
    where the chosen regression has numbers of each.
    """
    samples, slides = motion_samples(friction), friction.motion.slides
    figure, panels = style.column(6.0, (1.7, 1), 0.28, sharex=False)
    curve, over_time = panels
    speed, torque = units(slides)
    _draw_over_velocity(curve, friction, samples)
    style.label(curve, f"velocity in {speed}", f"friction in {torque}")
    measured = samples.torque, style.MEASURED, 1.0, "measured"
    regressed = samples.regressed, style.FITTED, 0.8, "regression"
    rest = samples.torque - samples.regressed, style.RESIDUAL, 0.6, "measured − regression"
    part = slice(None, None, max(1, len(samples.time_s) // MOST_SAMPLES))
    style.plot_curves(over_time, samples.time_s, measured, regressed, rest, part=part)
    style.label(over_time, "time in s", f"{quantity(slides)} in {torque}")
    error = f"{100 * friction.chosen.relative_error:.3g} % of the {quantity(slides)} left"
    return style.finish(figure, f"{friction.motion.place}: friction over velocity, {error}", panels, panels, 0.01)


def sliding(numbers: Regression, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Friction (n,) at velocities other than 0, both directions' numbers included, and its std."""
    columns = {"coulomb": np.sign(v), "viscous": v}
    if "stiction" in numbers.names:
        fall = np.exp(-((v / numbers["stribeck_velocity"]) ** 2))
        columns |= {"coulomb": np.sign(v) * (1 - fall), "stiction": np.sign(v) * fall}
    columns |= {"directions.coulomb": np.ones_like(v), "directions.viscous": np.abs(v)}
    own = [name for name in columns if name in numbers.names]
    A = np.stack([columns[name] for name in own], axis=1)
    chosen = [numbers.names.index(name) for name in own]
    covariance = numbers.covariance[np.ix_(chosen, chosen)]
    return A @ numbers.values[chosen], np.sqrt(np.einsum("ni,ij,nj->n", A, covariance, A))


def _draw_over_velocity(axes: Axes, motion: MotionFriction, samples: MotionSamples) -> None:
    step = max(1, len(samples.velocity) // MOST_SAMPLES)
    looks = style.DOTS | {"ms": 1.5, "alpha": 0.5, "color": style.MEASURED}
    axes.plot(samples.velocity[::step], samples.friction[::step], **looks)
    for sign in (1.0, -1.0):
        for speed in distinct_speeds([plateau for plateau in motion.plateaus if sign * plateau.velocity > 0]):
            axes.axvline(sign * speed, color=style.NOISE, lw=0.8, ls=":", label="speeds dwelt at")
    for low, high in ((float(samples.velocity.min()), 0.0), (0.0, float(samples.velocity.max()))):
        v = np.linspace(low, high, POINTS)[1 if low == 0 else 0 : -1 if high == 0 else None]
        if motion.are_apart:
            offset = motion.alike["offset"] if "offset" in motion.alike.names else 0.0
            symmetric = sliding(motion.alike, v)[0] + offset
            axes.plot(v, symmetric, color=style.TRUTH, lw=0.9, ls="--", label="the same in both directions")
        friction, std = sliding(motion.chosen, v)
        style.fill_band(axes, v, friction, QUANTILE_95 * std, style.FITTED, 0.3)
        axes.plot(v, friction, color=style.FITTED, lw=1.4, label="regression")


def friction_filter(followed: FollowedFriction) -> Figure:
    """Followed numbers, NIS with its band, and autocorrelation of the innovations."""
    ratios = (*(1.3 for _ in followed.names), 0.9, 1.0)
    figure, panels = style.column(1.6 * len(ratios), ratios, 0.42, sharex=False)
    time, unit = (followed.time_s, "s") if followed.time_s[-1] <= 300 else (followed.time_s / 60, "min")
    for i, name in enumerate(followed.names):
        _draw_number(panels[i], followed, i, time)
        style.label(panels[i], y=f"{NAMES[name]}\nin {_unit(name, followed.slides)}")
    nis, correlation = panels[-2:]
    nis.plot(time, followed.nis, color=style.TOTAL, lw=0.8, label="mean NIS since the point before")
    nis.axhspan(*FILTER.nis_band, color=style.FITTED, alpha=0.15, lw=0, label="mean NIS of an honest filter")
    nis.set_yscale("log")
    style.label(nis, f"time in {unit}", "NIS")
    rho = followed.consistency.autocorrelation
    correlation.stem(np.arange(1, len(rho)), rho[1:], linefmt="-", markerfmt=".", basefmt=" ")
    reach = QUANTILE_95 / np.sqrt(max(followed.consistency.n_eff, 1.0))
    correlation.axhspan(-reach, reach, color=style.FITTED, alpha=0.15, lw=0)
    style.label(correlation, "lag in samples", "autocorrelation")
    title = f"joint {followed.joint}: friction followed, mean NIS {followed.consistency.nis:.2f}"
    return style.finish(figure, title, panels, panels, 0.01)


def _draw_number(axes: Axes, followed: FollowedFriction, i: int, time: np.ndarray) -> None:
    looks: dict[str, Any] = {"color": style.FITTED, "alpha": 0.2, "lw": 0, "label": "95 % band"}
    axes.fill_between(time, followed.low[:, i], followed.high[:, i], **looks)
    axes.plot(time, followed.values[:, i], color=style.FITTED, lw=1.2, label="followed")
    held = np.where(followed.unknown[:, i], followed.values[:, i], np.nan)
    if np.isfinite(held).any():
        axes.plot(time, held, color=style.WEAK, lw=2.0, label="held: not observable in this motion")


def _unit(name: str, slides: bool) -> str:
    torque = "N" if slides else "N*m"
    return {"Fc": torque, "offset": torque}.get(name, "N*s/m" if slides else "N*m*s/rad")
