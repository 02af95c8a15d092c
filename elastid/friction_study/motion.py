r"""Inertia and friction of one axis from any motion of it: torque regressed on acceleration, velocity and direction.

.. math:: u = J \ddot q + (f \pm \delta_f) \dot q + (F_c \pm \delta_c)\, s + (F_s - F_c)\, s\, e^{-(\dot q / \nu_s)^2}
              + F_{cl} l s + F_{cT} \theta s + f_T (e^{-\theta / T_V} - 1) \dot q
              + \alpha_3 \dot q |\dot q| + s \sum_k p_k P_k(q)
              + G \cos q + H \sin q + o + \sum_h (a_h \cos h N q + b_h \sin h N q) + T \dot u

with s = sgn q', Legendre polynomials P_k of the angle, the load l of a log, its temperature theta about the mean,
ripple of the motor's turns (N a turn of the joint) and a delay T of the torque. All but J, f, F_c, gravity and o are
parts where the data show them beyond chance. The torque of a payload that some logs have, times the drive's gain g, is
one more: u is logged with an unknown torque constant behind it.

Both sides of the equation pass the same low-pass filter of finite length and are thinned to twice its band, so that
filtering is no error of the equation and neither ripple nor the noise of derivatives counts (Gautier, Proc. IEEE ICRA
1997). What a joint does at rest and at reversals, where it sticks, is no sliding: samples as near are left out. The
residuals of a real axis are not white; the covariance of `least_squares.solve` allows for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.polynomial.legendre import legval

from elastid.base.arrays import FloatArray, IntArray, frozen_value
from elastid.base.errors import DataError, Note
from elastid.friction_study.laws import (
    ABSENT,
    LOWEST_SPEED,
    MIN_SPEEDS,
    STRIBECK_NUMBERS,
    TEMPERATURE_STEP_K,
    Held,
    above_stribeck,
    extrapolates,
)
from elastid.friction_study.least_squares import FALSE_ALARM, Equations, Regression, shift_between, solve
from elastid.friction_study.motion_signals import Motion, MotionLog, MotionSignals, Plateau, both_bands, distinct_speeds
from elastid.friction_study.motion_terms import (
    ANGLE,
    MotionTerms,
    axis_equations,
    change_of,
    regressed,
    shown_terms,
    with_other_curves,
)

# The filter of both sides; three times as much passes before a position is differentiated.
PASSBAND_HZ = 20.0
# Share of the time of sliding at lower speeds, which is short.
_SLOWEST_SHARE = 0.02
# Numbers that are compared between both bands.
JUDGED = ("inertia", "viscous", "coulomb")


@dataclass(frozen=True)
class MotionLimits:
    """Limits of the judgement of a motion (scripts/studies/results.csv)."""

    narrow: float = 0.25  # of the passband, in which a true model has the same numbers
    max_shift: float = 2.8  # of a number between both bands, over its std, that counts as an error of the model
    spring_shift: float = 0.5  # of a number with a spring between motor and link, over its std, that is a misfit
    max_error: float = 0.05  # std of a number over it, widened by errors of the model: above, it is a misfit


LIMITS = MotionLimits()


@frozen_value
class RigidBody:
    r"""Base parameters of joints that moved together: numbers (n_b,) of the columns Y_b of a robot's rigid body.

    .. math:: \tau = Y_b(q, \dot q, \ddot q)\, \pi_b, \qquad Y = Y_b\, regrouped

    Y: the regressor of all frames (10 n_l), rotors and offsets of the joints, n_c in all; chosen: places of Y_b in it.
    A base parameter is its number and regrouped (n_b, n_c) times those which the motions could not separate from it
    (Gautier, J. Robotic Systems 8(4), 1991).  columns: names of all n_c; units: of the base parameters.
    values: by least squares, with std; predicting: by ridge regression, for other logs.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    std: FloatArray
    predicting: FloatArray
    chosen: IntArray
    regrouped: FloatArray
    columns: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters, those of their columns."""
        return tuple(self.columns[i] for i in self.chosen)


@dataclass(frozen=True)
class MotionFriction:
    """The friction of an axis from a motion, `chosen` with the same numbers in both directions or with different ones.

    motion: its first log; of joints that move together, without the torque of the rigid body.  terms: parts of the
    regression.  plateaus: where it slides steadily.  passband_hz: of the regression.  seconds: of all logs, in the
    regression and not, by reason.  held: parts that the motion cannot identify.  notes: on its data.  misfit: errors of
    the model that the intervals do not hold, empty without.  rigid_body: of joints that moved together, which share it.
    """

    motion: Motion
    chosen: Regression
    terms: MotionTerms
    plateaus: tuple[Plateau, ...]
    passband_hz: float
    seconds: Mapping[str, float]
    held: tuple[Held, ...] = ()
    notes: tuple[Note, ...] = ()
    misfit: str = ""
    rigid_body: RigidBody | None = None

    @classmethod
    def of(cls, signals: Sequence[MotionSignals], chosen: Regression, terms: MotionTerms) -> MotionFriction:
        """Friction of a motion without its judgement; DataError where friction supplies power at every speed."""
        first = signals[0]
        if chosen["coulomb"] < 0 and chosen["viscous"] <= 0:
            raise DataError(
                "friction/motion",
                f"friction drives (Coulomb {chosen['coulomb']:.4g}): torque and velocity have "
                "opposite signs; turn one channel (sign: -1)",
                f"motion of {first.motion.place}",
            )
        plateaus = tuple(plateau for each in signals for plateau in each.plateaus)
        seconds = {name: sum(each.seconds[name] for each in signals) for name in first.seconds}
        return cls(first.motion, chosen, terms, plateaus, first.passband_hz, seconds)

    @property
    def are_apart(self) -> bool:
        """True if the directions differ beyond chance."""
        return "directions.viscous" in self.chosen.names

    @property
    def seconds_words(self) -> str:
        """Words on each second of the logs: in the regression or why not."""
        rest = [f"{seconds:.3g} s {name}" for name, seconds in self.seconds.items() if name != "used" and seconds > 0]
        total, used = sum(self.seconds.values()), self.seconds.get("used", 0.0)
        return f"{used:.3g} of {total:.3g} s in the regression{', not ' if rest else ''}{', '.join(rest)}"

    @property
    def known(self) -> tuple[str, ...]:
        """The numbers that are no extrapolations."""
        unseen = STRIBECK_NUMBERS if any(held.part == "stribeck" for held in self.held) else ()
        return tuple(name for name in self.chosen.names if not name.endswith(unseen))


def regress_motion(*motions: Motion, passband_hz: float = PASSBAND_HZ) -> MotionFriction:
    """Inertia and friction of an axis from its logs; DataError for short or one-sided ones, or friction that drives."""
    signals = [MotionSignals.of(motion, passband_hz) for motion in motions]
    for each in signals:
        for direction, word in ((1, "forwards"), (-1, "backwards")):
            if not each.moves(direction) and not each.motion.is_run_down:
                raise DataError(
                    "friction/motion",
                    f"it barely moves {word}, so that friction cannot be distinguished from "
                    "an offset or gravity; record a motion there and back, or give files[].purpose: run_down where it "
                    "coasts and its inertia is known",
                    f"motion of {each.motion.place}",
                )
    terms = shown_terms(signals)
    chosen = with_other_curves(signals, terms, regressed(signals, terms))
    if terms.apart and chosen.chance("directions.viscous", 0) >= FALSE_ALARM:
        terms = replace(terms, apart=False)
        chosen = with_other_curves(signals, terms, regressed(signals, terms))
    fit = MotionFriction.of(signals, chosen, terms.at(chosen))
    if fit.motion.is_run_down:
        return fit
    fit = replace(fit, held=tuple(_held(fit, signals)), notes=_angle_notes(fit))
    return _judged(fit, signals)


def _angle_notes(fit: MotionFriction) -> tuple[Note, ...]:
    """Notes on dry friction that changes with the position."""
    if not fit.terms.angles:
        return ()
    parts = [0.0, *(fit.chosen[name] for name in ANGLE)]
    change = legval(np.linspace(-1, 1, 101), parts) / max(abs(fit.chosen["coulomb"]), 1e-300)
    unit, (low, high) = "m" if fit.motion.slides else "rad", fit.terms.angles
    text = (
        f"dry friction changes by {change.min():+.0%} to {change.max():+.0%} between {low:.3g} and {high:.3g} {unit}, "
        "with the position or a load that does; F_c is its mean over them, and the law of a robot's file has no angle"
    )
    return (Note("friction/by-angle", text, f"motion of {fit.motion.place}"),)


def _held(fit: MotionFriction, signals: Sequence[MotionSignals]) -> Iterator[Held]:
    """Parts of the law without numbers, and a Stribeck effect that only speeds well above its velocity show."""
    terms, low, high = fit.terms, *(fit.terms.measured or (0.0, 0.0))
    speed = np.concatenate([np.abs(each.filtered(each.velocity))[each.used] for each in signals])
    lowest = float(np.quantile(speed, _SLOWEST_SHARE))
    if not terms.stribeck_velocity and (reason := too_few_speeds(fit.plateaus)):
        yield Held("stribeck", f"{reason}; {extrapolates(lowest)}")
    if terms.stribeck_velocity and lowest > LOWEST_SPEED * terms.stribeck_velocity:
        yield Held("stribeck", above_stribeck(lowest, terms.stribeck_velocity))
    if not terms.heat and high - low < TEMPERATURE_STEP_K:
        yield Held("temperature", "no temperature that varies was logged; log it, and record motions cold and warm")
    elif not terms.heat:
        yield Held("temperature", f"{ABSENT.replace('levels', 'motions')} from {low:.3g} to {high:.3g} degC")
    if not terms.load:
        yield ONE_LOAD


def _judged(fit: MotionFriction, signals: Sequence[MotionSignals]) -> MotionFriction:
    """Friction with the reason of a misfit; errors of the model that show between bands are in the intervals."""
    terms, bands = fit.terms, both_bands([MotionLog({"": each}) for each in signals], LIMITS.narrow)
    moved = moved_numbers(bands, lambda log: axis_equations(log.first, terms))
    advice = "the law lacks a part; measure passes, which show it"
    chosen, misfit = judged(fit.chosen, "", moved, fit.passband_hz, advice)
    if bands:
        change, spring = _by_spring(fit.chosen, [log.first for log in bands[1]], terms)
        chosen = replace(chosen, covariance=chosen.covariance + np.outer(change, change))
        misfit = "; ".join(filter(None, (spring, misfit)))
    return replace(fit, chosen=chosen, misfit=misfit)


def _by_spring(numbers: Regression, slow: Sequence[MotionSignals], terms: MotionTerms) -> tuple[FloatArray, str]:
    """The change of the numbers (n_x,) by a spring between motor and link, 0 within chance, and a misfit's reason."""
    rigid, elastic = (regressed(slow, replace(terms, spring=shows), steps=0) for shows in (False, True))
    if elastic.chance("spring", 1) > FALSE_ALARM:
        return np.zeros(len(numbers.names)), ""
    change = change_of(rigid, elastic)
    stds = np.max(np.abs(change) / np.maximum(np.sqrt(np.diag(numbers.covariance)), 1e-300))
    highest_hz = np.sqrt(max(elastic["inertia"], 0.0) / elastic["spring"]) / 2 / np.pi
    text = (
        f"the torque has the part of a spring between motor and link, which swings below {highest_hz:.2g} Hz where the "
        f"motor is held; with it numbers change by {stds:.2g} std; move more slowly, or identify the spring from "
        "frequency responses"
    )
    return change, text if stds > LIMITS.spring_shift else ""


