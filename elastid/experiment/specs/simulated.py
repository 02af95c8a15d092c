"""The `simulated` section of an experiment: controller, carrier, noise and drives of the simulated rig."""

from __future__ import annotations

import math
from dataclasses import field
from typing import Literal

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.section import section
from elastid.base.units import (
    Acceleration,
    Angle,
    Frequency,
    JointPosition,
    JointVelocity,
    Quantity,
    Temperature,
    Time,
    Torque,
)
from elastid.experiment.specs.heat import HeatSpec
from elastid.model.spec import ModelSpec
from elastid.simulation.spec import StabilisationSpec


@section
class ControllerSpec:
    """The joint controller that closes the loop: position and velocity feedback of the motor, gravity feed-forward.

    bandwidth_hz: of the position loop about the configuration; low, so that the plant and not the loop is excited.
    damping_ratio: of that loop.  kind: `pd`, or the `cascade` of robot controllers, a proportional position loop around
    a velocity loop.  integral_time: of the cascade's velocity loop (default: three times 1 / (2 pi bandwidth_hz)).
    """

    bandwidth_hz: Frequency = 1.5
    damping_ratio: float = 0.8
    kind: Literal["pd", "cascade"] = "pd"
    integral_time: Time | None = None

    def __post_init__(self) -> None:
        """Refuse a loop that cannot hold the robot."""
        if not self.bandwidth_hz > 0 or not self.damping_ratio > 0:
            raise ValueError("bandwidth_hz and damping_ratio must be positive")
        if self.kind == "pd" and self.integral_time is not None:
            raise ValueError("integral_time belongs to kind: cascade; a pd controller has none")
        # Routh's criterion for J s^3 + k_d s^2 + (k_p + k_d / T_i) s + k_p / T_i.
        omega, zeta = 2 * math.pi * self.bandwidth_hz, self.damping_ratio
        least = (1 - 4 * zeta**2) / (2 * zeta * omega)
        if self.velocity_integral_time is not None and not self.velocity_integral_time > max(0.0, least):
            raise ValueError(
                f"integral_time is {self.velocity_integral_time:g} s; the loop is stable above {max(0.0, least):.3g} s"
            )

    @property
    def velocity_integral_time(self) -> float | None:
        """T_i in s, or None where there is no integral."""
        if self.kind == "pd":
            return None
        return 3 / (2 * math.pi * self.bandwidth_hz) if self.integral_time is None else self.integral_time


@section
class CarrierSpec:
    """A slow movement of every driven joint around its configuration, so that friction slides instead of sticking.

    kind: `sine`: q(t) = amplitude * sin(2 pi cycles t / period).  `square`: the velocity is a square wave of `velocity`
    with so many cycles a period, filtered at cutoff_hz, without the harmonics that fall on analysed lines.  `offset`:
    constant `velocity` (its sign the direction), through the configuration in the middle of the measured periods; the
    multisine is kept so small that no motor turns back. Sine and square are periodic with the multisine, on lines below
    the excited band.
    amplitude, velocity: link-side, one for all joints or one for each; in m and m/s of those that slide.
    cycles: of a sine or square, in a period of the multisine.  cutoff_hz: of the filter of a square.
    """

    amplitude: JointPosition | tuple[JointPosition, ...] | None = None
    cycles: int = 1
    kind: Literal["sine", "square", "offset"] = "sine"
    velocity: JointVelocity | tuple[JointVelocity, ...] | None = None
    cutoff_hz: Frequency = 1.0

    def __post_init__(self) -> None:
        """Refuse a carrier that does not move."""
        if (self.kind == "sine") != (self.amplitude is not None) or (self.kind == "sine") == (
            self.velocity is not None
        ):
            needed = "amplitude" if self.kind == "sine" else "velocity"
            raise ValueError(f"a carrier of kind {self.kind} is given by its {needed} alone")
        if self.amplitude is not None and not np.all(np.atleast_1d(self.amplitude) > 0):
            raise ValueError("the carrier's amplitude must be positive for every joint and cycles at least 1")
        if self.velocity is not None and 0.0 in np.atleast_1d(self.velocity):
            raise ValueError("the carrier's velocity must not be 0 for any joint; friction would stick there")
        if self.cycles < 1 or not self.cutoff_hz > 0:
            raise ValueError(
                f"the carrier has {self.cycles} cycles and cutoff_hz {self.cutoff_hz:g}; both are positive"
            )

    def velocities(self, n_u: int) -> FloatArray:
        """The velocity of each of n_u joints; ValueError for a wrong number of them."""
        given = np.atleast_1d(0.0 if self.velocity is None else self.velocity)
        return np.broadcast_to(given, (n_u,)).astype(np.float64)

    def amplitudes(self, n_u: int) -> FloatArray:
        """The amplitude of each of n_u joints, 0 of a carrier that is no sine; ValueError for a wrong number."""
        given = np.atleast_1d(0.0 if self.amplitude is None else self.amplitude)
        return np.broadcast_to(given, (n_u,)).astype(np.float64)


