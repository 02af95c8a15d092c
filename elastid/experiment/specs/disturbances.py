"""Disturbances of the simulated rig: noise of its sensors, ripple of its motors, friction that drifts."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.section import Key, section
from elastid.base.units import Acceleration, Angle, Frequency, Temperature, Time, Torque


@section
class ColoredNoiseSpec:
    """Noise of a given spectrum on one of the signals of `noise`, in addition to the white one."""

    # fmt: off
    signal: Annotated[Literal["torque", "angle", "disturbance"], Key("Signal that the noise is added to.",
        "`disturbance` for torque that moves the robot, the two others for what only the log has.")]
    std: Annotated[float, Key("Standard deviation of the whole noise, SI.", "the rms value of the noise over the whole "
        "band up to half the rate, so that another corner moves power and adds none.", above=0)]
    corner_hz: Annotated[Frequency | None, Key("Corner frequency of the spectrum: flat up to it, falling beyond.",
        "where the measured spectrum begins to fall; for drift well below the lowest line.", above=0)] = None
    slope: Annotated[float, Key("Slope of the spectrum beyond the corner in dB a decade.", "-20 is noise behind one "
        "low-pass, as of a torque loop; -40 falls as behind two, positive rises, as noise that was "
        "differentiated.")] = -20.0
    table: Annotated[tuple[tuple[Frequency, float], ...], Key("Spectrum in place of a corner: [frequency in Hz, "
        "relative amplitude], straight between its points on logarithmic axes and held beyond them.", "for a spectrum "
        "that was measured, in place of corner_hz and slope.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        if (self.corner_hz is None) == (not self.table):
            raise ValueError("give either corner_hz (with slope) or table")
        frequencies = [row[0] for row in self.table]
        if any(not f > 0 for f in frequencies) or frequencies != sorted(set(frequencies)):
            raise ValueError("the frequencies of table must be positive and rise")
        if any(not row[1] > 0 for row in self.table):
            raise ValueError("the amplitudes of table must be positive")

    def amplitude(self, freq_hz: FloatArray) -> FloatArray:
        """Relative amplitude density (F,) at freq_hz (F,)."""
        if self.corner_hz is None:
            f, a = np.log(np.array(self.table)).T
            return np.asarray(np.exp(np.interp(np.log(np.maximum(freq_hz, 1e-300)), f, a)))
        return np.asarray((1 + (freq_hz / self.corner_hz) ** 2) ** (self.slope / 40))


@section
class EncoderRippleSpec:
    """An error of the motor encoders that repeats in a motor turn."""

    # fmt: off
    amplitude: Annotated[Angle, Key("Amplitude of the error on the motor side.", "1e-4 to 1e-3 rad for resolvers; over "
        "the ratio it is the error on the link side.")]
    periods: Annotated[int, Key("Periods of the error in a motor turn.", "1 for an eccentric disc, 2 for a resolver "
        "whose channels differ; a list of entries gives several.", least=1)] = 1
    phase: Annotated[Angle, Key("Phase of the error at motor angle zero.", "matters only between several entries, "
        "whose sum it shapes.")] = 0.0
    # fmt: on


@section
class TorqueRippleSpec:
    """Cogging: a torque on the motors that repeats in a motor turn."""

    # fmt: off
    amplitude: Annotated[Torque, Key("Amplitude of the torque on the motor side.", "0.5 to 2 % of the motor's rated "
        "torque.")]
    periods: Annotated[int, Key("Periods of the torque in a motor turn.", "6 for each pole pair where commutation "
        "makes the ripple; the least common multiple of poles and slots for cogging, or the count from a slow "
        "pass.", least=1)] = 6
    phase: Annotated[Angle, Key("Phase of the torque at motor angle zero.", "another one moves where in a turn the "
        "torque pulls, which matters for swings shorter than a period of the ripple.")] = 0.0
    # fmt: on


@section
class WarmingSpec:
    """Drift of the robot's friction from run to run and within each, as it warms.

    Level of dry friction: 1 + amplitude exp(-t / time_constant), t from the start of the first run.
    """

    # fmt: off
    time_constant: Annotated[Time, Key("Time constant of the drift.", "30 to 60 minutes for gears of industrial "
        "robots.", above=0)]
    amplitude: Annotated[float, Key("Amplitude of the drift, a part of the level.", "0.2 to 0.5 for a robot that "
        "starts cold; 0 with `temperature`, whose law then says how friction falls.", above=-1)] = 0.0
    pause: Annotated[Time, Key("Pause between runs.", "the time in which somebody moves to the next configuration; the "
        "robot goes on warming in it by the clock.", least=0)] = 0.0
    temperature: Annotated[tuple[Temperature, Temperature] | None, Key("Temperatures [cold, warm] of the gears, "
        "approached with the same time constant, for friction laws that have a `temperature`.", "for laws with a "
        "`temperature`; without it their reference holds throughout.")] = None
    # fmt: on


@section
class NoiseSpec:
    """Sensor noise and disturbances, link side; in N and m where a joint slides."""

    # fmt: off
    torque_std: Annotated[Torque, Key("Standard deviation of white noise on the logged torque.", "from a log at rest; "
        "drives that compute torque from current commonly have 0.1 to 1 % of their largest torque.", least=0)] = 0.0
    angle_std: Annotated[Angle, Key("Standard deviation of white noise on the logged angles.", "link side: the motor's "
        "noise over the ratio. Where resolution is what limits, use encoder_counts and leave this at 0.",
        least=0)] = 0.0
    disturbance_std: Annotated[Torque, Key("Standard deviation of a white torque that acts on the motors and is not in "
        "the log.", "torque of cables, fans and neighbours; unlike torque_std it moves the robot, and closed loop "
        "estimators differ in it.", least=0)] = 0.0
    encoder_counts: Annotated[int, Key("Resolution of the motor encoders in counts per motor turn; 0 = unlimited.",
        "2^16 to 2^20 for common encoders; it matters for small amplitudes, at rest and in presliding, where motion is "
        "a few counts.", least=0)] = 0
    acceleration_std: Annotated[Acceleration, Key("Standard deviation of white noise on the logged accelerations of "
        "points.", "0.01 to 0.1 m/s^2 for piezoelectric and MEMS sensors; it only touches outputs that are "
        "accelerations of points.", least=0)] = 0.0
    colored: Annotated[tuple[ColoredNoiseSpec, ...], Key("Further noise of other spectra.", "where a measured spectrum "
        "is far from white, such as drift below 1 Hz or a cable's resonance; the estimate of variance follows it line "
        "by line.")] = ()
    torque_offset: Annotated[Torque, Key("Constant error of the logged torque.", "to see that a constant error of the "
        "current sensor does not matter: it lies at 0 Hz for responses, and passes in two directions cancel it.")] = 0.0
    # fmt: on

    def variances(
        self, signal: Literal["torque", "angle", "disturbance"], freq_hz: FloatArray, rate_hz: float
    ) -> FloatArray:
        """Variance (F,) of white noise that has, at each of freq_hz (F,), the power of all noise on a signal."""
        white = {"torque": self.torque_std, "angle": self.angle_std, "disturbance": self.disturbance_std}[signal]
        total = np.full(freq_hz.shape, white**2)
        every = np.linspace(0, rate_hz / 2, 10_001)[1:]
        for color in self.colored:
            if color.signal == signal:
                total += color.std**2 * color.amplitude(freq_hz) ** 2 / np.mean(color.amplitude(every) ** 2)
        return total
