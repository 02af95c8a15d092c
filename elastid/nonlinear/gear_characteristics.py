r"""Gearbox characteristics by the magnitudes of effects: makers' numbers with intervals or bounds, and torsion.

.. math:: \tau = k\, \delta + \sum_i f_i\, \Phi_i(\delta), \qquad
          \sigma_\delta = \frac{\sqrt{r\, C\, r^T}}{d\tau / d\delta}, \quad r = \partial \tau / \partial (x, f)

delta runs to and fro as in a maker's test, up to the largest torque of the records. Stiffness by range is the secant
of the spring over a third of that torque each; hysteresis the width of the loop where the torque is 0.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import DataError, Note, StudyError, notes_of
from elastid.base.execution import Execution
from elastid.fit.result import Result
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.modes import modes
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
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
from elastid.nonlinear.gear_estimation import GearData, GearEstimate
from elastid.nonlinear.gear_model_selection import Group, choose_effects, magnitude_bounds
from elastid.nonlinear.gear_result import GearNumber, GearResult, GearSheet
from elastid.nonlinear.hidden_motion_smoother import SmoothedMotion, residuals
from elastid.nonlinear.period_model import DriveLines, elastic_joints, without_arm
from elastid.nonlinear.spec import GearsSpec
from elastid.nonlinear.spectra import PeriodLines, gather_lines
from elastid.record import Record
from elastid.response import UNEXPLAINED, Response
from elastid.robot import Robot

_VALID_STATUSES = ("converged", "noise_unknown", "at_bound", "misfit")
# Of the motion what does not repeat, and of a gear's rms deflection at the excited lines noise of its motor's angle,
# above which nothing is looked for. Below it counts as noise: k of sets unsettled by 1.7 to 7.5 % was at most 0.05 %
# and 1.7 std off; of 23 clean sets, which wander by up to 6.6 % (scripts/studies/results.csv), none had a wrong effect.
# A count moves numbers sooner: k was 2.1 and 4.2 std off with counts of 1/16 of the deflection, 1.1 and 1.3 with 1/65.
HIDDEN, COUNT = 0.1, 0.025
# Names of modification indices that make a channel late.
_LATE = ("delay", "low_pass", "hold", "torque_lag", "sensor_lag")
FALLBACK = "stiffness, damping and friction stay those of the linear fit"


def identify_gears(
    measured: Sequence[Iterable[Record]],
    responses: Sequence[Response],
    result: Result,
    robot: Robot,
    spec: EstimatorSpec,
    gears: GearsSpec,
    execution: Execution | None = None,
    model: ModelSpec = EXACT,
    planned: IntArray | None = None,
) -> GearResult:
    """Estimate the effects of all gears together with the parameters, and the characteristics of each gear.

    measured, responses: of each fitted configuration in one order.  result: the fit of these responses with straight
    springs, to which the effects add (`with_straight_springs`).  Where nothing can be found the numbers are those of
    the fit, and `refused` says why.
    Raises StudyError as `analysed_lines` does.
    """
    execution = execution or Execution()
    nothing = GearResult(result.x, result.covariance)
    linearisation = Linearisation.of_robot(robot, model, result.parameters.names)
    elastic = elastic_joints(linearisation)
    if not elastic:
        no_spring = "has a spring in its gear, by which its effects would be found; give joints a spring"
        return replace(nothing, refused=f"no driven joint of robot {robot.name} {no_spring}; {FALLBACK}")
    try:
        lines = execution.quiet.ordered(partial(gather_lines, spec=spec, planned=planned), measured)
        linear = GearData(lines, responses, linearisation)
        drives = linear.drives(result.parameters, result.x)
        if reason := refusal(linear, drives, result):
            return replace(nothing, refused=reason)
        data = replace(linear, lines=[without_arm(*pair, robot) for pair in zip(lines, drives, strict=True)])
    except (DataError, StudyError) as error:
        return replace(nothing, refused=f"{error}; {FALLBACK}")
    execution.progress(0, 3)
    estimate = choose_effects(data, result.parameters, result.x, gears.orders)
    execution.progress(2, 3)  # the search takes about two thirds of the time
    bounds = magnitude_bounds(data, estimate, gears.orders)
    execution.progress(3, 3)
    pairs = [*zip(data.lines, estimate.drives, strict=True)]
    peaks = [max(float(np.abs(gear_torque(*pair, j)).max()) for pair in pairs) for j in range(len(data.joints))]
    sheets = tuple(
        sheet_of(JointEffects(estimate, robot, joint, peak), result, bounds)
        for joint, peak in zip(data.joints, peaks, strict=True)
        if joint in elastic
    )
    rigid = [joint for joint in data.joints if joint not in elastic]
    notes = (*coarse_encoders(data.lines, drives), *rigid_gears(rigid))
    nothing_acts = [SmoothedMotion.start(grid, drive, 0) for grid, drive in zip(lines, drives, strict=True)]
    fraction_before = unexplained_fraction(linear, drives, nothing_acts, np.zeros(0))
    fraction_after = unexplained_fraction(data, estimate.drives, estimate.estimates, estimate.magnitudes)
    numbers = estimate.x, estimate.covariance, estimate.effects, estimate.magnitudes, sheets
    return GearResult(*numbers, before=fraction_before, after=fraction_after, notes=notes)


def refusal(data: GearData, drives: Sequence[DriveLines], result: Result) -> str:
    """Return the reason why no gear effects can be estimated, with its consequence; empty if they can."""
    if result.status not in _VALID_STATUSES:
        status = result.status.replace("_", " ")
        return f"the fit ended as {status}, and effects of gears are found beside a model that fits"
    if len(np.unique(np.concatenate([lines.realisation for lines in data.lines]))) < 2:
        return (
            "the records are of one realisation, and an effect is taken where it predicts those that it was not fitted "
            f"to; measure two or more realisations; {FALLBACK}"
        )
    lag = next(
        (index for index in result.indices if index.name.startswith(_LATE) and index.explained_fraction > 0.5), None
    )
    # A late torque distorts nothing.
    is_distorted = any(note.code == UNEXPLAINED for note in notes_of(data.responses))
    if lag is not None and result.status == "misfit" and not is_distorted:
        return (
            f"the fit finds {lag.name} ({100 * lag.explained_fraction:.0f} % of the excess of V): the logged torque "
            "differs from the acting one, and effects of gears would follow; give the robot's chain its torque_lag, "
            f"or free the delay; {FALLBACK}"
        )
    ratios = {lines.configuration.name: difference(lines) for lines in data.lines}
    if moving := [name for name, ratio in ratios.items() if ratio > HIDDEN]:
        return (
            f"the records of {', '.join(moving)} are not settled, or disturbed: their periods differ by up to "
            f"{100 * max(ratios.values()):.2g} % of the motion, and effects of gears are found between the excited "
            "lines, where a transient lies, too; measure more periods and leave the first out "
            f"(estimator.transient_periods); {FALLBACK}"
        )
    first = min(float(modes(drive.model, drive.theta).freq_hz.min(initial=np.inf)) for drive in drives)
    highest = max(float(lines.freq_hz[lines.excited].max()) for lines in data.lines)
    if first > highest:
        return (
            f"the first mode, {first:.3g} Hz, lies above the highest excited line, {highest:.3g} Hz: motors and links "
            "move as one, so that nothing behind a gear is distinguished from the same before it; excite higher lines; "
            f"{FALLBACK}"
        )
    coarse = coarse_encoders(data.lines, drives)
    if coarse and len(coarse) == sum(bool(row.any()) for row in drives[0].places["gear"]):
        return f"{coarse[0]}; {FALLBACK}"
    return ""


def difference(lines: PeriodLines) -> float:
    """Return the ratio of the rms error of the mean over periods, without encoder noise, to the rms motion."""
    motion = np.sum(np.mean(np.abs(lines.Y) ** 2, axis=2), axis=0)
    scatter = np.sum(lines.scatter - lines.noise, axis=0)
    return math.sqrt(np.max(np.maximum(scatter, 0.0) / motion))


def coarse_encoders(data: Sequence[PeriodLines], drives: Sequence[DriveLines]) -> list[Note]:
    """Return a note for each joint with a small deflection relative to the noise or the count of its encoder."""
    notes = []
    for j, joint in enumerate(drives[0].joints):
        if not drives[0].directions("gear", j).any():
            continue
        bent, noise, counts = [], [], []
        for lines, drive in zip(data, drives, strict=True):
            on, row = lines.excited, drive.motor_row(j)
            bent.append(np.sum(np.mean(np.abs(drive.motion("gear", j, lines.U)[on]) ** 2, axis=1)))
            noise.append(np.sum(lines.scatter[on] @ row**2))
            counts.append(np.abs(row) @ lines.count)
        size, error, count = np.sqrt(np.mean(bent) / 2), np.sqrt(np.mean(noise) / 2), max(counts)
        if error > HIDDEN * size or count > COUNT * size:
            text = (
                f"its angle has {error:.2g} rad of noise at the excited lines and counts of {count:.2g} rad, and its "
                f"gear bends by {size:.2g} rad: effects of this gear are hidden, and its numbers may be off by more "
                "than they state; take an encoder of more counts, more periods, or more torque"
            )
            notes.append(Note("gears/coarse-encoder", text, f"motor {joint}"))
    return notes


def gear_torque(lines: PeriodLines, drive: DriveLines, j: int) -> FloatArray:
    """Return the torque (M, n) of a gear on the fine grid by the linear model, including its static torque."""
    of_motion = (drive.k[j] + lines.s * drive.d[j]) * drive.motion("gear", j, lines.U).T
    return np.asarray(lines.fine(of_motion) + drive.torque[j])


def rigid_gears(joints: Sequence[str]) -> list[Note]:
    """Return a note on each gear without a deflection in the model; only friction of its motor is estimated."""
    text = (
        "its gear has no spring of its own in the model (rigid, or in series with that of a shaft), so that friction "
        "at its motor alone was looked for; what the gear does otherwise is left out, and has no bound"
    )
    return [Note("gears/effect-discarded", text, f"joint {joint}", "information") for joint in joints]


def unexplained_fraction(
    data: GearData, drives: Sequence[DriveLines], estimates: Sequence[SmoothedMotion], magnitudes: FloatArray
) -> float:
    """Return the unexplained fraction of the motors' motion at the excited lines, rms, with these magnitudes."""
    fractions = []
    for lines, drive, estimate in zip(data.lines, drives, estimates, strict=True):
        signals = residuals(lines, drive, estimate, magnitudes), lines.Y
        r, motion = (np.sum(np.abs(x[lines.excited]) ** 2, axis=(1, 2)) for x in signals)
        fractions.append(np.mean(r / motion))
    return math.sqrt(np.mean(fractions))


