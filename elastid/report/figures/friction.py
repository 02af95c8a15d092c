"""Figures of friction: a friction model over speed with measured torques, and friction compensated in FRFs."""

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

if TYPE_CHECKING:  # slow imports (SciPy)
    from elastid.friction_study.constant_velocity import FrictionCurve
    from elastid.friction_study.static_model_fit import StaticLaw

POINTS, COMPENSATION_POINTS = 200, 400  # of a curve of a friction model, and of compensated friction
EXTRAPOLATION = 2.0  # factor beyond the measured speeds to which the model is drawn, dashed
SAME_KELVIN, SAME_LOAD = 5.0, 0.05  # ranges of one curve: temperature in K, load relative to the largest
# Color and name by direction.
DIRECTIONS = {
    0.0: (style.MEASURED, "both directions"),
    1.0: (style.MEASURED, "positive direction"),
    -1.0: (style.START, "negative direction"),
}


@dataclass(frozen=True)
class Condition:
    """Conditions of a curve: load in N*m (N), temperature in degC or NaN."""

    load: float | FloatArray
    temperature: float | FloatArray

    @classmethod
    def typical(cls, curve: FrictionCurve) -> Condition:
        """Return the lowest load, and the median temperature at this load."""
        load = float(curve.load.min())
        degc = curve.temperature[curve.load <= load + SAME_LOAD * curve.load.max()]
        degc = np.sort(degc[np.isfinite(degc)])
        return cls(load, float(degc[len(degc) // 2]) if len(degc) else float("nan"))

    def at(self, speed: FloatArray, direction: float) -> Conditions:
        """Return the conditions of this load and temperature at speeds (n,) in one direction."""
        return Conditions(speed, *(np.full_like(speed, value) for value in (direction, self.load, self.temperature)))

    def includes(self, law: StaticLaw) -> BoolArray:
        """Return True for runs (n,) at this condition, if the model depends on load or temperature."""
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
    """Draw measured torques by direction and the friction model over log speed with 95 % intervals, and residuals.

    Shaded: measured speeds; the model is dashed beyond.  Grey: runs at other loads and temperatures.
    """
    measured_curve, condition = law.curve, Condition.typical(law.curve)
    on_curve = condition.includes(law)
    curves, errors = [], []
    for direction in sorted(set(measured_curve.direction.tolist()), reverse=True):
        above, below = _measured_curves(law, direction, on_curve)
        curves += above
        errors += below
    for direction in (1.0, -1.0) if depends_on(law, "directions") else (0.0,):
        curves += _model_curves(law, condition, direction)
    measured = float(measured_curve.speed.min()), float(measured_curve.speed.max())
    speed, torque = units(measured_curve.slides)
    lines = np.array([measured[0] / EXTRAPOLATION, measured[1] * EXTRAPOLATION])
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
    """Return True if the model has parameters of `load`, `temperature` or `directions`."""
    return any(name.startswith(prefix) for name in law.names)


def residuals(law: StaticLaw) -> FloatArray:
    """Return the residuals (measured torque - model) / std (n,)."""
    return (law.curve.torque - law.torque(law.curve.conditions)) / law.curve.std


def _measured_curves(law: StaticLaw, direction: float, on_curve: BoolArray) -> tuple[list[Curve], list[Curve]]:
    curve, (color, name) = law.curve, DIRECTIONS[direction]
    above, below = [], []
    for mask, ink, text in (
        (~on_curve, style.WEAK, "runs at other loads and temperatures"),
        (on_curve, color, f"runs, {name}"),
    ):
        rows = mask & (curve.direction == direction)
        if rows.any():
            looks = {} if direction >= 0 else {"marker": "s", "mfc": "none", "mew": 1}
            x, y = curve.speed[rows], curve.torque[rows]
            above.append(Curve(x, y, text, ink, True, style.band_95(y, curve.std[rows]), looks=looks))
            below.append(Curve(x, residuals(law)[rows], "", ink, True, looks=looks))
    return above, below


def _model_curves(law: StaticLaw, condition: Condition, direction: float) -> Iterator[Curve]:
    low, high = float(law.curve.speed.min()), float(law.curve.speed.max())
    color = style.FITTED if direction >= 0 else style.TOTAL
    name = f"law, {DIRECTIONS[direction][1]}" if direction else "law with 95 % band"
    for ends, text in (((low, high), name), ((low / EXTRAPOLATION, low), ""), ((high, high * EXTRAPOLATION), "")):
        speed = np.geomspace(*ends, POINTS)
        at = condition.at(speed, direction)
        torque, half = law.torque(at), law.quantile_95 * law.torque_std(at)
        looks = {"ls": "-" if text else "--"}
        yield Curve(speed, torque, text, color, band=(torque - half, torque + half), looks=looks)


def compensation_figure(friction: CompensatedFriction, robot: Robot | None = None) -> Figure:
    """Draw the friction of each motor after a reversal or over velocity with 95 % intervals, and unexplained torque.

    Unexplained torque: amplitude by configuration, before and after compensation. A motor without compensated friction
    has no curve.  robot: F_c of its friction models is drawn, too.
    """
    modelled = {} if robot is None else {law.place: float(law.curve()[0]) for law in frictions(robot)}
    motors = friction.compensated_motors()
    curves = [_panel(friction, i, modelled.get(p)) if p in motors else None for i, p in enumerate(friction.places)]
    panels = [_unexplained_panel(friction, i) for i in range(len(friction.places))]
    figure = style.matrix("Friction compensation", style.in_columns(curves, panels))
    for axes in figure.axes:
        if axes.get_title().endswith("distortion"):
            style.set_names(axes.xaxis, friction.configurations, rotation=30, ha="right")
    return figure


def compensated_curve(friction: CompensatedFriction, location: str) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Return x (n,), torque and std of a motor, link side, and True if x is a distance from a reversal, rad (m).

    Without presliding, friction is a function of velocity, and x is the velocity, rad/s (m/s).
    """
    shapes = [shape for shape, _ in friction.compensated_basis(location)]
    presliding = max((shape.threshold for shape in shapes if shape.kind not in ("sign", "stribeck")), default=0.0)
    if presliding > 0:
        distance = np.linspace(0.0, 4 * presliding, COMPENSATION_POINTS)  # a stop operator slides after 2 thresholds
        torque, std = friction.reversal(location, distance)
        torque_0, std_0 = friction.coulomb_friction(location)
        x = np.concatenate([[-0.1 * distance[-1], 0.0], distance])
        return x, np.concatenate([[-torque_0, -torque_0], torque]), np.concatenate([[std_0, std_0], std]), True
    smoothing = max((shape.threshold for shape in shapes), default=0.0)
    # A smoothed sign function is constant beyond 3 thresholds; a step is drawn to 1 mrad/s (mm/s).
    v = np.linspace(-1.0, 1.0, COMPENSATION_POINTS) * (5 * smoothing if smoothing > 0 else 1e-3)
    return v, *friction.sliding(location, v), False


def _panel(friction: CompensatedFriction, i: int, modelled: float | None) -> Panel:
    location, unit = friction.places[i], friction.place_units[i]
    x, torque, std, is_distance = compensated_curve(friction, location)
    band = style.band_95(torque, std)
    curves = [Curve(1e3 * x, torque, "friction", style.FITTED, band=band, band_label="95 % interval")]
    for coulomb in () if modelled is None else (modelled, -modelled):
        ends, looks = 1e3 * x[[0, -1]], {"ls": "--"}
        curves.append(Curve(ends, [coulomb, coulomb], "F_c of the robot model", style.TRUTH, looks=looks))
    F_c, F_c_std = friction.coulomb_friction(location)
    length, quantity = ("mm", "force") if unit == "N" else ("mrad", "torque")
    label = f"distance from a reversal in {length}" if is_distance else f"velocity in {length}/s"
    unit = style.pretty_unit(unit)
    title = f"{location}: F_c = {F_c:.4g} ± {QUANTILE_95 * F_c_std:.2g} {unit}"
    return Panel(curves, label, f"{quantity} in {unit}", title)


def _unexplained_panel(friction: CompensatedFriction, i: int) -> Panel:
    x = np.arange(len(friction.configurations))
    kinds = (
        (friction.before[:, i], "none", "before compensation"),
        (friction.after[:, i], style.MEASURED, "after compensation"),
    )
    curves = [Curve(x, y, text, dots=True, looks={"mew": 1, "mfc": face}) for y, face, text in kinds]
    unit = style.pretty_unit(friction.place_units[i])
    return Panel(curves, "", f"amplitude in {unit}", f"{friction.places[i]}: noise and distortion", y_ends=(0.0, None))
