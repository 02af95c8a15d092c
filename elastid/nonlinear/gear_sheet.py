r"""The sheet of each gear from the levels of its effects: makers' numbers with intervals, or bounds, and its torsion.

.. math:: \tau = k\, \delta + \sum_i f_i\, \Phi_i(\delta), \qquad
          \sigma_\delta = \frac{\sqrt{r\, C\, r^T}}{d\tau / d\delta}, \quad r = \partial \tau / \partial (x, f)

delta runs to and fro as in a maker's test, up to the largest torque of the records. Stiffness by range is the secant
of the spring over a third of that torque each; hysteresis the width of the loop where the torque is 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import DataError, Note
from elastid.base.execution import Execution
from elastid.fit.result import Result
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.modes import modes
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.nonlinear.drives import DriveLines, elastic_joints, without_arm
from elastid.nonlinear.effects import GearEffect, implicit_law
from elastid.nonlinear.gear_choice import SPRINGS, Group, bent_gears, choose_effects, family_of, level_bounds
from elastid.nonlinear.gear_levels import GearData, Levels
from elastid.nonlinear.gear_motion import Estimate, residuals
from elastid.nonlinear.gear_result import BENT_STILL, GearNumber, GearResult, GearSheet
from elastid.nonlinear.spec import GearsSpec
from elastid.nonlinear.spectra import PeriodLines, gather_lines
from elastid.record import Record
from elastid.response import BENT, NOT_STRAIGHT, UNEXPLAINED, Response
from elastid.robot import Robot

_SOLVED = ("converged", "noise_unknown", "at_bound", "misfit")
# Of the motion what does not repeat, and of a gear's rms deflection at the excited lines noise of its motor's angle,
# above which nothing is looked for. Below it counts as noise: k of sets unsettled by 1.7 to 7.5 % was at most 0.05 %
# and 1.7 std off; of 23 clean sets, which wander by up to 6.6 % (scripts/studies/results.csv), none had a wrong effect.
# A count moves numbers sooner: k was 2.1 and 4.2 std off with counts of 1/16 of the deflection, 1.1 and 1.3 with 1/65.
HIDDEN, COUNT = 0.1, 0.025
# Names of modification indices that make a channel late.
_LATE = ("delay", "low_pass", "hold", "torque_lag", "sensor_lag")
LOST = "stiffness, damping and friction stay those of the linear fit"
HYSTERESIS = ("stop", "bristle")


def open_gears(
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
    """Effects of all gears with the parameters beside them, and the sheet of each gear.

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
        return replace(nothing, refused=f"no driven joint of robot {robot.name} {no_spring}; {LOST}")
    try:
        lines = execution.quiet.ordered(partial(gather_lines, spec=spec, planned=planned), measured)
        linear = GearData(lines, responses, linearisation)
        drives = linear.drives(result.parameters, result.x)
        if reason := refusal(linear, drives, result):
            return replace(nothing, refused=reason)
        data = replace(linear, lines=[without_arm(*pair, robot) for pair in zip(lines, drives, strict=True)])
    except DataError as error:
        return replace(nothing, refused=f"{error}; {LOST}")
    execution.progress(0, 3)
    found = choose_effects(data, result.parameters, result.x, bent_gears(linear, robot), gears.orders)
    execution.progress(2, 3)  # the search takes about two thirds of the time
    bounds = level_bounds(data, found, gears.orders)
    execution.progress(3, 3)
    pairs = [*zip(data.lines, found.drives, strict=True)]
    peaks = [max(float(np.abs(gear_torque(*pair, j)).max()) for pair in pairs) for j in range(len(data.joints))]
    sheets = tuple(
        sheet_of(JointLevels(found, robot, joint, peak), result, bounds)
        for joint, peak in zip(data.joints, peaks, strict=True)
        if joint in elastic
    )
    notes = (
        *coarse_encoders(data.lines, drives),
        *rigid_gears([joint for joint in data.joints if joint not in elastic]),
        *bent_notes(data, found),
    )
    nothing_acts = [Estimate.start(each, drive, 0) for each, drive in zip(lines, drives, strict=True)]
    before = left(linear, drives, nothing_acts, np.zeros(0))
    after = left(data, found.drives, found.estimates, found.levels)
    own = found.x, found.covariance, found.effects, found.levels, sheets
    return GearResult(*own, before=before, after=after, notes=notes)