@dataclass(frozen=True, eq=False)
class JointEffects:
    """Effects at the gear of a joint: values with rows d value / d (x, f), from which standard deviations follow."""

    estimate: GearEstimate
    robot: Robot
    joint: str
    peak: float

    @property
    def effects(self) -> list[tuple[int, GearEffect, float]]:
        """Effects at the joint, with place and magnitude."""
        pairs = enumerate(zip(self.estimate.effects, self.estimate.magnitudes.tolist(), strict=True))
        return [(i, effect, f) for i, (effect, f) in pairs if effect.joint == self.joint]

    @property
    def is_linear(self) -> bool:
        """One stiffness at every torque."""
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
        """Return tau (n,) over a closed path of delta (n,), and its rows (n, n_x + n_f); hysteresis: with it."""
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
            # A spring that softens may not bear that torque at all.
            deflection *= min(max(1 + 0.7 * (self.peak / tau - 1), 0.5), 2.0)
        return deflection


def sheet_of(gear: JointEffects, result: Result, bounds: Mapping[Group, float]) -> GearSheet:
    """Return characteristics of a gear, with the linear fit's, and its torsion curve. bounds: by groups of effects."""
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
    # Within a gap a torque says nothing of the torsion.
    torsion_std = np.minimum(std / np.concatenate([slope, slope[::-1]]), deflection)
    return GearSheet(gear.joint, tuple(rows_in_order), gear.peak, tau, delta, torsion_std)


