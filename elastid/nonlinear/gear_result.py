"""GearResult: the effects of the gears of a robot with its parameters, and the characteristics of each gear.

The fit and the robot with what was found, as a robot's file states it.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import starmap
from typing import Literal

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import Note
from elastid.base.statistics import QUANTILE_95
from elastid.fit.result import Result
from elastid.fit.status_terms import CODES_WITH_CAUSE, DISTORTED, Status
from elastid.nonlinear.basis_functions import GearEffect
from elastid.parameters import Parameter, Parameters
from elastid.robot import Friction, Gear, GearRipple, Hysteresis, Joint, Robot, Spring, TransmissionError
from elastid.robot.friction_numbers import with_laws
from elastid.robot.simplified import with_joints, with_straight_springs, without_dry_friction

# Largest residual relative to the linear fit's for gear effects that explain its misfit: 5 correct models have at most
# 0.014, 4 wrong models at least 0.6 (scripts/studies/results.csv).
MAX_UNEXPLAINED = 0.25
NOT_EXPLAINED = "the effects found in its gears do not explain it"
NOT_OPENED = "the effects of the gears were not estimated (see the line `gears`)"
# Makers' units over SI.
ARCMIN, ARCSEC = 180 * 60 / math.pi, 180 * 3600 / math.pi
_MAKERS: dict[str, tuple[str, float]] = {
    "stiffness": ("N*m/arcmin", 1 / ARCMIN), "angle": ("arcmin", ARCMIN), "error": ("arcsec", ARCSEC),
    "share": ("%", 100.0),
}  # fmt: skip


@dataclass(frozen=True)
class GearNumber:
    """Gearbox characteristic, SI and link side; for an insignificant one, its upper 95 % bound.

    name: k_1.  kind: `stiffness`, `damping`, `angle`, `error`, `torque` or `share`.  order: of the motor's turn, with
    the phase of a sine of that order in rad and its std; 0 of the others.  rated_fraction: value or bound over the
    joint's rated torque, NaN if unknown.  linear: of the fit without effects; NaN where it has no such number.
    """

    name: str
    meaning: str
    kind: str
    unit: str
    value: float = math.nan
    std: float = math.nan
    bound: float = math.nan
    order: float = 0.0
    phase: float = math.nan
    phase_std: float = math.nan
    rated_fraction: float = math.nan
    linear: float = math.nan

    @property
    def is_significant(self) -> bool:
        """False for a characteristic with an upper bound only."""
        return math.isfinite(self.value)

    @property
    def interval(self) -> tuple[float, float]:
        """95 %; a magnitude that cannot be negative ends at 0."""
        low, high = self.value - QUANTILE_95 * self.std, self.value + QUANTILE_95 * self.std
        return (low if self.kind in ("stiffness", "damping") else max(low, 0.0)), high

    @property
    def sentence(self) -> str:
        """`k_1 = 1.5e5 N*m/rad, std 20, 1.49996e5 to 1.50004e5 (stiffness at zero torque)`."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if not self.is_significant:
            return f"{self.name} below {self.bound:.3g}{unit}, not significant ({self.meaning})"
        low, high = self.interval
        turn = f", phase {self.phase:.3g} rad" if self.order else ""
        ends = f"std {self.std:.3g}, {low:.6g} to {high:.6g}"
        return f"{self.name} = {self.value:.9g}{unit}{turn}, {ends} ({self.meaning})"

    @property
    def maker_unit(self) -> str:
        """The unit of makers' sheets; empty where it is the SI one."""
        return _MAKERS.get(self.kind, ("", 1.0))[0] if "rad" in self.unit or self.kind == "share" else ""

    @property
    def factor(self) -> float:
        """Factor from SI to the manufacturers' unit."""
        return _MAKERS[self.kind][1] if self.maker_unit else 1.0


@frozen_value
class GearSheet:
    """The numbers of one joint's gear, and its torsion over torque as it is loaded to and fro.

    peak: largest torque of the gear in the records, Nm.  torque, torsion, torsion_std (n,): a loop up to that torque,
    from its negative end on.
    """

    joint: str
    numbers: tuple[GearNumber, ...]
    peak: float
    torque: FloatArray = labelled("torque of the gear, a loop", "N*m")
    torsion: FloatArray = labelled("torsion of the gear", "rad")
    torsion_std: FloatArray = labelled("its standard deviation", "rad")

    def number(self, name: str) -> GearNumber | None:
        """Return the number of a name, or None."""
        return next((number for number in self.numbers if number.name == name), None)