def refusal(data: GearData, drives: Sequence[DriveLines], result: Result) -> str:
    """Why no effects of gears can be found, and what is lost; empty where they can."""
    if result.status not in _SOLVED:
        ended = result.status.replace("_", " ")
        return f"the fit ended as {ended}, and effects of gears are found beside a model that fits"
    if len(np.unique(np.concatenate([lines.realisation for lines in data.lines]))) < 2:
        return (
            "the records are of one realisation, and an effect is taken where it predicts those that it was not fitted "
            f"to; measure two or more realisations; {LOST}"
        )
    late = next((index for index in result.indices if index.name.startswith(_LATE) and index.share > 0.5), None)
    # A late torque distorts nothing.
    is_distorted = any(note.code == UNEXPLAINED for G in data.responses for note in G.notes)
    if late is not None and result.status == "misfit" and not is_distorted:
        return (
            f"the fit finds {late.name} ({100 * late.share:.0f} % of the excess of V): the logged torque is not the "
            "one that acts, and effects of gears would follow the difference; give the robot's chain its torque_lag, "
            f"or free the delay; {LOST}"
        )
    apart = {lines.configuration.name: difference(lines) for lines in data.lines}
    if moving := [name for name, share in apart.items() if share > HIDDEN]:
        return (
            f"the records of {', '.join(moving)} are not settled, or disturbed: their periods differ by up to "
            f"{100 * max(apart.values()):.2g} % of the motion, and effects of gears are found between the excited "
            "lines, where a transient lies, too; measure more periods and leave the first out "
            f"(estimator.transient_periods); {LOST}"
        )
    first = min(float(modes(drive.model, drive.theta).freq_hz.min(initial=np.inf)) for drive in drives)
    highest = max(float(lines.freq_hz[lines.excited].max()) for lines in data.lines)
    if first > highest:
        return (
            f"the first mode, {first:.3g} Hz, lies above the highest excited line, {highest:.3g} Hz: motors and links "
            "move as one, so that nothing behind a gear is distinguished from the same before it; excite higher lines; "
            f"{LOST}"
        )
    coarse = coarse_encoders(data.lines, drives)
    if coarse and len(coarse) == sum(bool(row.any()) for row in drives[0].places["gear"]):
        return f"{coarse[0]}; {LOST}"
    return ""


def difference(lines: PeriodLines) -> float:
    """RMS of the mean over the periods by their scatter, less the noise of the angles, over that of the motion."""
    motion = np.sum(np.mean(np.abs(lines.Y) ** 2, axis=2), axis=0)
    scatter = np.sum(lines.scatter - lines.noise, axis=0)
    return float(np.sqrt(np.max(np.maximum(scatter, 0.0) / motion)))


def coarse_encoders(data: Sequence[PeriodLines], drives: Sequence[DriveLines]) -> list[Note]:
    """Joints whose deflection is not large against the noise of their motor's angle, or a count of its encoder."""
    notes = []
    for j, joint in enumerate(drives[0].joints):
        if not drives[0].directions("gear", j).any():
            continue
        bent, noise, counts = [], [], []
        for lines, drive in zip(data, drives, strict=True):
            on, row = lines.excited, drive.motor_row(j)
            bent.append(np.sum(np.mean(np.abs(drive.moved("gear", j, lines.U)[on]) ** 2, axis=1)))
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
    """Torque (M, n) of a gear on the fine grid by the linear model, with that at rest."""
    of_motion = (drive.k[j] + lines.s * drive.d[j]) * drive.moved("gear", j, lines.U).T
    return np.asarray(lines.fine(of_motion) + drive.torque[j])


def rigid_gears(joints: Sequence[str]) -> list[Note]:
    """Gears of which the model has no deflection, and so the friction of their motors alone."""
    text = (
        "its gear has no spring of its own in the model (rigid, or in series with that of a shaft), so that friction "
        "at its motor alone was looked for; what the gear does otherwise is left out, and has no bound"
    )
    return [Note("gears/left-out", text, f"joint {joint}", "information") for joint in joints]


def bent_notes(data: GearData, found: Levels) -> list[Note]:
    """Gears that are no straight springs, of which neither law, hysteresis nor transmission error was found."""
    kinds = (*SPRINGS, *HYSTERESIS, "error sine", "error cosine")
    laws = {effect.joint for effect in found.effects if effect.kind in kinds}
    every = (note.text for G in data.responses for note in G.notes if note.code == NOT_STRAIGHT)
    bent = dict.fromkeys(text.removeprefix(BENT).partition(" is ")[0].strip() for text in every)
    text = "its gear is no straight spring, and nothing of it was found: its stiffness is that of this amplitude"
    return [Note(BENT_STILL, text, f"joint {joint}") for joint in bent if joint not in laws]


