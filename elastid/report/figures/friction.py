"""Friction over speed, load and temperature, with measured torques and band; compensated friction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.friction.robot_friction import frictions
from elastid.friction.static import Conditions
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.report.figures import style
from elastid.report.figures.style import Curve, Panel
from elastid.robot import Robot

if TYPE_CHECKING:  # they import SciPy, which figures of compensated friction do not need
    from elastid.friction_study.constant_velocity import FrictionCurve
    from elastid.friction_study.static_model_fit import StaticLaw

# Figures of a friction model, and of friction compensated in responses.
POINTS, POINTS_TAKEN_OUT = 200, 400
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
    """Conditions of a curve: load in Nm (N), temperature in degC or NaN; over one of them its values (n,)."""

    load: float | FloatArray
    temperature: float | FloatArray

    @classmethod
    def typical(cls, curve: FrictionCurve) -> Condition:
        """Return the lowest load and its middle temperature."""
        load = float(curve.load.min())
        degc = curve.temperature[curve.load <= load + SAME_LOAD * curve.load.max()]
        degc = np.sort(degc[np.isfinite(degc)])
        return cls(load, float(degc[len(degc) // 2]) if len(degc) else float("nan"))

    def at(self, speed: FloatArray, direction: float) -> Conditions:
        """Return the conditions of this load and temperature at each speed (n,) in one direction."""
        return Conditions(speed, *(np.full_like(speed, value) for value in (direction, self.load, self.temperature)))

    def includes(self, law: StaticLaw) -> BoolArray:
        """True of levels (n,) at this condition, as far as the law depends on load and temperature."""
        curve, rows = law.curve, np.ones(law.curve.n_conditions, dtype=bool)
        if depends_on(law, "load"):
            rows &= np.abs(curve.load - self.load) <= SAME_LOAD * curve.load.max()
        if depends_on(law, "temperature"):
            rows &= np.abs(curve.temperature - self.temperature) <= SAME_KELVIN
        return rows

    def text(self, law: StaticLaw) -> str:
        """Describe the conditions that the friction model depends on."""
        load, heat = f"a load of {self.load:.3g} {units(law.curve.slides)[1]}", f"{self.temperature:.3g} °C"
        texts = [text for kind, text in (("load", load), ("temperature", heat)) if depends_on(law, kind)]
        return f"at {' and '.join(texts)}" if texts else ""


def friction_curve(law: StaticLaw) -> Figure:
    """Draw measured torques by direction and the friction model over log speed, with 95 % intervals; below, residuals.

    Shaded: the speeds that were measured, beyond which the law is dashed.  Grey: levels of other loads, temperatures.
    """
    measured_curve, condition = law.curve, Condition.typical(law.curve)
    on_curve = condition.includes(law)
    curves, errors = [], []
    for direction in sorted(set(measured_curve.direction.tolist()), reverse=True):
        above, below = _levels(law, direction, on_curve)
        curves += above
        errors += below
    for direction in (1.0, -1.0) if depends_on(law, "directions") else (0.0,):
        curves += _law(law, condition, direction)
    measured = float(measured_curve.speed.min()), float(measured_curve.speed.max())
    speed, torque = units(measured_curve.slides)
    lines = np.array([measured[0] / BEYOND, measured[1] * BEYOND])
    rows = [
        [Panel(curves, y=f"{quantity(measured_curve.slides)} in {torque}", frequency=lines, y_ends=(0.0, None),
               span=measured)],
        [Panel(errors, f"speed in {speed}", "residual / std", marks=(-QUANTILE_95, QUANTILE_95),
               frequency=lines, span=measured)],
    ]  # fmt: skip
    title = f"{measured_curve.place}: friction over speed {condition.text(law)}".rstrip()
    return style.matrix(title, rows, (3.0, 1.0), sharex=True)


def quantity(slides: bool) -> str:
    """Return the name of the drive quantity for axis labels: force of a sliding joint, else torque."""
    return "force" if slides else "torque"


def units(slides: bool) -> tuple[str, str]:
    """Return the units of speed and torque for axis labels."""
    return ("m/s", "N") if slides else ("rad/s", "N·m")


def depends_on(law: StaticLaw, prefix: str) -> bool:
    """True where the law has numbers of `load`, `temperature` or `directions`."""
    return any(name.startswith(prefix) for name in law.names)


def residuals(law: StaticLaw) -> FloatArray:
    """Return the residuals (measured torque - model) / std (n,)."""
    return (law.curve.torque - law.torque(law.curve.conditions)) / law.curve.std


def _levels(law: StaticLaw, direction: float, on_curve: BoolArray) -> tuple[list[Curve], list[Curve]]:
    curve, (color, name) = law.curve, DIRECTIONS[direction]
    above, below = [], []
    for mask, ink, text in (
        (~on_curve, style.WEAK, "levels at other loads and temperatures"),
        (on_curve, color, f"levels, {name}"),
    ):
        rows = mask & (curve.direction == direction)
        if rows.any():
            looks = {} if direction >= 0 else {"marker": "s", "mfc": "none", "mew": 1}
            x, y = curve.speed[rows], curve.torque[rows]
            above.append(Curve(x, y, text, ink, True, style.about(y, curve.std[rows]), looks=looks))
            below.append(Curve(x, residuals(law)[rows], "", ink, True, looks=looks))
    return above, below


def _law(law: StaticLaw, condition: Condition, direction: float) -> Iterator[Curve]:
    low, high = float(law.curve.speed.min()), float(law.curve.speed.max())
    color = style.FITTED if direction >= 0 else style.TOTAL
    name = f"law, {DIRECTIONS[direction][1]}" if direction else "law with 95 % band"
    for ends, text in (((low, high), name), ((low / BEYOND, low), ""), ((high, high * BEYOND), "")):
        speed = np.geomspace(*ends, POINTS)
        at = condition.at(speed, direction)
        torque, half = law.torque(at), law.quantile_95 * law.torque_std(at)
        looks = {"ls": "-" if text else "--"}
        yield Curve(speed, torque, text, color, band=(torque - half, torque + half), looks=looks)


def friction_taken_out(friction: CompensatedFriction, robot: Robot | None = None) -> Figure:
    """Draw the friction of each motor after a reversal or over velocity, with 95 % interval, and unexplained torque.

    The latter as its amplitude by configuration, with friction and without. A motor without compensated friction
    has no curve.  robot: whose file may have a static law of the motor, from passes; its F_c is drawn too.
    """
    modelled = {} if robot is None else {law.place: float(law.curve()[0]) for law in frictions(robot)}
    motors = friction.compensated_motors()
    curves = [_taken_out(friction, i, modelled.get(p)) if p in motors else None for i, p in enumerate(friction.places)]
    panels = [_unexplained(friction, i) for i in range(len(friction.places))]
    figure = style.matrix("Friction compensation", style.in_columns(curves, panels))
    for axes in figure.axes:
        if axes.get_title().endswith("distortion"):
            style.set_names(axes.xaxis, friction.configurations, rotation=30, ha="right")
    return figure


def compensated_curve(friction: CompensatedFriction, location: str) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Return x (n,), torque and std of a motor, and True if x is a distance from a reversal, link side, rad (m).

    Without a bristle, friction is a function of velocity, and x is that, in rad/s (m/s).
    """
    shapes = [shape for shape, _ in friction.compensated_basis(location)]
    bend = max((shape.threshold for shape in shapes if shape.kind not in ("sign", "stribeck")), default=0.0)
    if bend > 0:
        distance = np.linspace(0.0, 4 * bend, POINTS_TAKEN_OUT)  # a stop operator slides after 2 thresholds
        torque, std = friction.reversal(location, distance)
        torque_0, of_level = friction.coulomb_friction(location)
        x = np.concatenate([[-0.1 * distance[-1], 0.0], distance])
        return x, np.concatenate([[-torque_0, -torque_0], torque]), np.concatenate([[of_level, of_level], std]), True
    turning = max((shape.threshold for shape in shapes), default=0.0)
    # A sign that turns gradually has turned at 3 thresholds; one that turns at once is drawn to 1 mrad/s (mm/s).
    v = np.linspace(-1.0, 1.0, POINTS_TAKEN_OUT) * (5 * turning if turning > 0 else 1e-3)
    return v, *friction.sliding(location, v), False


