"""The friction curve with its levels and band, and levels over load and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.friction.static import Conditions
from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.levels import Levels
from elastid.report.figures import style

POINTS = 200
# The law is drawn, dashed, beyond the measured speeds by this factor.
BEYOND = 2.0
# Levels belong to one curve within so many kelvins, and this share of the largest load.
SAME_KELVIN, SAME_LOAD = 5.0, 0.05
# Direction: color, name.
DIRECTIONS = {
    0.0: (style.MEASURED, "both directions"),
    1.0: (style.MEASURED, "positive direction"),
    -1.0: (style.START, "negative direction"),
}


@dataclass(frozen=True)
class Condition:
    """Where a curve over speed is drawn: load in Nm (N), temperature in degC or NaN."""

    load: float
    temperature: float

    @classmethod
    def typical(cls, levels: Levels) -> Condition:
        """The lowest load, and of the temperatures there the middle one."""
        load = float(levels.load.min())
        known = levels.temperature[levels.load <= load + SAME_LOAD * levels.load.max()]
        known = np.sort(known[np.isfinite(known)])
        return cls(load, float(known[len(known) // 2]) if len(known) else float("nan"))

    def at(self, speed: FloatArray, direction: float) -> Conditions:
        """Every speed (n,) in one direction."""
        ones = np.ones_like(speed)
        return Conditions(speed, direction * ones, self.load * ones, self.temperature * ones)

    def includes(self, law: StaticLaw) -> BoolArray:
        """True of levels (n,) at this condition, as far as the law depends on load and temperature."""
        levels, own = law.levels, np.ones(law.levels.n_levels, dtype=bool)
        if depends_on(law, "load"):
            own &= np.abs(levels.load - self.load) <= SAME_LOAD * levels.load.max()
        if depends_on(law, "temperature"):
            own &= np.abs(levels.temperature - self.temperature) <= SAME_KELVIN
        return own

    def text(self, law: StaticLaw) -> str:
        """In words, of what the law depends on."""
        load = f"a load of {self.load:.3g} {units(law.levels.slides)[1]}" if depends_on(law, "load") else ""
        heat = f"{self.temperature:.3g} °C" if depends_on(law, "temperature") else ""
        words = " and ".join(filter(None, (load, heat)))
        return f"at {words}" if words else ""


def friction_curve(law: StaticLaw) -> Figure:
    """Levels by direction with 95 % intervals over log speed, the law with its 95 % band; below, what it leaves.

    Shaded: the speeds that were measured, beyond which the law is dashed.  Grey: levels of other loads, temperatures.
    """
    levels, condition = law.levels, Condition.typical(law.levels)
    figure, panels = style.column(5.4, (3, 1), 0.12)
    curve, left = panels
    on_curve = condition.includes(law)
    for direction in sorted(set(levels.direction.tolist()), reverse=True):
        _draw_levels(curve, left, law, direction, on_curve)
    for direction in law_directions(law):
        _draw_law(curve, law, condition, direction)
    low, high = float(levels.speed.min()), float(levels.speed.max())
    for axes in panels:
        axes.axvspan(low, high, color=style.SHADE, lw=0, zorder=0, label="measured speeds")
    style.set_log_frequency(curve, np.array([low / BEYOND, high * BEYOND]), 12)
    curve.set_ylim(0, 1.15 * float((levels.torque + QUANTILE_95 * levels.std).max()))
    for bound in (-QUANTILE_95, QUANTILE_95):
        left.axhline(bound, color=style.TRUTH, lw=0.6, ls=":")
    reach = max(3.0, 1.1 * float(np.abs(residuals(law)).max()))
    left.set_ylim(-reach, reach)
    speed, torque = units(levels.slides)
    style.label(curve, y=f"{quantity(levels.slides)} in {torque}")
    style.label(left, f"speed in {speed}", "(level − law) / std")
    style.finish(figure, f"{levels.place}: friction over speed {condition.text(law)}".rstrip(), panels, [curve])
    return figure


def quantity(slides: bool) -> str:
    """Force or torque."""
    return "force" if slides else "torque"


def units(slides: bool) -> tuple[str, str]:
    """Of speed and torque, as people write them."""
    return ("m/s", "N") if slides else ("rad/s", "N·m")


def depends_on(law: StaticLaw, part: str) -> bool:
    """True where the law has numbers of `load`, `temperature` or `directions`."""
    return any(name.startswith(part) for name in law.names)


def law_directions(law: StaticLaw) -> tuple[float, ...]:
    """Directions in which the law differs; (0,) where it does not."""
    return (1.0, -1.0) if depends_on(law, "directions") else (0.0,)


def residuals(law: StaticLaw) -> FloatArray:
    """(level - law) / std (n,)."""
    return (law.levels.torque - law.fit.torque(law.levels.conditions)) / law.levels.std


def law_band(law: StaticLaw, at: Conditions) -> tuple[FloatArray, FloatArray]:
    """The law (n,) at conditions, and half the width of its 95 % band."""
    reach = law.fit.reach
    return law.fit.torque(at), reach * law.fit.torque_std(at)


def _draw_levels(curve: Axes, left: Axes, law: StaticLaw, direction: float, on_curve: BoolArray) -> None:
    levels, (color, name) = law.levels, DIRECTIONS[direction]
    for chosen, ink, text, order in (
        (~on_curve, style.WEAK, "levels at other loads and temperatures", 2),
        (on_curve, color, f"levels, {name}", 4),
    ):
        own = chosen & (levels.direction == direction)
        if not own.any():
            continue
        looks = style.DOTS | {"ms": 3.5, "color": ink, "mfc": ink, "zorder": order}
        looks |= {} if direction >= 0 else {"marker": "s", "ms": 5, "mfc": "none", "mew": 0.9}
        x = levels.speed[own]
        style.plot_intervals(curve, x, levels.torque[own], levels.std[own], **looks, capsize=2, label=text)
        left.plot(x, residuals(law)[own], **looks)


def _draw_law(axes: Axes, law: StaticLaw, condition: Condition, direction: float) -> None:
    low, high = float(law.levels.speed.min()), float(law.levels.speed.max())
    color = style.FITTED if direction >= 0 else style.TOTAL
    name = f"law, {DIRECTIONS[direction][1]}" if direction else "law with 95 % band"
    for ends, dash, text in (
        ((low, high), "-", name),
        ((low / BEYOND, low), "--", ""),
        ((high, high * BEYOND), "--", ""),
    ):
        speed = np.geomspace(*ends, POINTS)
        torque, half = law_band(law, condition.at(speed, direction))
        axes.plot(speed, torque, dash, color=color, lw=1.3, zorder=3, label=text or None)
        style.fill_band(axes, speed, torque, half, color, 0.25, zorder=3)


# Speeds that are drawn, and the share by which those of one group differ at most.
MOST_SPEEDS, SAME_SPEED = 4, 0.05


def conditions_of(law: StaticLaw) -> list[str]:
    """On which of load and temperature the law depends."""
    return [kind for kind in ("load", "temperature") if depends_on(law, kind)]


def friction_conditions(law: StaticLaw) -> Figure:
    """A panel over load and one over temperature, each where the law depends on it, and it does on one.

    Points: levels, brought by the law to the panel's other condition and to the mean speed of their group, so that
    their distance from the line is what the law leaves of them.
    """
    kinds = conditions_of(law)
    size = (style.WIDE if len(kinds) > 1 else 5.6, 4.1)
    figure, panels = style.panels(1, len(kinds), size, (0.8, 0.25, 1.05, 0.55), (0.25, 0.0))
    speed, torque = units(law.levels.slides)
    names = {"load": f"load in {torque}", "temperature": "temperature in °C"}
    for axes, kind in zip(panels[0], kinds, strict=True):
        for i, members in enumerate(_groups(law.levels.speed)):
            _draw_group(axes, law, kind, members, style.SERIES[i])
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        style.label(axes, names[kind], f"{quantity(law.levels.slides)} in {torque}", _held(law, kind))
    title = f"{law.levels.place}: friction over {' and '.join(kinds)}, by speed in {speed}"
    style.finish(figure, title, panels[0], panels[0])
    return figure


def _draw_group(axes: Axes, law: StaticLaw, kind: str, members: BoolArray, color: str) -> None:
    levels, typical = law.levels, Condition.typical(law.levels)
    speed = float(levels.speed[members].mean())
    values = getattr(levels, kind)[members]
    grid = np.linspace(values.min(), values.max(), POINTS)
    line, half = law_band(law, _conditions(typical, kind, speed, grid))
    style.fill_band(axes, grid, line, half, color, 0.2)
    axes.plot(grid, line, color=color, lw=1.2)
    left = levels.torque[members] - law.fit.torque(levels.select(members).conditions)
    torque = law.fit.torque(_conditions(typical, kind, speed, values)) + left
    looks: dict[str, Any] = {"ms": 3.2, "capsize": 2, "color": color, "label": f"{speed:.3g}"}
    style.plot_intervals(axes, values, torque, levels.std[members], **looks)


def _conditions(typical: Condition, kind: str, speed: float, values: FloatArray) -> Conditions:
    ones = np.ones_like(values)
    load = values if kind == "load" else typical.load * ones
    temperature = values if kind == "temperature" else typical.temperature * ones
    return Conditions(speed * ones, 0.0 * ones, load, temperature)


def _held(law: StaticLaw, kind: str) -> str:
    """The other condition, of a law that depends on both."""
    other = "temperature" if kind == "load" else "load"
    if not depends_on(law, other):
        return ""
    typical = Condition.typical(law.levels)
    if kind == "load":
        return f"at {typical.temperature:.3g} °C"
    return f"at a load of {typical.load:.3g} {units(law.levels.slides)[1]}"


def _groups(speed: FloatArray) -> Sequence[BoolArray]:
    """Masks (n,) of the levels of a few speeds, spread from the lowest to the highest."""
    centres: list[float] = []
    for v in np.sort(speed).tolist():
        if not centres or v > centres[-1] * (1 + SAME_SPEED):
            centres.append(v)
    chosen = np.unique(np.round(np.linspace(0, len(centres) - 1, MOST_SPEEDS)).astype(int))
    return [(speed >= centres[i] * (1 - 1e-9)) & (speed <= centres[i] * (1 + SAME_SPEED)) for i in chosen]