Moved: TypeAlias = Mapping[tuple[str, str], tuple[float, float]]


def moved_numbers(bands: Sequence[Sequence[MotionLog]], equations: Callable[[MotionLog], Equations]) -> Moved:
    """Shift between both bands, and its std, of numbers by joint and name; empty without bands."""
    if not bands:
        return {}
    rate_hz = bands[0][0].first.kept_hz
    wide, slow = (solve([equations(log) for log in band], rate_hz) for band in bands)
    return shift_between(wide, slow, rate_hz)


def judged(numbers: Regression, joint: str, moved: Moved, passband_hz: float, advice: str) -> tuple[Regression, str]:
    """Numbers with their change between bands in the intervals where it is beyond chance, and a misfit's reason."""
    own = {name: change for (of, name), change in moved.items() if of == joint and name in JUDGED}
    shift = np.array([own.get(name, (0.0, 1.0))[0] for name in numbers.names])
    stds, worst = max(((abs(change) / std, name) for name, (change, std) in own.items()), default=(0.0, ""))
    texts = []
    if stds > LIMITS.max_shift:
        numbers = replace(numbers, covariance=numbers.covariance + np.outer(shift, shift))
        texts.append(
            f"below {LIMITS.narrow * passband_hz:g} Hz {worst} is {stds:.2g} std off that below {passband_hz:g} Hz"
        )
    if numbers.widening > 1:
        texts.append(f"the torque that is left repeats with angle or velocity, {numbers.widening:.2g} times chance")
    known = [name for name in JUDGED if name in numbers.names]
    error, name = max((numbers.std(name) / max(abs(numbers[name]), 1e-300), name) for name in known)
    if not texts or error <= LIMITS.max_error:
        return numbers, ""
    return numbers, f"{' and '.join(texts)}, so that {name} is known to {error:.0%} only: {advice}"


