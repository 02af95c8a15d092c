r"""Inertia and friction of one axis from any motion of it: torque regressed on acceleration, velocity and direction.

.. math:: u = J \ddot q + (f \pm \delta_f) \dot q + (F_c \pm \delta_c)\, \mathrm{sgn}\, \dot q + G \cos q + H \sin q + o

The residuals of a real axis are not white; the covariance of `least_squares.solve` allows for it.

Both sides of the equation pass the same low-pass filter, forward and backward, and are thinned to twice its band, so
that filtering is no error of the equation and neither ripple nor the noise of derivatives counts (Gautier, Proc. IEEE
ICRA 1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, resample_poly, sosfiltfilt

from elastid.base.arrays import BoolArray, FloatArray, IntArray, frozen_value
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.base.statistics import f_test
from elastid.friction_study.laws import MIN_SPEEDS, Held
from elastid.friction_study.least_squares import FALSE_ALARM, Equations, Regression, solve
from elastid.friction_study.passes import Plateau, distinct_speeds, find_plateaus
from elastid.robot.friction_numbers import TERMS

# The filter of both sides; three times as much passes before a position is differentiated.
PASSBAND_HZ = 20.0
# Samples of jumps in a period of the passband.
_JUMP_RATES = 100.0


@frozen_value
class Motion:
    """A log of one axis on one side: position (n,) in rad or m, torque (n,) in Nm or N, at rate_hz.

    turns_against_gravity: True if the torque of gravity changes with the angle.
    """

    place: str
    rate_hz: float
    position: FloatArray
    torque: FloatArray
    slides: bool = False
    turns_against_gravity: bool = False

    def __post_init__(self) -> None:
        if self.position.shape != self.torque.shape or self.position.ndim != 1:
            raise ValueError(f"motion of {self.place}: position {self.position.shape}, torque {self.torque.shape}")


@dataclass(frozen=True)
class MotionSignals:
    """A motion at full rate (n,) behind the filter of derivatives, torque as logged; direction: sgn of the velocity.

    sos: the filter of both sides.  kept: the samples of the filtered equation, thinned, without the ends.
    """

    rate_hz: float
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    direction: FloatArray
    torque: FloatArray
    sos: FloatArray
    kept: slice
    passband_hz: float

    @classmethod
    def of(cls, motion: Motion, passband_hz: float) -> MotionSignals:
        """Those of a motion; DataError where it is too short, or sampled too slowly, for the passband."""
        rate = motion.rate_hz
        if not passband_hz < rate / 4:
            raise DataError(
                f"motion of {motion.place}: a passband of {passband_hz:g} Hz needs a rate above {4 * passband_hz:g} "
                f"Hz, and it has {rate:g} Hz; lower the passband"
            )
        spoilt = round(6.0 / passband_hz * rate)  # samples at either end, six periods of the passband
        if len(motion.position) < 4 * spoilt:
            raise DataError(
                f"motion of {motion.place}: {len(motion.position) / rate:.3g} s are too short for a passband of "
                f"{passband_hz:g} Hz, which spoils {spoilt / rate:.3g} s at either end; record longer, or raise it"
            )
        smooth = butter(4, min(3.0 * passband_hz, 0.45 * rate), fs=rate, output="sos")
        position = np.asarray(sosfiltfilt(smooth, motion.position))
        # Central differences would take 43 % of an acceleration at a fifth of the rate.
        samples = np.arange(len(position))
        spline = make_interp_spline(samples / rate, position, k=5)
        velocity, acceleration = (np.asarray(spline(samples / rate, nu=order)) for order in (1, 2))
        # A jump between two samples is sampled as its part within the band is.
        finer = max(1, int(np.ceil(_JUMP_RATES * passband_hz / rate)))
        instants = np.arange(finer * len(position)) / (finer * rate)
        direction = resample_poly(np.sign(spline(instants, nu=1)), 1, finer, padtype="line")
        sos = butter(4, passband_hz, fs=rate, output="sos")
        kept = slice(spoilt, len(position) - spoilt, max(1, int(rate / (4 * passband_hz))))
        return cls(rate, position, velocity, acceleration, direction, motion.torque, sos, kept, passband_hz)

    def filtered(self, column: FloatArray) -> FloatArray:
        """A side of the equation (n, ...) behind the filter, at the samples that are kept."""
        return np.asarray(sosfiltfilt(self.sos, column, axis=0)[self.kept])

    @property
    def kept_hz(self) -> float:
        """The rate of the samples that are kept."""
        return self.rate_hz / int(self.kept.step)

    @property
    def slides_on(self) -> BoolArray:
        """Of the samples that are kept (k,), those that no reversal is within the filter of."""
        steady = np.abs(self.filtered(self.direction)) > 0.98
        return steady if steady.mean() > 0.5 else np.ones_like(steady)

    @property
    def plateaus(self) -> tuple[Plateau, ...]:
        """Where it slides steadily."""
        return find_plateaus(self.velocity, self.acceleration, self.rate_hz)

    def moves(self, direction: int) -> bool:
        """True if it moves that way (1, -1) faster than 2 % of its highest speed for 2 % of the time."""
        inside = self.velocity[self.kept.start : self.kept.stop]
        return bool(np.mean(direction * inside > 0.02 * np.abs(inside).max()) > 0.02)


# Numbers of what is no friction.
RIGID = ("inertia", "gravity.cos", "gravity.sin", "offset")


@frozen_value
class RigidBody:
    r"""Base parameters of joints that moved together: numbers (n_b,) of the columns Y_b of a robot's rigid body.

    .. math:: \tau = Y_b(q, \dot q, \ddot q)\, \pi_b, \qquad Y = Y_b\, regrouped

    Y: the regressor of all frames (10 n_l), rotors and offsets of the joints, n_c in all; chosen: places of Y_b in it.
    A base parameter is its number and regrouped (n_b, n_c) times those which the motions could not separate from it
    (Gautier, J. Robotic Systems 8(4), 1991).  columns: names of all n_c; units: of the base parameters.
    values: by least squares, with std; predicting: by ridge regression, for other logs (`shrunk_numbers`).
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
        """Of the base parameters, those of their columns."""
        return tuple(self.columns[i] for i in self.chosen)


