"""Friction over a motion: one pass there and back over angle, and torque over velocity of any motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.least_squares import Regression
from elastid.friction_study.levels import PassLevels
from elastid.friction_study.motion import MotionFriction, MotionSamples, motion_samples
from elastid.friction_study.passes import MAX_HARMONIC, Pass, distinct_speeds, gravity_names, ripple_names
from elastid.report.figures import style
from elastid.report.figures.friction_curve import POINTS, quantity, units

OFFSET = "gravity and offset"
COLORS = {"friction": style.START, OFFSET: style.MEASURED, "ripple": style.NOISE, "inertia": style.TOTAL}


def friction_pass(pair: Sequence[Pass], regressed: PassLevels) -> Figure:
    """Torque over angle, measured and regressed; the parts of the regression; what it leaves, all in both directions.

    pair: the passes there and back.
    """
    figure, panels = style.column(6.6, (2, 2, 1), 0.14)
    total_torque, shown, left = panels
    scale = 1.0 if pair[0].slides else 180 / np.pi
    for run, own in zip(pair, parts_of(pair, regressed), strict=True):
        step = max(1, len(run.position) // 3000)
        q, u = scale * run.position[::step], run.torque[::step]
        parts = {name: part[::step] for name, part in own.items()}
        total = np.sum(list(parts.values()), axis=0)
        total_torque.plot(q, u, color=style.MEASURED, lw=0.7, alpha=0.8, label="measured")
        total_torque.plot(q, total, color=style.FITTED, lw=1.2, label="regression")
        for name, part in parts.items():
            shown.plot(q, part, color=COLORS[name], lw=1.2, label=name)
        left.plot(q, u - total, color=style.RESIDUAL, lw=0.6, label="measured − regression")
    speed, torque = units(pair[0].slides)
    style.label(total_torque, y=f"{quantity(pair[0].slides)} in {torque}")
    style.label(shown, y=f"parts in {torque}")
    style.label(left, "position in m" if pair[0].slides else "angle in °", f"left in {torque}")
    mean = float(np.mean([np.abs(run.velocity).mean() for run in pair]))
    style.finish(figure, f"{pair[0].place}: a pass there and back at {mean:.3g} {speed}", panels, panels, 0.02)
    return figure


def parts_of(pair: Sequence[Pass], regressed: PassLevels) -> list[dict[str, FloatArray]]:
    """Friction, gravity with the offset, ripple and inertia (n,) of each pass, those that the regression has.

    The offset is the pair's own, the same in both directions.
    """
    shared = {name: value for name, (value, _) in regressed.shared.items()}
    by_run = []
    for run in pair:
        q, speed = run.position, np.abs(run.velocity)
        sliding = _level(pair, regressed, run.direction) + shared.get("slope", 0.0) * (speed - speed.mean())
        cosine, sine = (shared.get(name, 0.0) for name in gravity_names(run.load_name))
        gravity = cosine * np.cos(q) + sine * np.sin(q)
        parts = {"friction": run.direction * sliding, OFFSET: gravity}
        if "ripple.1c" in shared:
            parts["ripple"] = _ripple(q, shared, regressed.turn)
        by_run.append(parts | {"inertia": shared.get("inertia", 0.0) * run.acceleration})
    left = [run.torque - np.sum(list(parts.values()), axis=0) for run, parts in zip(pair, by_run, strict=True)]
    offset = float(np.mean([rest.mean() for rest in left]))
    return [parts | {OFFSET: parts[OFFSET] + offset} for parts in by_run]


def _level(pair: Sequence[Pass], regressed: PassLevels, direction: float) -> float:
    """Of the pair: the level at the nearest speed, load and temperature, in its direction where these differ."""
    levels = regressed.levels
    own = (levels.direction == direction) | (levels.direction == 0)
    speed = np.mean([np.abs(run.velocity).mean() for run in pair])
    load, heat = pair[0].load, np.mean([run.temperature for run in pair])
    away = np.abs(np.log(levels.speed / speed)) + np.abs(levels.load - load) / max(float(levels.load.max()), 1e-300)
    away = away + np.nan_to_num(np.abs(levels.temperature - heat)) / 100
    return float(levels.torque[own][np.argmin(away[own])])


def _ripple(q: FloatArray, shared: Mapping[str, float], turn: float) -> FloatArray:
    """sum_h a_h cos h N q + b_h sin h N q."""
    total = np.zeros_like(q)
    for h in range(1, MAX_HARMONIC + 1):
        cosine, sine = (shared.get(name, 0.0) for name in ripple_names(h))
        x = 2 * np.pi * h / turn * q
        total += cosine * np.cos(x) + sine * np.sin(x)
    return total


# Samples that are drawn.
MOST_SAMPLES = 6000


def friction_motion(friction: MotionFriction) -> Figure:
    """Torque less inertia and gravity over velocity, and the regression with its 95 % band; torque over time.

    Dotted lines: speeds that the motion dwells at.  Dashed: with the same numbers in both directions and an offset,
    where the chosen regression has numbers of each.
    """
    samples, slides = motion_samples(friction), friction.motion.slides
    figure, panels = style.column(6.0, (1.7, 1), 0.28, sharex=False)
    curve, over_time = panels
    speed, torque = units(slides)
    _draw_curve(curve, friction, samples)
    style.label(curve, f"velocity in {speed}", f"friction in {torque}")
    style.plot_curves(
        over_time,
        samples.time_s,
        (samples.torque, style.MEASURED, 1.0, "measured"),
        (samples.regressed, style.FITTED, 0.8, "regression"),
        (samples.torque - samples.regressed, style.RESIDUAL, 0.6, "measured − regression"),
        part=slice(None, None, max(1, len(samples.time_s) // MOST_SAMPLES)),
    )
    style.label(over_time, "time in s", f"{quantity(slides)} in {torque}")
    error = f"{100 * friction.chosen.relative_error:.3g} % of the {quantity(slides)} left"
    style.finish(figure, f"{friction.motion.place}: friction over velocity, {error}", panels, panels, 0.01)
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


def _draw_curve(axes: Axes, motion: MotionFriction, samples: MotionSamples) -> None:
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
