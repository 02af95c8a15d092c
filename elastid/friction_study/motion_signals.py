"""A log of one axis: its signals behind the filter of a regression.

The filter has a finite length: a sample that a wrong model spoils, as while a joint sticks, spoils only its neighbours,
and the equations of all others hold exactly (modulating functions: Shinbrot, Trans. ASME 79, 1957). Of a sample that is
not used stands the reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.ndimage import maximum_filter1d
from scipy.signal import butter, resample_poly, sosfiltfilt, upfirdn

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.friction_study.passes import PASSES, Plateau, find_plateaus


@frozen_value
class Motion:
    """A log of one axis on one side: position (n,) in rad or m, torque (n,) in Nm or N, at rate_hz.

    turns_against_gravity: True if the torque of gravity changes with the angle.  turn: of the joint for one of its
    motor, 0 for none.  load: |torque| that the joint carries.  temperature (n,): degC, None where none was logged.
    torque_delay_s: by which the torque acts later than its position was read.  payload_torque (n,): of a payload
    that other logs do not have, by the robot's geometry.  is_run_down: it coasts, its torque without the rigid body.
    """

    place: str
    rate_hz: float
    position: FloatArray
    torque: FloatArray
    slides: bool = False
    turns_against_gravity: bool = False
    turn: float = 0.0
    load: float = 0.0
    temperature: FloatArray | None = None
    torque_delay_s: float = 0.0
    payload_torque: FloatArray | None = None
    is_run_down: bool = False

    @property
    def acting_position(self) -> FloatArray:
        """The position (n,) where the torque acts: a command that is held acts half a sample later."""
        if self.torque_delay_s == 0:
            return self.position
        samples = np.arange(len(self.position))
        lag = self.torque_delay_s * self.rate_hz
        return np.asarray(make_interp_spline(samples, self.position, k=5)(samples + lag))


@dataclass(frozen=True)
class MotionSignals:
    """A motion at full rate (n,) behind the filter of derivatives; direction: sgn of the velocity.

    derivatives (2, n): of the position as logged, which the filter of both sides smooths.
    taps: the filter of both sides.  kept: the samples of the filtered equation, thinned, without the ends.
    """

    motion: Motion
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    derivatives: FloatArray
    direction: FloatArray
    taps: FloatArray
    kept: slice
    passband_hz: float

    @classmethod
    def of(cls, motion: Motion, passband_hz: float) -> MotionSignals:
        """Those of a motion; DataError where it is too short, or sampled too slowly, for the passband."""
        rate = motion.rate_hz
        spoilt = round(6.0 / passband_hz * rate)  # samples at either end, six periods of the passband
        if not passband_hz < rate / 4 or len(motion.position) < 4 * spoilt:
            raise DataError(
                "friction/motion",
                f"it lasts {len(motion.position) / rate:.3g} s at {rate:g} Hz; a passband of {passband_hz:g} Hz takes "
                f"{4 * spoilt / rate:.3g} s and more than {4 * passband_hz:g} Hz: record longer, or faster",
                f"motion of {motion.place}",
            )
        smooth = butter(4, min(3.0 * passband_hz, 0.45 * rate), fs=rate, output="sos")
        acting = motion.acting_position
        position = np.asarray(sosfiltfilt(smooth, acting))
        # Central differences would take 43 % of an acceleration at a fifth of the rate.
        samples = np.arange(len(position))
        spline = make_interp_spline(samples / rate, position, k=5)
        logged = make_interp_spline(samples / rate, acting, k=5)
        derivatives = np.stack([logged(samples / rate, nu=order) for order in (1, 2)])
        # A jump between two samples is sampled as its part within the band is.
        # Samples of jumps in a period of the passband.
        finer = max(1, int(np.ceil(100.0 * passband_hz / rate)))
        instants = np.arange(finer * len(position)) / (finer * rate)
        velocity = np.asarray(spline(instants, nu=1))
        direction = resample_poly(np.sign(velocity), 1, finer, padtype="line")
        taps = b_spline_taps(rate, passband_hz)
        kept = slice(spoilt, len(position) - spoilt, max(1, int(rate / (4 * passband_hz))))
        acceleration = np.asarray(spline(samples / rate, nu=2))
        return cls(motion, position, velocity[::finer], acceleration, derivatives, direction, taps, kept, passband_hz)

    def filtered(self, column: FloatArray) -> FloatArray:
        """A side of the equation (n, ...) behind the filter, at the samples that are kept."""
        return filtered(column, self.taps, self.kept)

    @property
    def kept_hz(self) -> float:
        """The rate of the samples that are kept."""
        return self.motion.rate_hz / int(self.kept.step)

    @property
    def rests(self) -> BoolArray:
        """At full rate (n,), true at rest."""
        speed = np.abs(self.velocity)
        return np.asarray(speed < PASSES.rest_share * speed.max())

    @cached_property
    def slides(self) -> BoolArray:
        """At full rate (n,), true where neither rest nor a reversal is within the filter."""
        sign = np.sign(self.velocity)
        turns = np.append(False, sign[1:] != sign[:-1])
        # The derivatives of a spline reach 4 samples.
        return ~within(self.rests | turns, len(self.taps) // 2 + 4)

    @cached_property
    def used(self) -> BoolArray:
        """Of the samples that are kept (k,), those that slide; all, where hardly any does."""
        slides = self.slides[self.kept]
        # All are used where fewer than a fifth slide clear of reversals.
        return slides if slides.mean() > 0.2 else np.ones_like(slides)

    @property
    def seconds(self) -> dict[str, float]:
        """Durations that add up to that of the log: in the regression, and why the others are not."""
        inside = np.zeros(len(self.position), bool)
        inside[self.kept.start : self.kept.stop] = True
        slides = self.slides if not self.used.all() else inside
        parts = {
            "used": inside & slides,
            "at rest": inside & ~slides & self.rests,
            "near a reversal or rest": inside & ~slides & ~self.rests,
            "ends of the log": ~inside,
        }
        return {name: float(part.sum()) / self.motion.rate_hz for name, part in parts.items()}

    @property
    def plateaus(self) -> tuple[Plateau, ...]:
        """Where it slides steadily."""
        return find_plateaus(self.velocity, self.acceleration, self.motion.rate_hz)

    def moves(self, direction: int) -> bool:
        """True if it moves that way (1, -1) faster than 2 % of its highest speed for 2 % of the time."""
        inside = self.velocity[self.kept.start : self.kept.stop]
        return bool(np.mean(direction * inside > 0.02 * np.abs(inside).max()) > 0.02)


# Boxes whose convolution the taps are, and their width over a period of the passband for -3 dB at its end.
_BOXES, _WIDTH = 6, 0.1863


def b_spline_taps(rate_hz: float, passband_hz: float) -> FloatArray:
    r"""Taps (2 h + 1,) of unit sum: |H(f)| = |sinc(w f)|^6 with w = 0.1863 / passband."""
    half = _BOXES / 2 * _WIDTH * rate_hz / passband_hz  # samples
    h = max(1, int(half))
    spline = BSpline.basis_element(np.linspace(-half, half, _BOXES + 1), extrapolate=False)
    taps = np.nan_to_num(spline(np.arange(-h, h + 1)))
    return np.asarray(taps / taps.sum())


def filtered(column: FloatArray, taps: FloatArray, kept: slice) -> FloatArray:
    """The samples of a slice, further than half the filter from the ends, of a column (n, ...) along its first axis."""
    h = len(taps) // 2
    before = h + -2 * h % kept.step  # a whole number of steps before the end of the taps
    sums = upfirdn(taps, column[kept.start - before : kept.stop + h], 1, kept.step, axis=0)
    first = (before + h) // kept.step
    return np.asarray(sums[first : first + len(range(kept.start, kept.stop, kept.step))])


def within(samples: BoolArray, reach: int) -> BoolArray:
    """True for each sample (n,) with one of the given ones at most `reach` samples away."""
    return np.asarray(maximum_filter1d(samples.astype(np.uint8), 2 * reach + 1, mode="constant") > 0)


@dataclass(frozen=True)
class MotionLog:
    """Signals of a log by joint, and the angles of the joints that rest."""

    of_joints: Mapping[str, MotionSignals]
    resting: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, motions: Mapping[str, Motion], resting: Mapping[str, float], passband_hz: float) -> MotionLog:
        """Those of motions by joint; DataError as of `MotionSignals`."""
        return cls({joint: MotionSignals.of(each, passband_hz) for joint, each in motions.items()}, resting)

    @property
    def first(self) -> MotionSignals:
        """Of one of its joints, which all have its times."""
        return next(iter(self.of_joints.values()))


def both_bands(logs: Sequence[MotionLog], narrow: float) -> tuple[list[MotionLog], ...]:
    """All of the band and a narrow part of it at the same samples; none where logs are short or reverse too often."""
    bands = list[MotionLog](), list[MotionLog]()
    for log in logs:
        try:
            slow = {
                joint: MotionSignals.of(each.motion, narrow * each.passband_hz) for joint, each in log.of_joints.items()
            }
        except DataError:
            return ()
        if any(each.used.all() for each in slow.values()):
            return ()
        kept = next(iter(slow.values())).kept
        same = slice(kept.start, kept.stop, log.first.kept.step)
        for band, signals in zip(bands, (log.of_joints, slow), strict=True):
            band.append(replace(log, of_joints={joint: replace(each, kept=same) for joint, each in signals.items()}))
    return bands