PARTS = ("inertia", "gravity", "viscous", "coulomb")


def motion_parts(numbers: Regression, columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The torque (n,) of PARTS by the columns of a regression; of joints that moved together that of friction alone.

    Offset, ripple and delay are in that of gravity, without an offset in that of Coulomb friction.
    """
    parts = dict[str, FloatArray]()
    for name in (name for name in columns if name in numbers.names):
        kind = name.partition(".")[0]
        is_viscous = kind == "quadratic" or name.endswith("viscous")
        is_rigid = kind in ("gravity", "gain", "offset") or (kind in ("ripple", "delay") and "offset" in columns)
        part = kind if kind == "inertia" else "viscous" if is_viscous else "gravity" if is_rigid else "coulomb"
        parts[part] = parts.get(part, 0.0) + numbers[name] * columns[name]
    return parts


ONE_LOAD = Held("load", "a regression of one load has none; record motions with other payloads, or in other postures")


def too_few_speeds(plateaus: Sequence[Plateau]) -> str:
    """The reason why a motion with these plateaus cannot identify a Stribeck effect; empty without one."""
    speeds = len(distinct_speeds(plateau.velocity for plateau in plateaus))
    text = (
        f"the motion dwells at {speeds} speeds, and {MIN_SPEEDS} are needed, the lowest below a third of the Stribeck "
        "velocity; measure passes at more speeds"
    )
    return "" if speeds >= MIN_SPEEDS else text
