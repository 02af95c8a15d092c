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
    signal: Annotated[Literal["torque", "angle", "disturbance"], Key("Signal that the noise is added to.",
        "`disturbance` for torque that moves the robot, the two others for what only the log has.")]
    std: Annotated[float, Key("Standard deviation of the whole noise, SI.", "the rms value of the noise over the whole "
        "band up to half the rate, so that another corner moves power and adds none.", above=0)]
    corner_hz: Annotated[Frequency, Key("Corner frequency of the spectrum: flat up to it, falling beyond.",
        "where the measured spectrum begins to fall; for drift well below the lowest line.", above=0)]
    slope: Annotated[float, Key("Slope of the spectrum beyond the corner in dB a decade.", "-20 is noise behind one "
        "low-pass, as of a torque loop; -40 falls as behind two, positive rises, as noise that was "
        "differentiated.")] = -20.0
    # fmt: on

    def amplitude(self, freq_hz: FloatArray) -> FloatArray:
        """Relative amplitude density (F,) at freq_hz (F,)."""
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
    ambient: Annotated[Temperature, Key("Temperature T_a of the room.", "that of the hall; losses count from it, and "
        "joints start there unless `start` is given.")] = 20.0
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
    """A slow movement of every driven joint around its configuration, so that friction slides instead of sticking."""

    # fmt: off
    amplitude: Annotated[JointPosition | tuple[JointPosition, ...] | None, Key("Amplitude of the movement on the link "
        "side, one for all joints or one for each; in m of those that slide.", "so large that 2 pi cycles / period "
        "times it keeps the peak speed above the multisine's own over most of the period; smaller where limits or a "
        "change of posture of some degrees count.", above=0)] = None
    cycles: Annotated[int, Key("Cycles of a sine or square in a period of the multisine.", "1 keeps the carrier's line "
        "farthest below the band; more for higher speed with the same swing.", least=1)] = 1
    kind: Annotated[Literal["sine", "square", "offset"], Key("Shape of the movement. `sine`: q(t) = amplitude * sin(2 "
        "pi cycles t / period). `square`: the velocity is a square wave of `velocity` with so many cycles a period, "
        "filtered at 1 Hz, without the harmonics that fall on analysed lines. `offset`: constant `velocity` (its "
        "sign the direction), through the configuration in the middle of the measured periods; the multisine is kept "
        "so small that no motor turns back. Sine and square are periodic with the multisine, on lines below the "
        "excited band.", "`sine` reverses twice a cycle and sticks briefly there; `square` turns quickly, for small "
        "speeds; `offset` never reverses and leaves dry friction out of the response, and takes range: velocity times "
        "the whole record.")] = "sine"
    velocity: Annotated[JointVelocity | tuple[JointVelocity, ...] | None, Key("Speed of the movement on the link side, "
        "one for all joints or one for each; in m/s of those that slide.", "above the Stribeck velocity of the gear, "
        "and above the multisine's peak speed, so that friction keeps one sign.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if (self.kind == "sine") != (self.amplitude is not None) or (self.kind == "sine") == (
            self.velocity is not None
        ):
            needed = "amplitude" if self.kind == "sine" else "velocity"
            raise ValueError(f"a carrier of kind {self.kind} is given by its {needed} alone")
        if self.velocity is not None and 0.0 in np.atleast_1d(self.velocity):
            raise ValueError("the carrier's velocity must not be 0 for any joint; friction would stick there")

    def refusal(self, n_u: int, lowest: int) -> str:
        """Why it does not go with n_u motors and the lowest line, in periods; empty where it does."""
        given = self.amplitude if self.velocity is None else self.velocity
        if isinstance(given, tuple) and len(given) not in (1, n_u):
            return f"{len(given)} numbers for {n_u} motors; give one for all or one for each"
        if self.kind == "offset" or self.cycles < lowest:
            return ""
        return (
            f"{self.cycles} cycles a period are not below the lowest excited line, of {lowest} a period; take fewer, "
            "or raise excitation.band_hz"
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
class SimulatedSpec:
    """A rig that is a model: the study's robot, with the truth that the fit must find in place of some numbers."""

    # fmt: off
    truth: Annotated[dict[str, Quantity], Key("True parameters of the simulated robot, name to value.", "give the "
        "numbers that the fit should find, such as {k_2: 8e5}, away from the robot's own by the error that you expect "
        "of them; without it the fit starts at the answer.")] = field(default_factory=dict)
    outputs: Annotated[tuple[str, ...], Key("Places whose motion is logged (default: every motor): `motor 1`, `joint "
        "1`, `body arm z` and `frame tool rz` as angles, `frame tool z` and `accelerometer tool z` as accelerations.",
        "add the tool's accelerations where motor angles alone leave bearing or link springs ill-conditioned; each "
        "place adds rows to every response and to the time of a fit.", distinct=True)] = ()
    controller: Annotated[ControllerSpec, Key("Controller of the joints.", "give the bandwidth of the real loop where "
        "the plan is for a real robot, since the loop shapes what reaches the joints.")] = ControllerSpec()
    carrier: Annotated[CarrierSpec | None, Key("Slow movement under the excitation (default: none).", "with dry "
        "friction, always: joints that stick and slip in turn distort the low lines. Without friction it only takes "
        "range from the limits.")] = None
    noise: Annotated[NoiseSpec, Key("Noise of the sensors and disturbances.", "the levels of the real sensors make the "
        "predicted intervals those of the robot; all are 0 unless given, and intervals then show the integration error "
        "alone.")] = NoiseSpec()
    substeps: Annotated[int | None, Key("Number of integration steps per sample of the controller (default: 2, or as "
        "many as the end of the band and the stiffest mode ask for).", "a number to see that results do not change "
        "with it, or for hard friction without a carrier; the simulation takes that many times as long.",
        least=1)] = None
    saturation: Annotated[bool, Key("Motor torques are clipped at the joints' limits.torque if true; otherwise "
        "exceeding them is reported.", "true shows what a robot whose drives clip does to the responses; a plan within "
        "limits needs it not.")] = False
    torque_ripple: Annotated[tuple[TorqueRippleSpec, ...], Key("Cogging torques that repeat with the motors' turns.",
        "for motors whose cogging is above the noise of the torque; a carrier turns it into lines of its own.")] = ()
    heat: Annotated[HeatSpec | None, Key("Temperature of joints whose friction is identified (default: constant).",
        "in a study of friction whose law has temperature terms; without it warm_up has nothing to show.")] = None
    model: Annotated[ModelSpec, Key("Equations of motion of the rig, independent of those of the fit.", "another "
        "formulation or variant than the fit's shows what that approximation costs in parameters.")] = ModelSpec()
    compiled: Annotated[bool, Key("The equations are compiled by the C compiler of the machine ($CC, cc, gcc or clang) "
        "in a temporary folder.", "true where minutes of robot time are simulated: about three times as fast, with the "
        "same bytes. Without a compiler a warning says so, and the equations are interpreted.")] = False
    # fmt: on

    def steps(self, rate_hz: float, highest_hz: float) -> int:
        """Integration steps in a sample, for a band that ends at highest_hz: 3.7e-4 (omega step)^6 is at most 4e-6.

        That is the relative error of a frequency by the steps of the rig (`Tableau`).
        """
        least = 2 * math.pi * highest_hz / rate_hz / (4e-6 / 3.7e-4) ** (1 / 6)
        return self.substeps or max(2, math.ceil(least))