@frozen_value
class GearResult:
    """x (n_x,) of the fit's parameters and magnitudes (n_f,) of effects, link side, with one covariance.

    Stiffnesses are those at zero torque.  sheets: a gear each.  refused: why nothing was looked for, in a sentence; x
    is then that of the fit, and there are no sheets.  before, after: share of the motors' motion at the excited lines
    that the linear fit and the model with the effects leave.  notes: what could not be looked for.
    """

    x: FloatArray = labelled("estimate as the variable of the solver")
    covariance: FloatArray = labelled("covariance of x and the magnitudes")
    effects: tuple[GearEffect, ...] = ()
    magnitudes: FloatArray = labelled("magnitude of each effect, link side", default_factory=lambda: np.zeros(0))
    sheets: tuple[GearSheet, ...] = labelled(entry="joint", default=())
    refused: str = ""
    before: float = math.nan
    after: float = math.nan
    notes: tuple[Note, ...] = ()

    @property
    def explains_misfit(self) -> bool:
        """True if the effects explain most of the linear fit's residual, which then does not limit them."""
        return bool(self.effects) and self.after < MAX_UNEXPLAINED * self.before

    def unanswered_notes(self, notes: Iterable[Note]) -> tuple[Note, ...]:
        """Return notes of a fit and its responses without those that the effects answer."""
        return tuple(note for note in notes if not (self.explains_misfit and note.code in CODES_WITH_CAUSE))

    def magnitude(self, kind: str, joint: str) -> float:
        """Return the sum of magnitudes of a kind at a joint, 0 without any."""
        mask = [(effect.kind, effect.joint) == (kind, joint) for effect in self.effects]
        return float(self.magnitudes[np.array(mask, bool)].sum())

    @property
    def numbers(self) -> tuple[GearNumber, ...]:
        """Numbers of all gears."""
        return tuple(number for sheet in self.sheets for number in sheet.numbers)


def with_gears(result: Result, gears: GearResult | None) -> Result:
    """Return fit with the gearbox characteristics, without status misfit if the effects explain the misfit.

    Its V is then that of the linear fit, whose part beyond the noise falls with the square of the motion left. Load
    tests that contradict it stay a misfit. The same fit where nothing was looked for, of a misfit with a word on it.
    """
    if gears is None or gears.refused:
        is_reported = gears is None or result.status != "misfit"
        return result if is_reported else replace(result, message=f"{result.message}; {NOT_OPENED}")
    n, none = len(gears.x), np.zeros((0, 2))
    final = replace(result, x=gears.x, covariance=gears.covariance[:n, :n], profile95=none, bootstrap95=none)
    is_misfit = result.status == "misfit"
    if (result.static is not None and result.static.disagrees) or not gears.explains_misfit:
        return replace(final, message=f"{result.message}; {NOT_EXPLAINED}") if is_misfit else final
    if not is_misfit and DISTORTED not in result.verdicts and not result.exceeds_noise:
        return final
    message = f"{result.message.partition('. ')[0].partition(', but ')[0]} with the effects of the gears"
    if is_misfit:
        good: Status = "converged" if result.noise_is_known else "noise_unknown"
        final = replace(final, status=good, at_bound=np.zeros_like(result.at_bound))
        message = (
            "the effects of the gears explain the misfit of the linear fit: they leave "
            f"{100 * gears.after:.2g} % of the position signal unexplained, the linear fit {100 * gears.before:.2g} %"
        )
    excess = max(result.cost - result.cost_expected, 0.0) * (gears.after / gears.before) ** 2
    notes, cost = gears.unanswered_notes(result.notes), result.cost_expected + excess
    return replace(final, message=message, cost=cost, indices=(), verdicts=(), notes=notes)


def with_effects(robot: Robot, gears: GearResult) -> Robot:
    """Return a fitted robot with the effects of its gears, no other dry friction, and no other laws of springs.

    A spring that softens so far that it would pull keeps the stiffness at zero torque alone, as does one whose law the
    robot's file cannot state.
    """
    bare, laws = with_straight_springs(without_dry_friction(robot)), {}
    for joint in robot.driven:
        magnitude = gears.magnitude("friction", joint.name)
        if magnitude > 0 and joint.motor is not None:
            laws[joint.name] = Friction(magnitude), joint.motor.link_viscous
    joints = {effect.joint for effect in gears.effects}

    def changed(joint: Joint) -> Joint:
        if joint.name not in joints or joint.spring is None:
            return joint
        behind = gears.magnitude("behind", joint.name)
        friction = Friction(behind) if behind > 0 else joint.friction
        return replace(
            joint, friction=friction, spring=_spring(joint.spring, joint.name, gears), gear=_gear(joint, gears)
        )

    return with_laws(with_joints(bare, changed), laws)