def left(data: GearData, drives: Sequence[DriveLines], estimates: Sequence[Estimate], levels: FloatArray) -> float:
    """Share of the motors' motion at the excited lines that a model with effects of these levels leaves, rms."""
    shares = []
    for lines, drive, estimate in zip(data.lines, drives, estimates, strict=True):
        signals = residuals(lines, drive, estimate, levels), lines.Y
        r, motion = (np.sum(np.abs(x[lines.excited]) ** 2, axis=(1, 2)) for x in signals)
        shares.append(np.mean(r / motion))
    return float(np.sqrt(np.mean(shares)))


@dataclass(frozen=True, eq=False)
class JointLevels:
    """The levels at the gear of a joint: values with rows d value / d (x, f), from which standard deviations follow."""

    found: Levels
    robot: Robot
    joint: str
    peak: float

    @property
    def effects(self) -> list[tuple[int, GearEffect, float]]:
        """Effects at the joint, with place and level."""
        pairs = enumerate(zip(self.found.effects, self.found.levels.tolist(), strict=True))
        return [(i, effect, f) for i, (effect, f) in pairs if effect.joint == self.joint]

    def parameter(self, name: str) -> tuple[float, FloatArray]:
        """A parameter of the model, and its row."""
        found, row = self.found, np.zeros(len(self.found.covariance))
        place = found.parameters.names.index(name)
        row[: len(found.x)] = found.parameters.jacobian(found.x)[place]
        return float(found.parameters.expand(found.x)[place]), row

    def level_row(self, weights: Mapping[int, float]) -> FloatArray:
        """The row of a sum of levels by place."""
        row = np.zeros(len(self.found.covariance))
        for i, weight in weights.items():
            row[len(self.found.x) + i] = weight
        return row

    def std(self, row: FloatArray) -> float:
        """Standard deviation of a value by its row."""
        return math.sqrt(max(float(row @ self.found.covariance @ row), 0.0))

    def torque(self, delta: FloatArray, hysteresis: bool) -> tuple[FloatArray, FloatArray]:
        """tau (n,) over a closed path of delta (n,), and its rows (n, n_x + n_f); hysteresis: with it."""
        k, row = self.parameter(f"k_{self.joint}")
        tau, rows = k * delta, delta[:, None] * row
        for i, effect, f in self.effects:
            if effect.is_implicit and effect.place == "gear" and (hysteresis or effect.kind not in HYSTERESIS):
                phi = implicit_law(effect, delta)[0]
                tau = tau + f * phi
                rows = rows + phi[:, None] * self.level_row({i: 1.0})
        return tau, rows

    @property
    def is_linear(self) -> bool:
        """One stiffness at every torque."""
        kinds = [e.kind for _, e, _ in self.effects if e.is_implicit and e.place == "gear"]
        return not any(kind not in HYSTERESIS for kind in kinds)

    def largest(self) -> float:
        """Deflection at the largest torque of the records."""
        reach = self.peak / self.parameter(f"k_{self.joint}")[0]
        for _ in range(40):
            tau = float(self.torque(np.array([0.0, reach]), hysteresis=False)[0][1])
            # A spring that softens may not bear that torque at all.
            reach *= min(max(1 + 0.7 * (self.peak / tau - 1), 0.5), 2.0)
        return reach


def sheet_of(gear: JointLevels, result: Result, bounds: Mapping[Group, float]) -> GearSheet:
    """The numbers of a gear, those of the linear fit beside them, and its torsion; bounds: of groups of effects."""
    reach = gear.largest()
    rated = next(each.limits.torque for each in gear.robot.driven if each.name == gear.joint)
    numbers = [*_springs(gear, result, reach), *_lost_motion(gear), *_loop_numbers(gear, reach)]
    numbers += [*_frictions(gear), *_periodic(gear)]
    seen = {each.name for each in numbers}
    numbers += [each for each in _unseen(gear, bounds, reach) if each.name not in seen]
    numbers = [
        replace(each, rated_share=(each.value if each.is_seen else each.bound) / rated)
        if each.kind == "torque" and math.isfinite(rated) else each
        for each in numbers
    ]  # fmt: skip
    way = reach * np.linspace(-1, 1, 200)
    delta = np.concatenate([way, -way])
    tau, rows = gear.torque(delta, hysteresis=True)
    slope = np.maximum(np.gradient(gear.torque(way, hysteresis=False)[0], way), 1e-300)
    std = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", rows, gear.found.covariance, rows), 0.0))
    ordered = sorted(numbers, key=lambda each: _ORDER.index(each.name.partition("_")[0].rstrip("0123456789.")))
    # Within a gap a torque says nothing of the torsion.
    torsion_std = np.minimum(std / np.concatenate([slope, slope[::-1]]), reach)
    return GearSheet(gear.joint, tuple(ordered), gear.peak, tau, delta, torsion_std)


