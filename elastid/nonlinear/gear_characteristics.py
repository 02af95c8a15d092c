r"""Gearbox characteristics from the magnitudes of gear effects, with intervals or upper bounds, and the torsion curve.

.. math:: \tau = k\, \delta + \sum_i f_i\, \Phi_i(\delta), \qquad
          \sigma_\delta = \frac{\sqrt{r\, C\, r^T}}{d\tau / d\delta}, \quad r = \partial \tau / \partial (x, f)

As in a manufacturer's test, delta follows a closed loop up to the largest torque of the records. Stiffness by range is
the secant of the spring over each third of this torque; hysteresis is the width of the loop at zero torque.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.result import Result
from elastid.nonlinear.basis_functions import (
    HYSTERESIS,
    LOOPS,
    LOST_MOTION,
    SECANT,
    SPRINGS,
    STIFFENING,
    WIDTH,
    GearEffect,
    SheetNumber,
    along_period,
)
from elastid.nonlinear.gear_estimation import GearEstimate
from elastid.nonlinear.gear_model_selection import Group
from elastid.nonlinear.gear_result import GearNumber, GearSheet
from elastid.robot import Robot


@dataclass(frozen=True, eq=False)
class JointEffects:
    """Effects at the gear of a joint: values, and their rows d value / d (x, f) for standard deviations.

    peak: largest torque of the gear in the records, Nm.
    """

    estimate: GearEstimate
    robot: Robot
    joint: str
    peak: float

    @property
    def effects(self) -> list[tuple[int, GearEffect, float]]:
        """Effects at the joint, each with its index and magnitude."""
        pairs = enumerate(zip(self.estimate.effects, self.estimate.magnitudes.tolist(), strict=True))
        return [(i, effect, f) for i, (effect, f) in pairs if effect.joint == self.joint]

    @property
    def is_linear(self) -> bool:
        """True if the stiffness is the same at every torque."""
        return not any(effect.kind in SPRINGS for _, effect, _ in self.effects)

    def parameter(self, letter: str) -> tuple[float, FloatArray]:
        """Return the stiffness k or damping d of the joint and its row."""
        parameters, x, row = self.estimate.parameters, self.estimate.x, np.zeros(len(self.estimate.covariance))
        index = parameters.names.index(f"{letter}_{self.joint}")
        row[: len(x)] = parameters.jacobian(x)[index]
        return float(parameters.expand(x)[index]), row

    def magnitudes(self, weights: Mapping[int, float]) -> tuple[float, FloatArray]:
        """Return the weighted sum of magnitudes and its row."""
        row = np.zeros(len(self.estimate.covariance))
        row[[len(self.estimate.x) + i for i in weights]] = [*weights.values()]
        return float(row[len(self.estimate.x) :] @ self.estimate.magnitudes), row

    def over_k(self, value: float, row: FloatArray) -> tuple[float, FloatArray]:
        """Return a value divided by the stiffness."""
        k, k_row = self.parameter("k")
        return value / k, (row - value / k * k_row) / k

    def number(self, entry: SheetNumber, value: float, row: FloatArray, **further: float) -> GearNumber:
        """Return a characteristic with its standard deviation."""
        return _named_number(entry, self.joint, value=value, std=self.std(row), **further)

    def std(self, row: FloatArray) -> float:
        """Return the standard deviation of a value by its row."""
        return math.sqrt(max(float(row @ self.estimate.covariance @ row), 0.0))

    def torque(self, delta: FloatArray, hysteresis: bool) -> tuple[FloatArray, FloatArray]:
        """Return tau (n,) along a closed path of delta (n,) and its rows (n, n_x + n_f), with or without hysteresis."""
        k, row = self.parameter("k")
        tau, rows = k * delta, delta[:, None] * row
        for i, effect, f in self.effects:
            if effect.kind in SPRINGS or (hysteresis and effect.kind in LOOPS):
                phi = along_period(effect, delta)[0]
                tau = tau + f * phi
                rows = rows + phi[:, None] * self.magnitudes({i: 1.0})[1]
        return tau, rows

    def largest(self) -> float:
        """Return the deflection at the largest torque of the records."""
        deflection = self.peak / self.parameter("k")[0]
        for _ in range(40):
            tau = float(self.torque(np.array([0.0, deflection]), hysteresis=False)[0][1])
            # A softening spring may not reach this torque.
            deflection *= min(max(1 + 0.7 * (self.peak / tau - 1), 0.5), 2.0)
        return deflection


def sheet_of(gear: JointEffects, result: Result, bounds: Mapping[Group, float]) -> GearSheet:
    """Return the characteristics of a gear and its torsion curve.

    result: linear fit, whose stiffness and damping are listed for comparison.  bounds: of insignificant effects.
    """
    deflection = gear.largest()
    rated_torque = next(driven.limits.torque for driven in gear.robot.driven if driven.name == gear.joint)
    numbers = [*_springs(gear, result, deflection), *_torque_numbers(gear, deflection), *_periodic(gear)]
    names = {number.name for number in numbers}
    numbers += [row for row in _insignificant_effects(gear, bounds, deflection) if row.name not in names]
    for i, row in enumerate(numbers):
        if row.kind == "torque" and math.isfinite(rated_torque):
            numbers[i] = replace(row, rated_fraction=(row.value if row.is_significant else row.bound) / rated_torque)
    flank = deflection * np.linspace(-1, 1, 200)
    delta = np.concatenate([flank, -flank])
    tau, rows = gear.torque(delta, hysteresis=True)
    slope = np.maximum(np.gradient(gear.torque(flank, hysteresis=False)[0], flank), 1e-300)
    std = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", rows, gear.estimate.covariance, rows), 0.0))
    rows_in_order = sorted(numbers, key=lambda row: _ORDER.index(row.name.partition("_")[0].rstrip("0123456789.")))
    # The torque does not determine the torsion within a gap.
    torsion_std = np.minimum(std / np.concatenate([slope, slope[::-1]]), deflection)
    return GearSheet(gear.joint, tuple(rows_in_order), gear.peak, tau, delta, torsion_std)


# Order of characteristics, by the letters of their names.
_ORDER = ("k", "K", "h", "d", "lost", "H", "Hw", "e", "Fc", "Fb", "Fcl", "r")


def _named_number(entry: SheetNumber, joint: str, order: float = 0.0, **further: float) -> GearNumber:
    """Return a characteristic with its name and meaning; order: per motor revolution, 0 if not periodic."""
    if not order:
        return GearNumber(f"{entry.prefix}{joint}", entry.meaning, entry.kind, entry.unit, **further)
    times = {1.0: "once a motor turn", 2.0: "twice a motor turn"}.get(order, f"{order:g} times a motor turn")
    name, meaning = f"{entry.prefix}{order:g}_{joint}", f"{entry.meaning}, {times}"
    return GearNumber(name, meaning, entry.kind, entry.unit, order=order, **further)


def _springs(gear: JointEffects, result: Result, deflection: float) -> list[GearNumber]:
    """Return stiffness and damping; for a nonlinear spring also the secants and, without a gap, the hardening."""
    has_gap = any(effect.kind == "gap" for _, effect, _ in gear.effects)
    spring = "stiffness beyond the gap" if has_gap else "stiffness at zero torque"
    per = ("N", "m") if gear.robot.slides(f"motor {gear.joint}") else ("N*m", "rad")
    stiffness, damping = f"{per[0]}/{per[1]}", f"{per[0]}*s/{per[1]}"
    numbers = [
        gear.number(SheetNumber(f"{letter}_", meaning, kind, unit), *gear.parameter(letter),
                    linear=float(result.values[f"{letter}_{gear.joint}"]))
        for letter, meaning, kind, unit in (("k", spring, "stiffness", stiffness), ("d", "damping", "damping", damping))
    ]  # fmt: skip
    if gear.is_linear:
        return numbers
    delta = np.linspace(0, deflection, 601)
    tau, rows = gear.torque(delta, hysteresis=False)
    ends = np.searchsorted(tau, gear.peak * np.arange(4) / 3).clip(0, 600)
    for i, (low, high) in enumerate(pairwise(ends.tolist()), start=1):
        if high > low:
            meaning = f"stiffness from {tau[low]:.3g} to {tau[high]:.3g} N*m"
            secant, row = ((x[high] - x[low]) / (delta[high] - delta[low]) for x in (tau, rows))
            numbers.append(gear.number(replace(SECANT, prefix=f"K{i}_", meaning=meaning), float(secant), row))
    if not has_gap:  # with a gap, k is the stiffness beyond it, and a secant is softer
        ratio, row = gear.over_k(float(tau[600]) / deflection, rows[600] / deflection)
        meaning = f"hardening of the secant stiffness up to {gear.peak:.3g} N*m"
        numbers.append(gear.number(replace(STIFFENING, meaning=meaning), ratio - 1, row))
    return numbers


def _torque_numbers(gear: JointEffects, deflection: float) -> list[GearNumber]:
    """Return friction, hysteresis (half the torque difference and the width of the loop, both at 0), and lost motion.

    Lost motion 2 f b / k is the distance between the two extrapolated flanks at zero torque.
    """
    numbers = []
    path = deflection * np.concatenate([np.linspace(-1, 1, 201), np.linspace(1, -1, 201)])
    weights: dict[SheetNumber, dict[int, float]] = {}
    for i, effect, _ in gear.effects:
        entry, weight = effect.row.number, 1.0
        if entry == HYSTERESIS:
            phi = along_period(effect, path)[0]
            weight = float(phi[100] - phi[301]) / 2
        elif entry == LOST_MOTION:
            weight = 2 * effect.scale
        if entry in (HYSTERESIS, LOST_MOTION) or (effect.place != "gear" and not effect.order):
            weights.setdefault(entry, {})[i] = weight
    k = gear.parameter("k")[0]
    for entry, of_effects in weights.items():
        value, row = gear.magnitudes(of_effects)
        if entry == LOST_MOTION:
            end_stds = [2 * f * gear.estimate.scale_std[i] / k for i, _, f in gear.effects if i in of_effects]
            number = gear.number(entry, *gear.over_k(value, row))
            numbers.append(replace(number, std=math.hypot(number.std, *end_stds)))
        else:
            numbers.append(gear.number(entry, value, row))
        if entry == HYSTERESIS:
            numbers.append(gear.number(WIDTH, *gear.over_k(2 * value, 2 * row)))
    return numbers


def _periodic(gear: JointEffects) -> list[GearNumber]:
    """Return amplitude and phase of a sin(n theta) + b cos(n theta) = A sin(n theta + phi)."""
    numbers = []
    for entry, order in dict.fromkeys((e.row.number, e.order) for _, e, _ in gear.effects if e.order):
        indices = {e.kind.split()[1]: i for i, e, _ in gear.effects if (e.row.number, e.order) == (entry, order)}
        (x, x_row), (y, y_row) = (
            gear.magnitudes({indices[phase]: 1.0} if phase in indices else {}) for phase in ("sine", "cosine")
        )
        size = math.hypot(x, y)
        phase_std = gear.std((x * y_row - y * x_row) / size**2)
        row = (x * x_row + y * y_row) / size
        numbers.append(gear.number(entry, size, row, order=order, phase=math.atan2(y, x), phase_std=phase_std))
    return numbers


def _insignificant_effects(gear: JointEffects, bounds: Mapping[Group, float], deflection: float) -> list[GearNumber]:
    """Return each bounded characteristic of a gear, with the largest bound of its effects."""
    largest: dict[str, GearNumber] = {}
    k = gear.parameter("k")[0]
    for (effect, *_), limit in bounds.items():
        for number in _bounded_effect(effect, limit, k, deflection) if effect.joint == gear.joint else ():
            if number.name not in largest or largest[number.name].bound < number.bound:
                largest[number.name] = number
    return [*largest.values()]


def _bounded_effect(effect: GearEffect, limit: float, k: float, deflection: float) -> list[GearNumber]:
    """Return the characteristics of an effect with magnitude `limit` as upper bounds."""
    entry, joint = effect.row.number, effect.joint
    if entry == LOST_MOTION:
        # A gear that never crosses a gap has no bound.
        return [_named_number(entry, joint, bound=limit * 2 * effect.scale / k)] if limit <= k else []
    if entry == STIFFENING:
        limit *= abs(float(along_period(effect, np.array([0.0, deflection]))[0][1])) / (k * deflection)
    if entry != HYSTERESIS:
        return [_named_number(entry, joint, effect.order, bound=limit)]
    # A hysteresis with a larger scale than the deflection does not reach its magnitude in the records.
    limit *= min(1.0, deflection / effect.scale)
    return [_named_number(entry, joint, bound=limit), _named_number(WIDTH, joint, bound=2 * limit / k)]
