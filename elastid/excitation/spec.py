"""The `excitation` section of a study."""

from __future__ import annotations

from typing import Literal

from elastid.section import section
from elastid.units import Frequency, Time, Torque

# A day at 1 kHz; whatever is longer is a slip of the pen.
MOST_SAMPLES = 1e8


@section
class MultisineSpec:
    """Orthogonal random-phase multisines, in torque, at every motor.

    rate_hz: sampling rate of the controller and the log.  period: of the multisine; the lines are 1/period apart.
    band_hz: lowest and highest excited frequency.  grid: `full` (every line) or `odd` (odd multiples of 1/period: even
    nonlinearities then fall between the lines).  torque_rms: link-side, one number for all motors or one for each.
    spectrum: relative amplitude as (frequency, amplitude) points, straight lines on log-log axes; default flat.
    """

    rate_hz: Frequency
    period: Time
    band_hz: tuple[Frequency, Frequency]
    torque_rms: Torque | tuple[Torque, ...]
    grid: Literal["full", "odd"] = "odd"
    spectrum: tuple[tuple[Frequency, float], ...] = ()

    def __post_init__(self) -> None:
        """Check the band against the rate, the period against the rate, amplitudes against zero."""
        samples = self.period * self.rate_hz
        for name, number in (("rate_hz", self.rate_hz), ("period", self.period)):
            if not number > 0:
                raise ValueError(f"{name} is {number:g}; it must be positive")
        if samples > MOST_SAMPLES:
            raise ValueError(
                f"period: {self.period:g} s at {self.rate_hz:g} Hz are {samples:.3g} samples, more than a record can "
                f"hold ({MOST_SAMPLES:.0e}); shorten the period or lower rate_hz"
            )
        if abs(samples - round(samples)) > 1e-6 * samples:
            raise ValueError(
                f"a period of {self.period:g} s is {samples:.6g} samples at {self.rate_hz:g} Hz, not a whole number; "
                f"take {round(samples) / self.rate_hz:.9g} s"
            )
        low, high = self.band_hz
        if not 0 < low < high:
            raise ValueError(f"band_hz is [{low:g}, {high:g}]; give [lowest, highest], both positive")
        if high >= self.rate_hz / 2:
            raise ValueError(
                f"band_hz: {high:g} Hz is not below half the sampling rate ({self.rate_hz / 2:g} Hz); "
                "lower band_hz or raise rate_hz"
            )
        rms = self.torque_rms if isinstance(self.torque_rms, tuple) else (self.torque_rms,)
        if any(not value > 0 for value in rms):
            raise ValueError("torque_rms must be positive for every motor")
        if any(not f > 0 or not a > 0 for f, a in self.spectrum):
            raise ValueError("spectrum: frequencies and amplitudes must be positive")

    @property
    def period_samples(self) -> int:
        """N, samples per period."""
        return round(self.period * self.rate_hz)