_WIDTH = "hysteresis, width of the loop"
# Letters of names in the order of a sheet.
_ORDER = ("k", "K", "h", "d", "lost", "H", "Hw", "e", "Fc", "Fb", "Fcl", "r")


def _springs(gear: JointLevels, result: Result, reach: float) -> list[GearNumber]:
    """Stiffness at zero torque and by range, and damping."""
    joint, numbers = gear.joint, []
    has_gap = any(effect.kind == "gap" for _, effect, _ in gear.effects)
    spring = "stiffness beyond the gap" if has_gap else "stiffness at zero torque"
    words = {"k": (spring, "stiffness", "N*m/rad"), "d": ("damping", "damping", "N*m*s/rad")}
    slides = gear.robot.slides(f"motor {joint}")
    for letter, (meaning, kind, unit) in words.items():
        value, row = gear.parameter(f"{letter}_{joint}")
        own = result.parameters.expand(result.x)[result.parameters.names.index(f"{letter}_{joint}")]
        unit = unit.replace("N*m", "N").replace("rad", "m") if slides else unit
        numbers.append(GearNumber(f"{letter}_{joint}", meaning, kind, unit, value, gear.std(row), linear=float(own)))
    if gear.is_linear:
        return numbers
    delta = np.linspace(0, reach, 601)
    tau, rows = gear.torque(np.concatenate([delta, delta[::-1]]), hysteresis=False)
    ends = np.searchsorted(tau[:601], gear.peak * np.arange(4) / 3).clip(0, 600)
    for i, (low, high) in enumerate(pairwise(ends.tolist()), start=1):
        if high == low:
            continue
        width = delta[high] - delta[low]
        meaning = f"stiffness from {tau[low]:.3g} to {tau[high]:.3g} Nm"
        value, row = (tau[high] - tau[low]) / width, (rows[high] - rows[low]) / width
        numbers.append(GearNumber(f"K{i}_{joint}", meaning, "stiffness", "N*m/rad", float(value), gear.std(row)))
    if has_gap:  # a secant is softer than k, beyond the gap
        return numbers
    peak, row = gear.torque(np.array([0.0, reach]), hysteresis=False)
    k, of_k = gear.parameter(f"k_{joint}")
    share = peak[1] / (k * reach) - 1
    of_share = (row[1] - (1 + share) * reach * of_k) / (k * reach)
    meaning = f"stiffening up to {gear.peak:.3g} Nm, of the secant"
    numbers.append(GearNumber(f"h_{joint}", meaning, "share", "1", float(share), gear.std(of_share)))
    return numbers


def _lost_motion(gear: JointLevels) -> list[GearNumber]:
    """2 f b / k: the way between the lines of the two flanks at zero torque, all of the gap where it is free."""
    own = {i: 2 * effect.scale for i, effect, _ in gear.effects if effect.kind == "gap"}
    if not own:
        return []
    k, of_k = gear.parameter(f"k_{gear.joint}")
    value = sum(own[i] * f for i, _, f in gear.effects if i in own) / k
    row = (gear.level_row(own) - value * of_k) / k
    of_ends = [2 * f * gear.found.scale_std[i] / k for i, _, f in gear.effects if i in own]
    std = math.hypot(gear.std(row), *of_ends)
    return [GearNumber(f"lost_{gear.joint}", *_WORDS["gap"][1:], value, std)]


def _loop_numbers(gear: JointLevels, reach: float) -> list[GearNumber]:
    """Hysteresis: half the difference of torque, and the width of the loop in torsion, at zero."""
    own = [(i, effect, f) for i, effect, f in gear.effects if effect.kind in HYSTERESIS]
    if not own:
        return []
    path = reach * np.concatenate([np.linspace(-1, 1, 201), np.linspace(1, -1, 201)])
    weights = {}
    for i, effect, _ in own:
        phi = implicit_law(effect, path)[0]
        weights[i] = float(phi[100] - phi[301]) / 2
    value = sum(f * weights[i] for i, _, f in own)
    row, (k, of_k) = gear.level_row(weights), gear.parameter(f"k_{gear.joint}")
    width, of_width = 2 * value / k, (2 * row - 2 * value / k * of_k) / k
    return [
        GearNumber(f"H_{gear.joint}", *_WORDS["stop"][1:], value, gear.std(row)),
        GearNumber(f"Hw_{gear.joint}", _WIDTH, "angle", "rad", width, gear.std(of_width)),
    ]


