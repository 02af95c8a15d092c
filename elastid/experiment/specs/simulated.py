"""The `simulated` section of an experiment: controller with its gains, carrier, heat and equations.

Disturbances of the simulated rig: noise of its sensors, ripple of its motors.
"""

import math
from dataclasses import field
from typing import Annotated, Literal

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.section import Key, section
from elastid.base.units import (
    Acceleration,
    Angle,
    Conductance,
    Frequency,
    JointPosition,
    JointVelocity,
    Quantity,
    Temperature,
    TemperatureRise,
    Time,
    Torque,
)
from elastid.model.spec import ModelSpec
from elastid.simulation.spec import ControllerSpec


@section
class ColoredNoiseSpec:
    """Noise of a given spectrum on one of the signals of `noise`, in addition to the white one."""

    # fmt: off
    signal: Annotated[Literal["torque", "angle", "disturbance"], Key("Signal to which the noise is added.",
        "`disturbance` for a torque that moves the robot, the other two for measurement noise.")]
    std: Annotated[float, Key("Standard deviation of the noise over all frequencies, SI.", "rms value up to half the "
        "sampling rate; it does not depend on the corner.", above=0)]
    corner_hz: Annotated[Frequency, Key("Corner frequency of the spectrum, which is flat below it.", "for drift, well "
        "below the lowest line.", above=0)]
    slope: Annotated[float, Key("Slope of the spectrum above the corner in dB per decade.", "-20 for noise behind a "
        "first-order low-pass, -40 for second order, positive for differentiated noise.")] = -20.0
    # fmt: on

    def amplitude(self, freq_hz: FloatArray) -> FloatArray:
        """Return relative amplitude density (F,) at freq_hz (F,)."""
        return (1 + (freq_hz / self.corner_hz) ** 2) ** (self.slope / 40)


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
class NoiseSpec:
    """Sensor noise and disturbances, link side; in N and m where a joint slides."""

    # fmt: off
    torque_std: Annotated[Torque, Key("Standard deviation of white noise on the logged torque.", "from a log at zero "
        "velocity; typically 0.1 to 1 % of the maximum torque if computed from current.", least=0)] = 0.0
    angle_std: Annotated[Angle, Key("Standard deviation of white noise on the logged angles, on the link side.",
        "noise of the motor angle divided by the ratio; 0 with encoder_counts if the resolution "
        "dominates.", least=0)] = 0.0
    disturbance_std: Annotated[Torque, Key("Standard deviation of a white torque that acts on the motors and is not "
        "logged.", "for torques of cables and fans; it moves the robot and biases estimators that ignore the closed "
        "loop.", least=0)] = 0.0
    encoder_counts: Annotated[int, Key("Resolution of the motor encoders in counts per motor turn; 0 = unlimited.",
        "2^16 to 2^20 for common encoders; it matters for small amplitudes and in presliding.", least=0)] = 0
    acceleration_std: Annotated[Acceleration, Key("Standard deviation of white noise on the logged accelerations.",
        "0.01 to 0.1 m/s^2 for piezoelectric and MEMS sensors.", least=0)] = 0.0
    colored: Annotated[tuple[ColoredNoiseSpec, ...], Key("Additional coloured noise.", "for measured spectra that are "
        "not white, such as drift below 1 Hz.")] = ()
    # fmt: on

    def variances(
        self, signal: Literal["torque", "angle", "disturbance"], freq_hz: FloatArray, rate_hz: float
    ) -> FloatArray:
        """Return variance (F,) of white noise that has, at each of freq_hz (F,), the power of all noise on a signal."""
        white = {"torque": self.torque_std, "angle": self.angle_std, "disturbance": self.disturbance_std}[signal]
        total = np.full(freq_hz.shape, white**2)
        grid_hz = np.linspace(0, rate_hz / 2, 10_001)[1:]
        for color in self.colored:
            if color.signal == signal:
                total += color.std**2 * color.amplitude(freq_hz) ** 2 / np.mean(color.amplitude(grid_hz) ** 2)
        return total


@section
class HeatSpec:
    r"""Heat of each joint of a friction study, for friction laws that have a `temperature`.

    .. math:: C \dot T = \tau_f v - h (T - T_a)
    """

    # fmt: off
    conductance: Annotated[Conductance, Key("Thermal conductance h from the joint to the room.", "smaller for hotter "
        "joints: the final rise is the heat of friction over it, commonly 10 to 40 K.", above=0)]
    time_constant: Annotated[Time, Key("Thermal time constant C / h of the joint.", "45 minutes are usual for gears of "
        "medium robots; larger gears take up to two hours.", above=0)] = 2700.0
    ambient: Annotated[Temperature, Key("Temperature T_a of the room.", "the temperature of the hall. The joints start "
        "at this temperature unless `start` is given.")] = 20.0
    start: Annotated[Temperature | None, Key("Temperature T of every joint at the start (default: ambient).",
        "above ambient for a robot that has worked before; the warm-up then shows less of the fall.")] = None
    thermometer_std: Annotated[TemperatureRise | None, Key("Standard deviation of the logged temperature, one error "
        "for each motion; null without a thermometer.", "0.5 to 2 K for sensors on the housing; null for robots that "
        "log none: the law then has no temperature terms, and drift shows as scatter.", least=0)] = 0.0
    # fmt: on

    @property
    def start_degc(self) -> float:
        """Temperature of every joint at the start."""
        return self.ambient if self.start is None else self.start


