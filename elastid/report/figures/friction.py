"""Friction that was taken out of the responses: its curve, and the torque that nothing explains."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.friction.robot_friction import frictions
from elastid.nonlinear.result import FrictionTakenOut
from elastid.report.figures import style
from elastid.robot import Robot

# Points of a curve.
_POINTS = 400


def friction_curves(friction: FrictionTakenOut, robot: Robot | None = None) -> Figure:
    """For each motor the torque after a reversal, or over velocity, with its 95 % interval; torque not explained.

    The latter as its amplitude by configuration, with friction and without. A motor that no friction was taken out of
    has no curve.  robot: whose file may have a static law of the motor, from passes; its F_c is drawn too.
    """
    known = {} if robot is None else {law.place: float(law.curve()[0]) for law in frictions(robot)}
    n = len(friction.places)
    columns = min(n, 3)
    blocks = -(-n // columns)
    figure, axes = style.panels(
        2 * blocks, columns, (style.WIDE, 1.2 + 4.4 * blocks), (0.9, 0.25, 0.85, 0.75), (0.35, 0.55)
    )
    for spare in axes.flat:
        spare.set_axis_off()
    drawn = []
    for i, place in enumerate(friction.places):
        row, column = divmod(i, columns)
        curve, levels = axes[2 * row, column], axes[2 * row + 1, column]
        if place in friction.taken_places():
            _draw_curve(curve, friction, i, known.get(place))
            drawn.append(curve)
        _draw_levels(levels, friction, i)
        drawn.append(levels)
    style.finish(figure, "Friction taken out of the responses", drawn, drawn)
    return figure


def curve_of(friction: FrictionTakenOut, place: str) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """x (n,), torque and its std of a motor; True where x is a distance from a reversal, in rad (m) on the link side.

    Where no bristle was taken out, friction is a function of velocity, and x is that, in rad/s (m/s).
    """
    own = [shape for shape, _ in friction.taken_shapes(place)]
    bend = max((shape.threshold for shape in own if shape.kind != "sign"), default=0.0)
    if bend > 0:
        distance = np.linspace(0.0, 4 * bend, _POINTS)  # a stop operator slides after 2 thresholds
        torque, std = friction.reversal(place, distance)
        level, of_level = friction.sliding_level(place)
        return (
            np.concatenate([[-0.1 * distance[-1], 0.0], distance]),
            np.concatenate([[-level, -level], torque]),
            np.concatenate([[of_level, of_level], std]),
            True,
        )
    turning = max((shape.threshold for shape in own), default=0.0)
    # A sign that turns gradually has turned at 3 thresholds; one that turns at once is drawn to 1 mrad/s (mm/s).
    v = np.linspace(-1.0, 1.0, _POINTS) * (5 * turning if turning > 0 else 1e-3)
    return v, *friction.sliding(place, v), False


def _draw_curve(axes: Axes, friction: FrictionTakenOut, i: int, known: float | None) -> None:
    place, unit = friction.places[i], friction.place_units[i]
    x, torque, std, is_distance = curve_of(friction, place)
    axes.set_axis_on()
    style.fill_band(axes, 1e3 * x, torque, QUANTILE_95 * std, style.FITTED, 0.3, label="95 % interval")
    axes.plot(1e3 * x, torque, color=style.FITTED, lw=1.2, label="friction")
    for level in () if known is None else (known, -known):
        axes.axhline(level, color=style.TRUTH, lw=0.9, ls="--", label="F_c of the robot's file")
    own, of_own = friction.sliding_level(place)
    length, quantity = ("mm", "force") if unit == "N" else ("mrad", "torque")
    style.label(
        axes,
        f"distance from a reversal in {length}" if is_distance else f"velocity in {length}/s",
        f"{quantity} in {style.pretty_unit(unit)}",
        f"{place}: F_c = {own:.4g} ± {QUANTILE_95 * of_own:.2g} {style.pretty_unit(unit)}",
    )


def _draw_levels(axes: Axes, friction: FrictionTakenOut, i: int) -> None:
    """RMS amplitude of the torque that no response explains in each configuration."""
    x = np.arange(len(friction.configurations))
    axes.set_axis_on()
    for values, color, face, label in (
        (friction.before[:, i], style.MEASURED, "none", "unexplained, with friction"),
        (friction.after[:, i], style.MEASURED, style.MEASURED, "unexplained, friction taken out"),
    ):
        axes.plot(x, values, ls="none", marker="o", ms=4, mec=color, mfc=face, label=label)
    axes.set_ylim(0, 1.1 * max(float(axes.get_ylim()[1]), 1e-300))
    axes.set_xlim(-0.5, len(x) - 0.5)
    style.set_names(axes.xaxis, friction.configurations, rotation=30, ha="right")
    unit = friction.place_units[i]
    style.label(axes, y=f"amplitude in {style.pretty_unit(unit)}", title=f"{friction.places[i]}: torque not explained")
