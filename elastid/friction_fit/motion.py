r"""Inertia and friction of one axis from any motion of it: torque regressed on acceleration, velocity and direction.

.. math:: u = J \ddot q + (f \pm \delta_f) \dot q + (F_c \pm \delta_c)\, \mathrm{sgn}\, \dot q + G \cos q + H \sin q + o

Both sides pass the same low-pass filter, forward and backward, and are thinned to twice its band, so that filtering is
no error of the equation and neither ripple nor the noise of derivatives counts (Gautier, Proc. IEEE ICRA 1997). The
residuals of a real axis are not white: the covariance is Newey and West's (Econometrica 55, 1987), over the lags in
which they are correlated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.stats import f as f_distribution

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.base.units import of_translation
from elastid.friction_fit.law_choice import FALSE_ALARM, MIN_SPEEDS, Held
from elastid.friction_fit.plateaus import Plateau, distinct_speeds, find_plateaus

# The filter of both sides, and that of the position before it is differentiated, as a multiple of it.
PASSBAND_HZ, DERIVATIVE_BAND = 20.0, 3.0
FILTER_ORDER = 4
# Ends of a record that the filters spoil, in periods of the passband.
SPOILT_PERIODS = 6.0
# Ripple and cogging are correlated for about the time of one turn.
CORRELATED_S = 1.0
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


@frozen_value
class Motion:
    """A log of one axis on one side: position (n,) in rad or m, torque (n,) in Nm or N, at rate_hz.

    turns_against_gravity: whether the torque of gravity changes with the angle.
    """

    place: str
    rate_hz: float
    position: FloatArray
    torque: FloatArray
    slides: bool = False
    turns_against_gravity: bool = False

    def __post_init__(self) -> None:
        """Check shapes."""
        if self.position.shape != self.torque.shape or self.position.ndim != 1:
            raise ValueError(f"motion of {self.place}: position {self.position.shape}, torque {self.torque.shape}")


@dataclass(frozen=True)
class Regression:
    """Numbers by name with their covariance, and the norm of what they leave over that of the torque."""

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    relative_error: float
    sum_of_squares: float
    correlation: float

    def __getitem__(self, name: str) -> float:
        """A number."""
        return float(self.values[self.names.index(name)])

    def std(self, name: str) -> float:
        """Its std."""
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))


@dataclass(frozen=True)
class MotionFriction:
    """The friction of an axis from a motion: with both directions alike, with each its own, and which of them it is.

    plateaus: where it slides steadily.  held: what the motion cannot tell.
    """

    motion: Motion
    alike: Regression
    apart: Regression
    are_apart: bool
    chance: float
    plateaus: tuple[Plateau, ...]
    held: tuple[Held, ...]

    @property
    def chosen(self) -> Regression:
        """The regression that the data tell."""
        return self.apart if self.are_apart else self.alike

    def unit(self, name: str) -> str:
        """Of a number."""
        if not self.motion.slides:
            return UNITS[name]
        return "kg" if name == "inertia" else of_translation(UNITS[name])


def regress_motion(motion: Motion, passband_hz: float = PASSBAND_HZ) -> MotionFriction:
    """Inertia and friction from a motion, in the band up to passband_hz.

    Raises DataError for a log that is too short, stands still, moves in one direction only, or in which friction
    drives.
    """
    signals = _signals(motion, passband_hz)
    alike = _regress(signals, _columns(motion, signals, apart=False), signals.correlation_lags)
    apart = _regress(signals, _columns(motion, signals, apart=True), signals.correlation_lags)
    if alike["coulomb"] < 0 and alike["viscous"] <= 0:
        raise DataError(
            f"motion of {motion.place}: friction drives (Coulomb {alike['coulomb']:.4g}): torque and velocity have "
            "opposite signs; turn one channel (scale: -1)"
        )
    # Residuals are correlated: the test counts what is independent.
    n = len(signals.torque) * (1 - alike.correlation) / (1 + alike.correlation)
    extra = len(apart.names) - len(alike.names)
    dof = max(1.0, n - len(apart.names))
    ratio = (alike.sum_of_squares - apart.sum_of_squares) / extra / (apart.sum_of_squares / dof)
    chance = float(f_distribution.sf(ratio, extra, dof))
    plateaus = find_plateaus(signals.velocity, signals.acceleration, motion.rate_hz)
    held = _held(motion, plateaus)
    return MotionFriction(motion, alike, apart, chance < FALSE_ALARM, chance, plateaus, held)


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


def motion_samples(found: MotionFriction, passband_hz: float = PASSBAND_HZ) -> MotionSamples:
    """The samples behind `regress_motion` with the same passband_hz."""
    signals, numbers = _signals(found.motion, passband_hz), found.chosen
    columns = _columns(found.motion, signals, found.are_apart)
    parts = {name: numbers[name] * column for name, column in columns.items()}
    regressed = np.sum(list(parts.values()), axis=0)
    rubbing = [name for name in parts if name.startswith(("coulomb", "viscous", "directions"))]
    friction = signals.torque - regressed + np.sum([parts[name] for name in rubbing], axis=0)
    time_s = np.arange(len(found.motion.position))[signals.kept] / found.motion.rate_hz
    return MotionSamples(time_s, columns["viscous"], signals.torque, regressed, friction)


@dataclass(frozen=True)
class _Signals:
    """The motion at full rate, and what both sides of the equation keep: thinned, without the ends."""

    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    sos: FloatArray
    kept: slice
    correlation_lags: int

    def filtered(self, column: FloatArray) -> FloatArray:
        """A side of the equation behind the filter."""
        return np.asarray(sosfiltfilt(self.sos, column)[self.kept])


def _signals(motion: Motion, passband_hz: float) -> _Signals:
    rate = motion.rate_hz
    if not passband_hz < rate / 4:
        raise DataError(
            f"motion of {motion.place}: a passband of {passband_hz:g} Hz needs a rate above {4 * passband_hz:g} Hz, "
            f"and it has {rate:g} Hz; lower the passband"
        )
    spoilt = round(SPOILT_PERIODS / passband_hz * rate)
    if len(motion.position) < 4 * spoilt:
        raise DataError(
            f"motion of {motion.place}: {len(motion.position) / rate:.3g} s are too short for a passband of "
            f"{passband_hz:g} Hz, which spoils {spoilt / rate:.3g} s at either end; record longer, or raise it"
        )
    smooth = butter(FILTER_ORDER, min(DERIVATIVE_BAND * passband_hz, 0.45 * rate), fs=rate, output="sos")
    position = sosfiltfilt(smooth, motion.position)
    velocity = np.gradient(position, 1 / rate)
    acceleration = np.gradient(velocity, 1 / rate)
    inside = velocity[spoilt:-spoilt]
    for sign, word in ((1, "forwards"), (-1, "backwards")):
        if not np.mean(sign * inside > 0.02 * np.abs(inside).max()) > 0.02:
            raise DataError(
                f"motion of {motion.place}: it hardly moves {word}, so that friction cannot be told from an offset or "
                "gravity; record a motion there and back"
            )
    sos = butter(FILTER_ORDER, passband_hz, fs=rate, output="sos")
    kept = slice(spoilt, len(position) - spoilt, max(1, int(rate / (4 * passband_hz))))
    torque = np.asarray(sosfiltfilt(sos, motion.torque)[kept])
    return _Signals(velocity, acceleration, torque, sos, kept, max(1, round(CORRELATED_S * rate / kept.step)))


def _columns(motion: Motion, signals: _Signals, apart: bool) -> dict[str, FloatArray]:
    v, s = signals.velocity, np.sign(signals.velocity)
    columns = {"inertia": signals.acceleration, "viscous": v, "coulomb": s}
    if apart:
        columns |= {"directions.viscous": np.abs(v), "directions.coulomb": np.abs(s)}
    else:
        columns |= {"offset": np.ones_like(v)}
    if motion.turns_against_gravity:
        columns |= {"gravity.cos": np.cos(motion.position), "gravity.sin": np.sin(motion.position)}
    return {name: signals.filtered(column) for name, column in columns.items()}


def _regress(signals: _Signals, columns: dict[str, FloatArray], lags: int) -> Regression:
    A, y = np.stack(list(columns.values()), axis=1), signals.torque
    size = np.linalg.norm(A, axis=0)
    values, *_ = np.linalg.lstsq(A / size, y, rcond=None)
    left = y - A / size @ values
    inverse = np.linalg.pinv((A / size).T @ (A / size))
    covariance = inverse @ _long_run(A / size * left[:, None], lags) @ inverse / np.outer(size, size)
    total = float(left @ left)
    correlation = float(np.clip(left[1:] @ left[:-1] / max(total, 1e-300), 0.0, 0.999))
    independent = len(y) * (1 - correlation) / (1 + correlation)
    # What the numbers take out of the residuals.
    covariance = covariance * independent / max(1.0, independent - len(columns))
    relative = float(np.sqrt(total / max(float(y @ y), 1e-300)))
    return Regression(tuple(columns), values / size, covariance, relative, total, correlation)


def _long_run(scores: FloatArray, lags: int) -> FloatArray:
    """sum of scores' autocovariances (n_x, n_x), Bartlett's window over the lags."""
    total = scores.T @ scores
    for lag in range(1, min(lags, len(scores) - 1) + 1):
        product = scores[lag:].T @ scores[:-lag]
        total = total + (1 - lag / (lags + 1)) * (product + product.T)
    return np.asarray(total)


def _held(motion: Motion, plateaus: tuple[Plateau, ...]) -> tuple[Held, ...]:
    speeds, unit = distinct_speeds(plateaus), "m/s" if motion.slides else "rad/s"
    held = [Held("temperature", "the log has no temperature"), Held("load", "one load")]
    if len(speeds) < MIN_SPEEDS:
        dwelt = ", ".join(f"{speed:.3g}" for speed in speeds) or "none"
        held.insert(
            0,
            Held(
                "stribeck",
                f"stiction and Stribeck velocity: the motion dwells at {len(speeds)} speeds ({dwelt} {unit}); it takes "
                f"{MIN_SPEEDS}, the lowest below a third of the Stribeck velocity; measure passes at more speeds",
            ),
        )
    return tuple(held)