@dataclass(frozen=True)
class MotionFriction:
    """The friction of an axis from a motion: with the same numbers in both directions, and with different ones.

    motion: its first log; of joints that move together, without the torque of the rigid body.  plateaus: where it
    slides steadily.  held: parts that the motion cannot identify.  passband_hz: of the regression.  notes: on its data.
    rigid_body: of joints that moved together, which they share.
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
    rigid_body: RigidBody | None = None

    @property
    def chosen(self) -> Regression:
        """The regression that the F test selects."""
        return self.apart if self.are_apart else self.alike

    def unit(self, name: str) -> str:
        """Of a number."""
        if name == "inertia":
            return "kg" if self.motion.slides else "kg*m^2"
        return TERMS["coulomb" if name in RIGID else name].unit_at(self.motion.slides)


def regress_motion(*motions: Motion, passband_hz: float = PASSBAND_HZ) -> MotionFriction:
    """Inertia and friction of an axis from its logs; DataError for short or one-sided ones, or friction that drives."""
    signals = [MotionSignals.of(motion, passband_hz) for motion in motions]
    for motion, each in zip(motions, signals, strict=True):
        for direction, word in ((1, "forwards"), (-1, "backwards")):
            if not each.moves(direction):
                raise DataError(
                    f"motion of {motion.place}: it barely moves {word}, so that friction cannot be distinguished from "
                    "an offset or gravity; record a motion there and back, or give files[].purpose: run_down where it "
                    "coasts and its inertia is known"
                )
    alike, apart = (_regressed(motions, signals, apart) for apart in (False, True))
    refuse_driving(motions[0].place, alike)
    # Residuals are correlated: the test counts what is independent.
    n = sum(len(range(len(each.torque))[each.kept]) for each in signals)
    n_independent = n * (1 - alike.correlation) / (1 + alike.correlation)
    extra = len(apart.names) - len(alike.names)
    dof = max(1.0, n_independent - len(apart.names))
    chance = f_test(alike.sum_of_squares - apart.sum_of_squares, extra, apart.sum_of_squares, dof)
    plateaus = tuple(plateau for each in signals for plateau in each.plateaus)
    held = parts_held(plateaus, motions[0].slides)
    return MotionFriction(motions[0], alike, apart, chance < FALSE_ALARM, chance, plateaus, held, passband_hz)


def rigid_torque(friction: MotionFriction, signals: MotionSignals, torque: FloatArray) -> FloatArray:
    """The torque (n,) at full rate of all that is no friction in the first log: rigid body, gravity and offset.

    torque (n,): of the log, with the rigid body, of which a joint that moved with others has no numbers of its own.
    """
    if "inertia" not in friction.chosen.names:
        return np.asarray(torque - friction.motion.torque)
    columns = _raw_columns(friction.motion, signals, friction.are_apart)
    rigid = [name for name in columns if name in RIGID]
    return np.asarray(sum(friction.chosen[name] * columns[name] for name in rigid))


@frozen_value
class MotionSamples:
    """A motion and its regression, behind the filter of both sides, thinned and without the ends, (n,) each.

    torque: measured.  regressed: by all numbers.  friction: the torque less what is neither Coulomb nor viscous.
    """

    time_s: FloatArray
    velocity: FloatArray
    torque: FloatArray
    regressed: FloatArray
    friction: FloatArray


def motion_parts(friction: MotionFriction, signals: MotionSignals) -> dict[str, FloatArray]:
    """The torque (n,) that each number of a regression takes, at the samples of its first log that signals keep."""
    numbers, columns = friction.chosen, _columns(friction.motion, signals, friction.are_apart)
    return {name: numbers[name] * columns[name] for name in numbers.names}


def motion_samples(fit: MotionFriction) -> MotionSamples:
    """The samples behind a regression, of its first log."""
    signals = MotionSignals.of(fit.motion, fit.passband_hz)
    parts = motion_parts(fit, signals)
    regressed = np.sum(list(parts.values()), axis=0)
    rubbing = [name for name in parts if name.startswith(("coulomb", "viscous", "directions"))]
    torque = signals.filtered(signals.torque)
    friction = torque - regressed + np.sum([parts[name] for name in rubbing], axis=0)
    time_s = np.arange(len(fit.motion.position))[signals.kept] / fit.motion.rate_hz
    return MotionSamples(time_s, signals.filtered(signals.velocity), torque, regressed, friction)


def refuse_driving(place: str, friction: Regression) -> None:
    """DataError where friction supplies power at every speed."""
    if friction["coulomb"] < 0 and friction["viscous"] <= 0:
        raise DataError(
            f"motion of {place}: friction drives (Coulomb {friction['coulomb']:.4g}): torque and velocity have "
            "opposite signs; turn one channel (sign: -1)"
        )


def parts_held(plateaus: Sequence[Plateau], slides: bool) -> tuple[Held, ...]:
    """Parts of the law that a motion with these plateaus cannot identify."""
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


def _regressed(motions: Sequence[Motion], signals: Sequence[MotionSignals], apart: bool) -> Regression:
    columns = [_columns(motion, each, apart) for motion, each in zip(motions, signals, strict=True)]
    logs = []
    for own, each in zip(columns, signals, strict=True):
        used = each.slides_on
        X = np.stack(list(own.values()), axis=1)[used, None, :]
        logs.append(Equations(X, np.zeros((len(X), 1, 0)), each.filtered(each.torque)[used, None]))
    names = tuple(columns[0])
    return solve(logs, signals[0].kept_hz).of_joint(0, range(len(names)), names)


def _columns(motion: Motion, signals: MotionSignals, apart: bool) -> dict[str, FloatArray]:
    return {name: signals.filtered(column) for name, column in _raw_columns(motion, signals, apart).items()}


def _raw_columns(motion: Motion, signals: MotionSignals, apart: bool) -> dict[str, FloatArray]:
    v, s = signals.velocity, signals.direction
    own = (
        {"directions.viscous": np.abs(v), "directions.coulomb": np.ones_like(v)}
        if apart
        else {"offset": np.ones_like(v)}
    )
    columns = {"inertia": signals.acceleration, "viscous": v, "coulomb": s} | own
    if motion.turns_against_gravity:
        columns |= {"gravity.cos": np.cos(signals.position), "gravity.sin": np.sin(signals.position)}
    return columns
