"""A log of one axis, and its derivatives and equation behind filters.

Both sides of an equation pass the same low-pass filter, forward and backward, and are thinned to twice its band, so
that filtering is no error of the equation and neither ripple nor the noise of derivatives counts (Gautier, Proc. IEEE
ICRA 1997).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.friction_fit.plateaus import Plateau, find_plateaus

# The filter of both sides, and that of the position before it is differentiated, as a multiple of it.
PASSBAND_HZ, DERIVATIVE_BAND = 20.0, 3.0
FILTER_ORDER = 4
# Ends of a record that the filters spoil, in periods of the passband.
SPOILT_PERIODS = 6.0
# Ripple and cogging are correlated for about the time of one turn.
CORRELATED_S = 1.0
# An axis moves one way where it is faster than this share of its highest speed for this share of the time.
MOVING_SHARE = 0.02


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
class MotionSignals:
    """A motion at full rate (n,) behind the filter of derivatives, torque as logged.

    sos: the filter of both sides.  kept: the samples of the filtered equation, thinned, without the ends.
    """

    rate_hz: float
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
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
        spoilt = round(SPOILT_PERIODS / passband_hz * rate)
        if len(motion.position) < 4 * spoilt:
            raise DataError(
                f"motion of {motion.place}: {len(motion.position) / rate:.3g} s are too short for a passband of "
                f"{passband_hz:g} Hz, which spoils {spoilt / rate:.3g} s at either end; record longer, or raise it"
            )
        smooth = butter(FILTER_ORDER, min(DERIVATIVE_BAND * passband_hz, 0.45 * rate), fs=rate, output="sos")
        position = np.asarray(sosfiltfilt(smooth, motion.position))
        velocity = np.gradient(position, 1 / rate)
        sos = butter(FILTER_ORDER, passband_hz, fs=rate, output="sos")
        kept = slice(spoilt, len(position) - spoilt, max(1, int(rate / (4 * passband_hz))))
        return cls(rate, position, velocity, np.gradient(velocity, 1 / rate), motion.torque, sos, kept, passband_hz)

    def filtered(self, column: FloatArray) -> FloatArray:
        """A side of the equation (n, ...) behind the filter, at the samples that are kept."""
        return np.asarray(sosfiltfilt(self.sos, column, axis=0)[self.kept])

    @property
    def correlation_lags(self) -> int:
        """Kept samples over which residuals may be correlated."""
        return max(1, round(CORRELATED_S * self.rate_hz / int(self.kept.step)))

    @property
    def plateaus(self) -> tuple[Plateau, ...]:
        """Where it slides steadily."""
        return find_plateaus(self.velocity, self.acceleration, self.rate_hz)

    def moves(self, direction: int) -> bool:
        """Whether it moves that way (1, -1), more than noise does."""
        inside = self.velocity[self.kept.start : self.kept.stop]
        return bool(np.mean(direction * inside > MOVING_SHARE * np.abs(inside).max()) > MOVING_SHARE)
