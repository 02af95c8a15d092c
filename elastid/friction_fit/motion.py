r"""Inertia and friction of one axis from any motion of it: torque regressed on acceleration, velocity and direction.

.. math:: u = J \ddot q + (f \pm \delta_f) \dot q + (F_c \pm \delta_c)\, \mathrm{sgn}\, \dot q + G \cos q + H \sin q + o

Both sides are filtered as in `motion_signals`; the residuals of a real axis are not white, which the covariance of
`equations` knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.base.units import of_translation
from elastid.friction_fit.equations import Equations, Regression, solve
from elastid.friction_fit.law_choice import FALSE_ALARM, MIN_SPEEDS, Held
from elastid.friction_fit.motion_signals import PASSBAND_HZ, Motion, MotionSignals
from elastid.friction_fit.plateaus import Plateau, distinct_speeds

# Number: unit of a place that turns.
UNITS = {
    "inertia": "kg*m^2",
    "coulomb": "N*m",
    "viscous": "N*m*s/rad",
    "directions.coulomb": "N*m",
    "directions.viscous": "N*m*s/rad",
    "gravity.cos": "N*m",
    "gravity.sin": "N*m",
    "offset": "N*m",
}
# Numbers of what is no friction.
RIGID = ("inertia", "gravity.cos", "gravity.sin", "offset")


@dataclass(frozen=True)
class MotionFriction:
    """The friction of an axis from a motion: with both directions alike, with each its own, and which of them it is.

    motion: its first log; of joints that move together, without the torque of the rigid body.  plateaus: where it
    slides steadily.  held: what the motion cannot tell.  passband_hz: of the regression.  notes: on what it rests.
    """

    motion: Motion
    alike: Regression
    apart: Regression
    are_apart: bool
    chance: float
    plateaus: tuple[Plateau, ...]
    held: tuple[Held, ...]
    passband_hz: float = PASSBAND_HZ
    notes: tuple[Note, ...] = ()

    @property
    def chosen(self) -> Regression:
        """The regression that the data tell."""
        return self.apart if self.are_apart else self.alike

    def unit(self, name: str) -> str:
        """Of a number."""
        if not self.motion.slides:
            return UNITS[name]
        return "kg" if name == "inertia" else of_translation(UNITS[name])


def regress_motion(*motions: Motion, passband_hz: float = PASSBAND_HZ) -> MotionFriction:
    """Inertia and friction of one axis from its logs, one or several, in the band up to passband_hz.

    Raises DataError for a log that is too short, stands still, moves in one direction only, or in which friction
    drives.
    """
    signals = [MotionSignals.of(motion, passband_hz) for motion in motions]
    for motion, each in zip(motions, signals, strict=True):
        _check_both_ways(motion, each)
    alike, apart = (_regressed(motions, signals, apart) for apart in (False, True))
    refuse_driving(motions[0].place, alike)
    # Residuals are correlated: the test counts what is independent.
    n_kept = sum(len(range(len(each.torque))[each.kept]) for each in signals)
    n = n_kept * (1 - alike.correlation) / (1 + alike.correlation)
    extra = len(apart.names) - len(alike.names)
    dof = max(1.0, n - len(apart.names))
    ratio = (alike.sum_of_squares - apart.sum_of_squares) / extra / (apart.sum_of_squares / dof)
    chance = float(f_distribution.sf(ratio, extra, dof))
    plateaus = tuple(plateau for each in signals for plateau in each.plateaus)
    held = parts_held(plateaus, motions[0].slides)
    return MotionFriction(motions[0], alike, apart, chance < FALSE_ALARM, chance, plateaus, held, passband_hz)


def rigid_torque(found: MotionFriction, signals: MotionSignals, torque: FloatArray) -> FloatArray:
    """The torque (n,) at full rate of all that is no friction in the first log: rigid body, gravity and offset.

    torque (n,): of the log, with the rigid body, of which a joint that moved with others has no numbers of its own.
    """
    if "inertia" not in found.chosen.names:
        return np.asarray(torque - found.motion.torque)
    columns = _raw_columns(found.motion, signals, found.are_apart)
    rigid = [name for name in columns if name in RIGID]
    return np.asarray(sum(found.chosen[name] * columns[name] for name in rigid))


@frozen_value
class MotionSamples:
    """What a regression makes of a motion, behind the filter of both sides, thinned and without the ends, (n,) each.

    torque: measured.  regressed: by all numbers.  friction: the torque less what is neither Coulomb nor viscous.
    """

    time_s: FloatArray
    velocity: FloatArray
    torque: FloatArray
    regressed: FloatArray
    friction: FloatArray


def motion_parts(found: MotionFriction, signals: MotionSignals) -> dict[str, FloatArray]:
    """The torque (n,) that each number of a regression takes, at the samples of its first log that signals keep."""
    numbers, columns = found.chosen, _columns(found.motion, signals, found.are_apart)
    return {name: numbers[name] * columns[name] for name in numbers.names}


def motion_samples(found: MotionFriction) -> MotionSamples:
    """The samples behind a regression, of its first log."""
    signals = MotionSignals.of(found.motion, found.passband_hz)
    parts = motion_parts(found, signals)
    regressed = np.sum(list(parts.values()), axis=0)
    rubbing = [name for name in parts if name.startswith(("coulomb", "viscous", "directions"))]
    torque = signals.filtered(signals.torque)
    friction = torque - regressed + np.sum([parts[name] for name in rubbing], axis=0)
    time_s = np.arange(len(found.motion.position))[signals.kept] / found.motion.rate_hz
    return MotionSamples(time_s, signals.filtered(signals.velocity), torque, regressed, friction)


def refuse_driving(place: str, friction: Regression) -> None:
    """DataError where friction supplies power at every speed."""
    if friction["coulomb"] < 0 and friction["viscous"] <= 0:
        raise DataError(
            f"motion of {place}: friction drives (Coulomb {friction['coulomb']:.4g}): torque and velocity have "
            "opposite signs; turn one channel (sign: -1)"
        )


def parts_held(plateaus: Sequence[Plateau], slides: bool) -> tuple[Held, ...]:
    """What a motion with these plateaus cannot tell."""
    speeds, unit = distinct_speeds(plateaus), "m/s" if slides else "rad/s"
    held = (
        Held("temperature", "a regression of motions has none; measure passes cold and warm, and log the temperature"),
        Held("load", "a regression of motions has none; measure passes in other postures, or with payloads"),
    )
    if len(speeds) >= MIN_SPEEDS:
        return held
    dwelt = ", ".join(f"{speed:.3g}" for speed in speeds)
    text = (
        f"the motion dwells at {f'{len(speeds)} speeds ({dwelt} {unit})' if len(speeds) else 'no speed'}; it takes "
        f"{MIN_SPEEDS}, the lowest below a third of the Stribeck velocity; measure passes at more speeds"
    )
    return (Held("stribeck", text), *held)


def _check_both_ways(motion: Motion, signals: MotionSignals) -> None:
    for direction, word in ((1, "forwards"), (-1, "backwards")):
        if not signals.moves(direction):
            raise DataError(
                f"motion of {motion.place}: it hardly moves {word}, so that friction cannot be told from an offset or "
                "gravity; record a motion there and back"
            )


def _regressed(motions: Sequence[Motion], signals: Sequence[MotionSignals], apart: bool) -> Regression:
    columns = [_columns(motion, each, apart) for motion, each in zip(motions, signals, strict=True)]
    logs = [
        Equations(np.stack(list(own.values()), axis=1)[:, None, :], np.zeros((len(y), 1, 0)), y[:, None])
        for own, y in zip(columns, (each.filtered(each.torque) for each in signals), strict=True)
    ]
    names = tuple(columns[0])
    return solve(logs, signals[0].correlation_lags).of_joint(0, range(len(names)), names)


def _columns(motion: Motion, signals: MotionSignals, apart: bool) -> dict[str, FloatArray]:
    return {name: signals.filtered(column) for name, column in _raw_columns(motion, signals, apart).items()}


def _raw_columns(motion: Motion, signals: MotionSignals, apart: bool) -> dict[str, FloatArray]:
    v, s = signals.velocity, np.sign(signals.velocity)
    columns = {"inertia": signals.acceleration, "viscous": v, "coulomb": s}
    if apart:
        columns |= {"directions.viscous": np.abs(v), "directions.coulomb": np.abs(s)}
    else:
        columns |= {"offset": np.ones_like(v)}
    if motion.turns_against_gravity:
        columns |= {"gravity.cos": np.cos(signals.position), "gravity.sin": np.sin(signals.position)}
    return columns