# Letters of names in the order of a sheet.
_ORDER = ("k", "K", "h", "d", "lost", "H", "Hw", "e", "Fc", "Fb", "Fcl", "r")


def _named_number(entry: SheetNumber, joint: str, order: float = 0.0, **further: float) -> GearNumber:
    if not order:
        return GearNumber(f"{entry.prefix}{joint}", entry.meaning, entry.kind, entry.unit, **further)
    times = {1.0: "once a motor turn", 2.0: "twice a motor turn"}.get(order, f"{order:g} times a motor turn")
    name, meaning = f"{entry.prefix}{order:g}_{joint}", f"{entry.meaning}, {times}"
    return GearNumber(name, meaning, entry.kind, entry.unit, order=order, **further)


def _springs(gear: JointEffects, result: Result, deflection: float) -> list[GearNumber]:
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
    if not has_gap:  # a secant is softer than k, beyond the gap
        ratio, row = gear.over_k(float(tau[600]) / deflection, rows[600] / deflection)
        meaning = f"hardening of the secant stiffness up to {gear.peak:.3g} N*m"
        numbers.append(gear.number(replace(STIFFENING, meaning=meaning), ratio - 1, row))
    return numbers


def _torque_numbers(gear: JointEffects, deflection: float) -> list[GearNumber]:
    """Return magnitudes of friction and hysteresis: half the torque difference, and the loop width in torsion, at 0.

    Lost motion 2 f b / k: the way between the lines of the two flanks at zero torque, all of the gap where it is free.
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
    for entry, at in weights.items():
        value, row = gear.magnitudes(at)
        if entry == LOST_MOTION:
            end_effects = [
                2 * f * gear.estimate.scale_std[i] / gear.parameter("k")[0] for i, _, f in gear.effects if i in at
            ]
            number = gear.number(entry, *gear.over_k(value, row))
            numbers.append(replace(number, std=math.hypot(number.std, *end_effects)))
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
    largest: dict[str, GearNumber] = {}
    k = gear.parameter("k")[0]
    for (effect, *_), limit in bounds.items():
        for number in _bounded_effect(effect, limit, k, deflection) if effect.joint == gear.joint else ():
            if number.name not in largest or largest[number.name].bound < number.bound:
                largest[number.name] = number
    return [*largest.values()]


def _bounded_effect(effect: GearEffect, limit: float, k: float, deflection: float) -> list[GearNumber]:
    entry, joint = effect.row.number, effect.joint
    if entry == LOST_MOTION:
        # None of a gear that never crosses it.
        return [_named_number(entry, joint, bound=limit * 2 * effect.scale / k)] if limit <= k else []
    if entry == STIFFENING:
        limit *= abs(float(along_period(effect, np.array([0.0, deflection]))[0][1])) / (k * deflection)
    if entry != HYSTERESIS:
        return [_named_number(entry, joint, effect.order, bound=limit)]
    # Within the records it does not reach its magnitude where it bends over more than they bend the gear.
    limit *= min(1.0, deflection / effect.scale)
    return [_named_number(entry, joint, bound=limit), _named_number(WIDTH, joint, bound=2 * limit / k)]