# Prefix of the name, meaning, kind and unit of the number of each family of effects.
_WORDS = {
    "friction": ("Fc_m", "running torque before the gear", "torque", "N*m"),
    "behind": ("Fb_", "running torque behind the gear", "torque", "N*m"),
    "load": ("Fcl_m", "friction by load, of the gear's torque", "share", "1"),
    "stop": ("H_", "hysteresis, torque to either side", "torque", "N*m"),
    "gap": ("lost_", "lost motion", "angle", "rad"),
    "cubic": ("h_", "stiffening up to the largest torque, of the secant", "share", "1"),
    "error": ("e", "transmission error", "error", "rad"),
    "ripple": ("r", "ripple and cogging of the torque", "torque", "N*m"),
}


def _frictions(gear: JointLevels) -> list[GearNumber]:
    """Levels of friction."""
    numbers = []
    for kind in ("friction", "behind", "load"):
        prefix, meaning, what, unit = _WORDS[kind]
        own = {i: 1.0 for i, effect, _ in gear.effects if effect.kind == kind}
        if own:
            row, value = gear.level_row(own), sum(f for i, _, f in gear.effects if i in own)
            numbers.append(GearNumber(f"{prefix}{gear.joint}", meaning, what, unit, value, gear.std(row)))
    return numbers


def _periodic(gear: JointLevels) -> list[GearNumber]:
    """Amplitude and phase of a sin(n theta) + b cos(n theta) = A sin(n theta + phi)."""
    numbers = []
    for word in ("error", "ripple"):
        letter, meaning, what, unit = _WORDS[word]
        for order in dict.fromkeys(e.scale for _, e, _ in gear.effects if e.kind.split()[0] == word):
            a, b = ({i: f for i, e, f in gear.effects if e.kind == f"{word} {part}" and e.scale == order}
                    for part in ("sine", "cosine"))  # fmt: skip
            x, y = sum(a.values()), sum(b.values())
            size = math.hypot(x, y)
            row = gear.level_row(dict.fromkeys(a, x / size) | dict.fromkeys(b, y / size))
            turn = gear.level_row(dict.fromkeys(a, -y / size**2) | dict.fromkeys(b, x / size**2))
            numbers.append(GearNumber(
                f"{letter}{order:g}_{gear.joint}", f"{meaning}, {_times(order)}", what, unit, size, gear.std(row),
                order=order, phase=math.atan2(y, x), phase_std=gear.std(turn),
            ))  # fmt: skip
    return numbers


def _times(order: float) -> str:
    return {1.0: "once a motor turn", 2.0: "twice a motor turn"}.get(order, f"{order:g} times a motor turn")


def _unseen(gear: JointLevels, bounds: Mapping[Group, float], reach: float) -> list[GearNumber]:
    """Bounds of what was looked for and not found, of several shapes the largest."""
    largest: dict[str, GearNumber] = {}
    k = gear.parameter(f"k_{gear.joint}")[0]
    for (effect, *_), bound in bounds.items():
        for number in _bounded(effect, bound, k, reach) if effect.joint == gear.joint else ():
            if number.name not in largest or largest[number.name].bound < number.bound:
                largest[number.name] = number
    return [*largest.values()]


def _bounded(effect: GearEffect, bound: float, k: float, reach: float) -> list[GearNumber]:
    word, joint, order = family_of(effect)
    prefix, meaning, kind, unit = _WORDS[word]
    if order:
        name = f"{prefix}{order:g}_{joint}"
        return [GearNumber(name, f"{meaning}, {_times(order)}", kind, unit, bound=bound, order=order)]
    if (
        word == "stop"
    ):  # within the records it does not reach its level where it bends over more than they bend the gear
        bound *= min(1.0, reach / effect.scale)
    if word == "gap":
        if bound > k:  # of a gear that never crosses it
            return []
        bound *= 2 * effect.scale / k
    if word == "cubic":
        bound *= abs(float(implicit_law(effect, np.array([0.0, reach]))[0][1])) / (k * reach)
    numbers = [GearNumber(f"{prefix}{joint}", meaning, kind, unit, bound=bound)]
    if word == "stop":
        numbers.append(GearNumber(f"Hw_{joint}", _WIDTH, "angle", "rad", bound=2 * bound / k))
    return numbers