@section
class CarrierSpec:
    """A slow movement of every driven joint around its configuration, so that the joint slides instead of sticking."""

    # fmt: off
    amplitude: Annotated[JointPosition | tuple[JointPosition, ...] | None, Key("Link-side amplitude of a sine, one for "
        "all joints or one per joint, in m for sliding joints (default: none).", "so large that the peak speed 2 pi "
        "cycles amplitude / period exceeds the speed of the multisine over most of the period.", above=0)] = None
    cycles: Annotated[int, Key("Cycles of a sine or square per period of the multisine.", "1 has the largest distance "
        "to the band; more cycles give a higher speed at the same amplitude.", least=1)] = 1
    kind: Annotated[Literal["sine", "square", "offset"], Key("Shape of the motion. `sine`: sine of `amplitude`. "
        "`square`: square wave of `velocity`, filtered at 1 Hz. `offset`: constant `velocity` without reversals, which "
        "limits the multisine.", "`sine` sticks briefly at its reversals; `square` reverses fast; `offset` removes dry "
        "friction from the response and needs a range of velocity times record length.")] = "sine"
    velocity: Annotated[JointVelocity | tuple[JointVelocity, ...] | None, Key("Link-side speed of square and offset, "
        "one for all joints or one per joint, in m/s for sliding joints (default: none).", "above the Stribeck "
        "velocity of the gear and the peak speed of the multisine, so that friction keeps its sign.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if (self.kind == "sine") != (self.amplitude is not None) or (self.kind == "sine") == (
            self.velocity is not None
        ):
            key = "amplitude" if self.kind == "sine" else "velocity"
            raise ValueError(f"a carrier of kind {self.kind} needs only {key}. Give it and omit the other")
        if self.velocity is not None and 0.0 in np.atleast_1d(self.velocity):
            raise ValueError("the carrier's velocity is 0 for a joint, which then sticks. Give a velocity other than 0")

    def refusal(self, n_u: int, lowest: int) -> str:
        """Return why it does not go with n_u motors and the lowest line, in periods; empty where it does."""
        values = self.amplitude if self.velocity is None else self.velocity
        if isinstance(values, tuple) and len(values) not in (1, n_u):
            return f"{len(values)} numbers for {n_u} motors. Give one for all or one per motor"
        if self.kind == "offset" or self.cycles < lowest:
            return ""
        return (
            f"{self.cycles} cycles per period reach the lowest excited line, {lowest} per period. Reduce cycles, or "
            "raise excitation.band_hz"
        )

    def velocities(self, n_u: int) -> FloatArray:
        """Return the velocities (n_u,) of the joints, rad/s or m/s; ValueError for a wrong number of them."""
        return np.broadcast_to(np.array(self.velocity or 0.0, np.float64), (n_u,))

    def amplitudes(self, n_u: int) -> FloatArray:
        """Return the amplitudes (n_u,), rad or m, 0 of a carrier that is no sine; ValueError for a wrong number."""
        return np.broadcast_to(np.array(self.amplitude or 0.0, np.float64), (n_u,))


@section
class SimulatedSpec:
    """A rig that is a model: the study's robot, with the truth that the fit must find in place of some numbers."""

    # fmt: off
    truth: Annotated[dict[str, Quantity], Key("True parameters of the simulated robot, name to value.",
        "choose values that differ from the robot model by its expected error, such as {k_2: "
        "8e5}.")] = field(default_factory=dict)
    outputs: Annotated[tuple[str, ...], Key("Logged outputs: `motor 1`, `joint 1`, `body arm z` and `frame tool rz` as "
        "angles, `frame tool z` and `accelerometer tool z` as accelerations (default: every motor).",
        "add accelerations of the tool if bearing or link springs are ill-conditioned from motor angles "
        "alone.", distinct=True)] = ()
    controller: Annotated[ControllerSpec, Key("Controller of the joints.", "give the bandwidth of the real position "
        "loop, since the loop shapes the excitation.")] = ControllerSpec()
    carrier: Annotated[CarrierSpec | None, Key("Superimposed slow motion under the excitation (default: none).",
        "give it for every robot with dry friction, which otherwise distorts the low lines.")] = None
    noise: Annotated[NoiseSpec, Key("Sensor noise and disturbances.", "use the noise of the real sensors, so that the "
        "predicted intervals apply to the real robot.")] = NoiseSpec()
    substeps: Annotated[int | None, Key("Number of integration steps per controller sample (default: 2, or more for a "
        "wide band or a stiff mode).", "increase it to check convergence, or for stiff friction without a carrier; the "
        "simulation time is proportional.", least=1)] = None
    saturation: Annotated[bool, Key("If true, motor torques are clipped at limits.torque of the joints; otherwise "
        "violations are reported.", "true to study the effect of saturating drives on the responses.")] = False
    torque_ripple: Annotated[tuple[TorqueRippleSpec, ...], Key("Cogging torques, periodic in the motor angle.",
        "for motors whose cogging exceeds the torque noise.")] = ()
    heat: Annotated[HeatSpec | None, Key("Temperature of joints whose friction is identified (default: constant).",
        "for friction models with temperature; warm_up needs it.")] = None
    model: Annotated[ModelSpec, Key("Equations of motion of the rig, independent of the equations of the fit.",
        "choose another formulation or variant to quantify the error of an approximation in the "
        "parameters.")] = ModelSpec()
    compiled: Annotated[bool, Key("If true, the C compiler of the machine ($CC, cc, gcc or clang) compiles the "
        "equations.", "true for minutes of robot time: three times as fast with identical results; without a compiler "
        "elastid warns and interprets them.")] = False
    # fmt: on

    def steps(self, rate_hz: float, highest_hz: float) -> int:
        """Return integration steps in a sample, for a band up to highest_hz: 3.7e-4 (omega step)^6 is at most 4e-6.

        That is the relative error of a frequency by the steps of the rig (`Tableau`).
        """
        return self.substeps or max(2, math.ceil(2 * math.pi * highest_hz / rate_hz / (4e-6 / 3.7e-4) ** (1 / 6)))