def _taken_out(friction: CompensatedFriction, i: int, modelled: float | None) -> Panel:
    location, unit = friction.places[i], friction.place_units[i]
    x, torque, std, is_distance = compensated_curve(friction, location)
    band = style.about(torque, std)
    curves = [Curve(1e3 * x, torque, "friction", style.FITTED, band=band, band_label="95 % interval")]
    for coulomb in () if modelled is None else (modelled, -modelled):
        ends, looks = 1e3 * x[[0, -1]], {"ls": "--"}
        curves.append(Curve(ends, [coulomb, coulomb], "F_c of the robot model", style.TRUTH, looks=looks))
    F_c, of_own = friction.coulomb_friction(location)
    length, quantity = ("mm", "force") if unit == "N" else ("mrad", "torque")
    label = f"distance from a reversal in {length}" if is_distance else f"velocity in {length}/s"
    unit = style.pretty_unit(unit)
    title = f"{location}: F_c = {F_c:.4g} ± {QUANTILE_95 * of_own:.2g} {unit}"
    return Panel(curves, label, f"{quantity} in {unit}", title)


def _unexplained(friction: CompensatedFriction, i: int) -> Panel:
    x = np.arange(len(friction.configurations))
    kinds = (
        (friction.before[:, i], "none", "before compensation"),
        (friction.after[:, i], style.MEASURED, "after compensation"),
    )
    curves = [Curve(x, y, text, dots=True, looks={"mew": 1, "mfc": face}) for y, face, text in kinds]
    unit = style.pretty_unit(friction.place_units[i])
    return Panel(curves, "", f"amplitude in {unit}", f"{friction.places[i]}: noise and distortion", y_ends=(0.0, None))