def with_linear_springs(robot: Robot) -> Robot:
    """Return the robot with the stiffness at zero torque of each joint's spring."""

    def linear(joint: Joint) -> Joint:
        if joint.spring is None:
            return joint
        # Within the ends of a gap or range: what it has at zero torque, where that is more than nothing.
        k = joint.spring.inner_stiffness or joint.spring.stiffness
        return replace(joint, spring=Spring(k, joint.spring.damping))

    return with_joints(robot, linear)


def with_terms_of(result: Result, robot: Robot) -> Result:
    """Return fit restricted to the spring terms of this robot, which are fixed.

    A stiffness is that beyond the ends of a gap or range.
    """
    numbers, x = robot.parameters(), result.x.copy()
    with_gap = {f"k_{joint.name}" for joint in robot.driven if joint.spring and joint.spring.backlash is not None}
    for i, p in enumerate(result.parameters.free):
        if p.name in with_gap:
            x[i] = p.to_x(numbers[p.name][0])
    parameters = [p for p in result.parameters if p.name in numbers or not p.name.startswith(("k2_", "k2s_", "k3_"))]
    names = [p.name for p in parameters]
    fixed = [Parameter(name, float(x), unit, free=False) for name, (x, unit) in numbers.items() if name not in names]
    return replace(result, x=x, parameters=Parameters((*parameters, *fixed)))


def _spring(spring: Spring, joint: str, gears: GearResult) -> Spring:
    """Return the spring of a file: soft within a gap or stiffer beyond a range of torque; it can have one of them."""
    ends = [(kind, b, f) for kind, b, f in _effects(joint, gears) if kind in ("gap", "range") and f]
    if ends:
        (kind, b, f), k = ends[0], spring.stiffness
        inner, outer = (max(k - f, 0.0), k) if kind == "gap" else (k, k + f)
        # The ends of a gap are found as sharp.
        with_gap = replace(spring, stiffness=outer, backlash=b, inner_stiffness=inner, rounding=0.02)
        return with_gap if len(ends) == 1 and outer > 0 else spring
    terms = {"cubic": gears.magnitude("cubic", joint), "symmetric_quadratic": gears.magnitude("progressive", joint)}
    try:
        return replace(spring, **{name: magnitude for name, magnitude in terms.items() if magnitude})
    except ValueError:  # it softens, and would pull beyond the torques of the records
        return spring


def _gear(joint: Joint, gears: GearResult) -> Gear | None:
    name = joint.name
    gear = Gear(
        load=max(gears.magnitude("load", name), 0.0),
        transmission_error=tuple(starmap(TransmissionError, _harmonics("error", name, gears))),
        ripple=tuple(starmap(GearRipple, _harmonics("ripple", name, gears))),
        hysteresis=tuple(
            Hysteresis(magnitude, scale, "sharp" if kind == "stop" else "smooth")
            for kind, scale, magnitude in _effects(name, gears)
            if kind in ("stop", "bristle") and magnitude > 0
        ),
    )
    return gear if gear != Gear() else None


def _harmonics(word: Literal["error", "ripple"], joint: str, gears: GearResult) -> Iterator[tuple[float, float, float]]:
    amplitudes = {(kind, scale): f for kind, scale, f in _effects(joint, gears) if kind.startswith(word)}
    for order in dict.fromkeys(scale for _, scale in amplitudes):
        sine, cosine = (amplitudes.get((f"{word} {phase}", order), 0.0) for phase in ("sine", "cosine"))
        if amplitude := math.hypot(sine, cosine):
            yield amplitude, order, math.atan2(cosine, sine)


def _effects(joint: str, gears: GearResult) -> list[tuple[str, float, float]]:
    magnitudes = zip(gears.effects, gears.magnitudes.tolist(), strict=True)
    return [(effect.kind, effect.scale, f) for effect, f in magnitudes if effect.joint == joint]