@section
class ColoredNoiseSpec:
    """Noise of a given spectrum on one of the signals of `noise`, beside the white one.

    signal: that it is added to.  std: of all of it, SI.  corner_hz: flat up to here, then falling.  slope: dB a decade
    beyond the corner.  table: in place of a corner, [frequency in Hz, relative amplitude], straight between its points
    on logarithmic axes and held beyond them.
    """

    signal: Literal["torque", "angle", "disturbance"]
    std: float
    corner_hz: Frequency | None = None
    slope: float = -20.0
    table: tuple[tuple[Frequency, float], ...] = ()

    def __post_init__(self) -> None:
        """A corner or a table."""
        if not self.std > 0:
            raise ValueError(f"std is {self.std:g}; it must be positive")
        if (self.corner_hz is None) == (not self.table):
            raise ValueError("give either corner_hz (with slope) or table")
        if self.corner_hz is not None and not self.corner_hz > 0:
            raise ValueError(f"corner_hz is {self.corner_hz:g}; it must be positive")
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
    """An error of the motor encoders that repeats in a motor turn.

    amplitude: on the motor side.  periods: in a motor turn.  phase: at motor angle zero.
    """

    amplitude: Angle
    periods: int = 1
    phase: Angle = 0.0

    def __post_init__(self) -> None:
        """Whole periods a turn."""
        if self.periods < 1:
            raise ValueError(f"periods is {self.periods}; a motor turn has at least 1")


@section
class TorqueRippleSpec:
    """Cogging: a torque on the motors that repeats in a motor turn.

    amplitude: on the motor side.  periods: in a motor turn.  phase: at motor angle zero.
    """

    amplitude: Torque
    periods: int = 6
    phase: Angle = 0.0

    def __post_init__(self) -> None:
        """Whole periods a turn."""
        if self.periods < 1:
            raise ValueError(f"periods is {self.periods}; a motor turn has at least 1")


@section
class WarmingSpec:
    """How the robot's friction drifts from run to run and within each, as it warms.

    Level of dry friction: 1 + amplitude exp(-t / time_constant), t from the start of the first run.

    time_constant: of the drift.  amplitude: of the drift, a part of the level.  spread: standard deviation of a further
    factor, drawn for every run.  pause: between runs.  temperature: [cold, warm] of the gears, approached with the same
    time constant, for friction laws that have a `temperature`.
    """

    time_constant: Time
    amplitude: float = 0.0
    spread: float = 0.0
    pause: Time = 0.0
    temperature: tuple[Temperature, Temperature] | None = None

    def __post_init__(self) -> None:
        """Refuse friction that pushes."""
        if not self.time_constant > 0:
            raise ValueError(f"time_constant is {self.time_constant:g} s; it must be positive")
        if not self.amplitude > -1:
            raise ValueError(f"amplitude is {self.amplitude:g}; the level 1 + amplitude must be positive")
        if not 0 <= self.spread < 0.3:
            raise ValueError(f"spread is {self.spread:g}; it must be within [0, 0.3), a part of the level")
        if self.pause < 0:
            raise ValueError(f"pause is {self.pause:g} s; it must not be negative")


@section
class NoiseSpec:
    """Sensor noise and disturbances, link side; in N and m where a joint slides.

    torque_std: on the logged torque, white.  torque_offset: constant error of the logged torque.
    angle_std: on the logged angles, white.
    acceleration_std: on the logged accelerations of points, white.
    encoder_counts: resolution of the motor encoders in counts per motor turn; 0 = unlimited.
    disturbance_std: torque that acts on the motors, white, unknown to the log.
    colored: further noise of other spectra.
    """

    torque_std: Torque = 0.0
    angle_std: Angle = 0.0
    disturbance_std: Torque = 0.0
    encoder_counts: int = 0
    acceleration_std: Acceleration = 0.0
    colored: tuple[ColoredNoiseSpec, ...] = ()
    torque_offset: Torque = 0.0

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

    def __post_init__(self) -> None:
        """Refuse negative spreads."""
        levels = (self.torque_std, self.angle_std, self.disturbance_std, self.encoder_counts, self.acceleration_std)
        if min(levels) < 0:
            raise ValueError("noise levels must not be negative")


@section
class SimulatedSpec:
    """A rig that is a model: the study's robot with some of its numbers replaced by the truth that the fit must find.

    truth: parameter name to value.  outputs: places that are logged (default: every motor): `motor 1`, `joint 1`,
    `body arm z` and `frame tool rz` as angles, `frame tool z` and `accelerometer tool z` as accelerations.
    controller: of the joints.  carrier: a slow movement beside the excitation (default: none).  noise: of the sensors.
    substeps: integration steps per sample of the controller.  model: the rig's equations, independent of the fit's.
    loops: how those of a linkage are kept closed.
    saturation: motor torques are clipped at the joints' limits.torque; without it, exceeding them is reported.
    encoder_ripple, torque_ripple: errors that repeat with the motors' turns.  warming: how friction drifts.
    heat: of joints whose friction is identified (default: their temperature does not change).
    """

    truth: dict[str, Quantity] = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    controller: ControllerSpec = ControllerSpec()
    carrier: CarrierSpec | None = None
    noise: NoiseSpec = NoiseSpec()
    substeps: int = 2
    saturation: bool = False
    encoder_ripple: tuple[EncoderRippleSpec, ...] = ()
    torque_ripple: tuple[TorqueRippleSpec, ...] = ()
    warming: WarmingSpec | None = None
    heat: HeatSpec | None = None
    model: ModelSpec = ModelSpec()
    loops: StabilisationSpec = StabilisationSpec()

    def __post_init__(self) -> None:
        """Refuse a simulation without steps, and outputs that would count twice."""
        if len(set(self.outputs)) < len(self.outputs):
            raise ValueError(f"outputs names a place twice ({', '.join(self.outputs)}); its lines would count twice")
        if self.substeps < 1:
            raise ValueError(f"substeps is {self.substeps}; it must be at least 1")
