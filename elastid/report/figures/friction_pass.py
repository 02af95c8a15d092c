"""One pass there and back over angle: what was measured, what the regression makes of it, and its parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.friction_study.levels import PassLevels
from elastid.friction_study.passes import MAX_HARMONIC, Pass, gravity_names, ripple_names
from elastid.report.figures import style
from elastid.report.figures.friction_curve import units

# Samples of a pass that are drawn.
MOST_SAMPLES = 3000
OFFSET = "gravity and offset"
COLORS = {"friction": style.START, OFFSET: style.MEASURED, "ripple": style.NOISE, "inertia": style.TOTAL}


def friction_pass(pair: Sequence[Pass], found: PassLevels) -> Figure:
    """Torque over angle, measured and regressed; the parts of the regression; what it leaves, all in both directions.

    pair: the passes there and back.
    """
    options = {"sharex": True, "height_ratios": (2, 2, 1)}
    figure, panels = style.panels(3, 1, (style.WIDE, 6.6), (0.8, 0.25, 0.85, 0.55), (0.0, 0.14), **options)
    whole, shown, left = panels[:, 0]
    scale = 1.0 if pair[0].slides else 180 / np.pi
    for each, own in zip(pair, parts_of(pair, found), strict=True):
        step = max(1, len(each.position) // MOST_SAMPLES)
        q, u = scale * each.position[::step], each.torque[::step]
        parts = {name: part[::step] for name, part in own.items()}
        total = np.sum(list(parts.values()), axis=0)
        whole.plot(q, u, color=style.MEASURED, lw=0.7, alpha=0.8, label="measured")
        whole.plot(q, total, color=style.FITTED, lw=1.2, label="regression")
        for name, part in parts.items():
            shown.plot(q, part, color=COLORS[name], lw=1.2, label=name)
        left.plot(q, u - total, color=style.RESIDUAL, lw=0.6, label="measured − regression")
    speed, torque = units(pair[0].slides)
    for axes in panels[:, 0]:
        style.lighten(axes)
        axes.margins(x=0.02)
    quantity = "force" if pair[0].slides else "torque"
    style.label(whole, y=f"{quantity} in {torque}")
    style.label(shown, y=f"parts in {torque}")
    style.label(left, "position in m" if pair[0].slides else "angle in °", f"left in {torque}")
    mean = float(np.mean([np.abs(each.velocity).mean() for each in pair]))
    style.add_title(figure, f"{pair[0].place}: a pass there and back at {mean:.3g} {speed}")
    style.add_legend(figure, panels[:, 0])
    return figure


def parts_of(pair: Sequence[Pass], found: PassLevels) -> list[dict[str, FloatArray]]:
    """Friction, gravity with the offset, ripple and inertia (n,) of each pass, those that the regression has.

    The offset is the pair's own: what is alike in both directions.
    """
    shared = {name: value for name, (value, _) in found.shared.items()}
    each_has = []
    for each in pair:
        q, speed = each.position, np.abs(each.velocity)
        sliding = _level(pair, found, each.direction) + shared.get("slope", 0.0) * (speed - speed.mean())
        cosine, sine = (shared.get(name, 0.0) for name in gravity_names(each.load_name))
        gravity = cosine * np.cos(q) + sine * np.sin(q)
        parts = {"friction": each.direction * sliding, OFFSET: gravity}
        if "ripple.1c" in shared:
            parts["ripple"] = _ripple(q, shared, found.turn)
        each_has.append(parts | {"inertia": shared.get("inertia", 0.0) * each.acceleration})
    left = [each.torque - np.sum(list(parts.values()), axis=0) for each, parts in zip(pair, each_has, strict=True)]
    offset = float(np.mean([one.mean() for one in left]))
    return [parts | {OFFSET: parts[OFFSET] + offset} for parts in each_has]


def _level(pair: Sequence[Pass], found: PassLevels, direction: float) -> float:
    """Of the pair: the level at the nearest speed, load and temperature, in its direction where these differ."""
    levels = found.levels
    own = (levels.direction == direction) | (levels.direction == 0)
    speed = np.mean([np.abs(each.velocity).mean() for each in pair])
    load, heat = pair[0].load, np.mean([each.temperature for each in pair])
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
