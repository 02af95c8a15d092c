"""The `experiment` section of a study: which configurations, how often, on which rig."""

from __future__ import annotations

import math
from dataclasses import field
from typing import Literal

import numpy as np

from elastid.arrays import FloatArray
from elastid.model.spec import ModelSpec
from elastid.record import MOTION_UNIT
from elastid.section import section
from elastid.simulation.spec import StabilisationSpec
from elastid.units import (
    Acceleration,
    Angle,
    Frequency,
    JointPosition,
    JointVelocity,
    Quantity,
    Temperature,
    Time,
    Torque,
    TorqueConstant,
    factor,
    of_translation,
)

# Whatever is more is a slip of the pen.
MOST_REALISATIONS = 10_000
# SI units of what channels hold.
QUANTITY_UNIT = {**MOTION_UNIT, "torque": "N*m", "current": "A"}


@section
class ControllerSpec:
    """The joint controller that closes the loop: position and velocity feedback of the motor, gravity feed-forward.

    bandwidth_hz: of the position loop about the configuration; low, so that the plant and not the loop is excited.
    damping_ratio: of that loop.  kind: `pd`, or the `cascade` of robot controllers, a proportional position loop around
    a velocity loop with integral_time (default: three times 1 / (2 pi bandwidth_hz)).
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
    multisine is kept so small that no motor turns back.  amplitude, velocity: link-side, one for all joints or one for
    each; in m and m/s of those that slide.
    Sine and square are periodic with the multisine, on lines below the excited band.
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
    """Noise of a given spectrum on one of the signals of `noise`, beside the white one; std of it all, SI.

    Flat up to corner_hz, then falling by `slope` dB a decade; or of a table of [frequency in Hz, relative amplitude],
    straight between its points on logarithmic axes and held beyond them.
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
        if self.table:
            f, a = np.log(np.array(self.table)).T
            shaped: FloatArray = np.exp(np.interp(np.log(np.maximum(freq_hz, 1e-300)), f, a))
            return shaped
        assert self.corner_hz is not None
        return np.asarray((1 + (freq_hz / self.corner_hz) ** 2) ** (self.slope / 40))


@section
class EncoderRippleSpec:
    """An error of the motor encoders that repeats `periods` times in a motor turn; amplitude on the motor side."""

    amplitude: Angle
    periods: int = 1
    phase: Angle = 0.0

    def __post_init__(self) -> None:
        """Whole periods a turn."""
        if self.periods < 1:
            raise ValueError(f"periods is {self.periods}; a motor turn has at least 1")


@section
class TorqueRippleSpec:
    """Cogging: a torque on the motors that repeats `periods` times in a motor turn; amplitude on the motor side."""

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

    Level of dry friction: 1 + amplitude exp(-t / time_constant), t from the start of the first run, `pause` between
    runs; spread: standard deviation of a further factor, drawn for every run.  temperature: [cold, warm] of the gears,
    approached with the same time constant, for friction laws that have a `temperature`.
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
    """What the sensors add, link side: torque_std on the logged torque, angle_std on the logged angles, both white.

    The same number counts in N and m where a joint slides.

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
    substeps: integration steps per sample of the controller.  model: the rig's equations, whatever the fit's are.
    loops: how those of a linkage are kept closed.
    saturation: motor torques are clipped at the joints' limits.torque; without it going beyond is reported.
    encoder_ripple, torque_ripple: errors that repeat with the motors' turns.  warming: how friction drifts.
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
    model: ModelSpec = ModelSpec()
    loops: StabilisationSpec = StabilisationSpec()

    def __post_init__(self) -> None:
        """Refuse a simulation without steps, and outputs that would count twice."""
        if len(set(self.outputs)) < len(self.outputs):
            raise ValueError(f"outputs names a place twice ({', '.join(self.outputs)}); its lines would count twice")
        if self.substeps < 1:
            raise ValueError(f"substeps is {self.substeps}; it must be at least 1")


@section
class ChannelSpec:
    """One signal of the log files: where it is in the file, and what it is on the robot.

    channel: variable of a MATLAB file (`theta_m`, `rec.torque` inside a struct), column heading of a CSV file, or path
    of an HDF5 dataset.  column: which column of a matrix, the first is 1.  role: r injected, u acting torque, y motion.
    at: place on the robot (`motor 1`, `joint 1`, `body arm z`, `frame tool x`; `accelerometer tool x` for a sensor that
    feels gravity).  unit: of the file after `scale`; default SI.
    Value = sign * scale * file value, then unit, then torque_constant (for a current), then the gear ratio for
    side: motor (motors that gears couple all together).  file: in which file of an experiment it is, 1 is `path` and 2
    the first of `also`.  rate_hz: its own sampling rate where it differs; all channels are brought to the lowest one,
    band-limited.
    """

    role: Literal["r", "u", "y"]
    at: str
    channel: str = ""
    column: int | None = None
    quantity: Literal["torque", "current", "position", "velocity", "acceleration"] = "torque"
    unit: str = ""
    scale: float = 1.0
    sign: Literal[1, -1] = 1
    torque_constant: TorqueConstant | None = None
    side: Literal["link", "motor"] = "link"
    file: int = 1
    rate_hz: Frequency | None = None

    def __post_init__(self) -> None:
        """Check that role and quantity agree."""
        if self.file < 1:
            raise ValueError(f"file is {self.file}; the first file of an experiment is 1")
        if not self.channel and self.column is None:
            raise ValueError("give channel (a name in the file), column (a number, the first is 1), or both")
        if self.column is not None and self.column < 1:
            raise ValueError(f"column is {self.column}; the first column is 1")
        is_torque = self.quantity in ("torque", "current")
        if is_torque == (self.role == "y"):
            raise ValueError(
                f"role {self.role} does not go with quantity {self.quantity}: r, u are torques, y a motion"
            )
        if self.quantity == "current" and self.torque_constant is None:
            raise ValueError("a current needs torque_constant (N*m/A) to become a torque")
        if self.at.startswith("accelerometer ") and self.quantity not in ("acceleration", "torque"):
            raise ValueError(f"quantity {self.quantity} at {self.at}: an accelerometer measures acceleration")
        if self.scale == 0:
            raise ValueError("scale is 0; the channel would be lost")

    def unit_factor(self, slides: bool) -> float:
        """From the channel's unit to SI; slides: its place translates (m, N). ValueError for a unit that is wrong."""
        unit = QUANTITY_UNIT[self.quantity]
        if self.unit == "g" and self.quantity == "acceleration":
            raise ValueError("unit 'g' is the gram; for multiples of gravity give scale: 9.80665 and unit: m/s^2")
        return factor(self.unit, of_translation(unit) if slides else unit) if self.unit else 1.0


@section
class TextFormatSpec:
    """How CSV and text logs are written.

    delimiter: a character, `tab`, or `whitespace` (any run of blanks and tabs).  decimal: `,` for numbers such as 1,5.
    header_lines: lines to skip; headings are the last of them or the first line after them that holds no numbers.
    """

    delimiter: str = ","
    decimal: Literal[".", ","] = "."
    header_lines: int = 0
    comment: str = "#"


@section
class FileSpec:
    """One log file: which configuration, realisation and experiment it holds. samples: [first, last) to use of it.

    also: other logs of the same experiment, started at other times. Each must hold the excitation r (or one period of
    it and nothing else) of a motor whose r or u is in `path`; its delay is found from that, and taken out.
    """

    path: str
    configuration: str
    realisation: int = 0
    experiment: int = 0
    samples: tuple[int, int] | None = None
    also: tuple[str, ...] = ()


@section
class RecordedSpec:
    """A rig that is a folder of lab logs.

    rate_hz: sampling rate, or `unknown`: frequencies are then in units of it.  period: of the excitation in s, or
    period_samples.  text: format of CSV files.  half_wave: the excitation has odd lines only, so that the second half
    of a period is minus the first; each half then counts as a repetition, and one period gives a noise level.
    time: name of the channel that holds the time in s; what its gaps leave out are missing samples.
    """

    rate_hz: Frequency | Literal["unknown"]
    channels: tuple[ChannelSpec, ...]
    files: tuple[FileSpec, ...]
    period: Time | None = None
    period_samples: int | None = None
    text: TextFormatSpec = TextFormatSpec()
    half_wave: bool = False
    time: str = ""

    def __post_init__(self) -> None:
        """Exactly one period; at least one input and one output; a whole number of samples per period."""
        self._check_files_and_rates()
        if (self.period is None) == (self.period_samples is None):
            raise ValueError("give either period (s) or period_samples")
        if self.rate_hz == "unknown" and self.period is not None:
            raise ValueError("with rate_hz: unknown give period_samples instead of period")
        for role, what in (("u", "input"), ("y", "output")):
            if not any(channel.role == role for channel in self.channels):
                raise ValueError(f"no channel has role {role} (an {what})")
        if not self.files:
            raise ValueError("files is empty; list at least one log file")
        if self.period is not None and not isinstance(self.rate_hz, str):
            samples = self.period * self.rate_hz
            if samples < 2 or abs(samples - round(samples)) > 1e-6 * samples:
                raise ValueError(
                    f"period {self.period:g} s is {samples:.6g} samples at {self.rate_hz:g} Hz, not a whole number; "
                    "check both, or give period_samples"
                )

    def _check_files_and_rates(self) -> None:
        last = 1 + min((len(file.also) for file in self.files), default=0)
        for channel in self.channels:
            if channel.file > last:
                raise ValueError(
                    f"a channel is in file {channel.file} of an experiment; one has {last} only (path, also)"
                )
            if channel.role == "u" and channel.file != 1:
                raise ValueError("the torques that act (role u) must be in the first file of an experiment")
        if self.rate_hz == "unknown" and (self.time or any(channel.rate_hz is not None for channel in self.channels)):
            raise ValueError("with rate_hz: unknown neither time nor a channel's own rate_hz means anything")


@section
class ResponseColumnsSpec:
    """Where a CSV or HDF5 file keeps a frequency response: names of columns or datasets.

    In a CSV file {y} and {u} stand for the names (`channel`) or the numbers (`column`) of output and input.  Either
    real and imaginary, or magnitude and phase.  HDF5: response names a complex dataset with an axis of frequencies;
    the two others are outputs, inputs.  std: standard deviation of the complex number, sqrt(E|dG|^2), if there is one.
    """

    frequency: str = "freq_hz"
    response: str = "G"
    real: str = "re_{y}_{u}"
    imaginary: str = "im_{y}_{u}"
    magnitude: str = ""
    phase: str = ""
    std: str = ""
    magnitude_unit: Literal["1", "dB"] = "1"
    phase_unit: Literal["deg", "rad"] = "deg"

    def __post_init__(self) -> None:
        """A magnitude needs its phase."""
        if bool(self.magnitude) != bool(self.phase):
            raise ValueError("give magnitude and phase together; without the phase nothing can be fitted")


@section
class ResponseFileSpec:
    """One file with the frequency response of one configuration.

    response: which response of the file: variable of a MATLAB file, configuration of a frf.h5 of elastid (default:
    the only one; of frf.h5 the configuration of the same name).
    """

    path: str
    configuration: str
    response: str = ""


@section
class ResponsesSpec:
    """Frequency responses that were measured elsewhere: MATLAB structs, HDF5, CSV, UFF 58, or frf.h5 of elastid.

    channels: what the inputs (role u) and outputs (role y) of the files are; column is their number in the file, the
    first is 1, or channel their name.  frf.h5 of elastid needs none.  frequency_unit: `auto` is what the file says, or
    Hz for CSV, HDF5 without units and UFF.  relative_std: standard deviation of G as a part of |G| where a file tells
    none.
    """

    files: tuple[ResponseFileSpec, ...]
    channels: tuple[ChannelSpec, ...] = ()
    frequency_unit: Literal["auto", "Hz", "rad/s", "kHz", "rpm"] = "auto"
    columns: ResponseColumnsSpec = ResponseColumnsSpec()
    text: TextFormatSpec = TextFormatSpec()
    relative_std: float | None = None

    def __post_init__(self) -> None:
        """At least one file; inputs and outputs, or no channels at all."""
        if not self.files:
            raise ValueError("files is empty; list at least one file")
        roles = {channel.role for channel in self.channels}
        if self.channels and roles != {"u", "y"}:
            raise ValueError("channels must have roles u (inputs) and y (outputs), at least one of each and no other")
        if self.relative_std is not None and not self.relative_std > 0:
            raise ValueError(f"relative_std is {self.relative_std:g}; it must be positive, for example 0.02")


@section
class ExperimentSpec:
    """Configurations (name to angles of the driven joints), how often each is measured, and on which rig.

    Of a joint that slides the angle is its position in m.
    Further configurations are chosen where the study has a section `design`.

    realisations: independent draws of the random phases.  experiments: of every realisation (default: as many as
    motors, each with all motors moving); fewer are for the local methods of `estimator`, which tell inputs apart by
    neighbouring lines.  periods: measured after transient_periods that are left out.
    ramp: time in which torque and movement grow at the start and fade at the end.  hold: rest before and after that.
    Exactly one of simulated, recorded (logs) and responses (frequency responses from elsewhere).
    """

    configurations: dict[str, tuple[JointPosition, ...]] = field(default_factory=dict)
    realisations: int = 2
    periods: int = 2
    transient_periods: int = 1
    ramp: Time = 0.5
    hold: Time = 0.0
    experiments: int | None = None
    simulated: SimulatedSpec | None = None
    recorded: RecordedSpec | None = None
    responses: ResponsesSpec | None = None

    def __post_init__(self) -> None:
        """Exactly one kind; counts that give a variance."""
        if sum(kind is not None for kind in (self.simulated, self.recorded, self.responses)) != 1:
            raise ValueError("give exactly one of simulated, recorded and responses")
        for name, number, least in (
            ("realisations", self.realisations, "1"),
            ("experiments", 1 if self.experiments is None else self.experiments, "1"),
            ("periods", self.periods, "2, for the noise level"),
            ("transient_periods", self.transient_periods, "0"),
        ):
            if number < int(least[0]):
                raise ValueError(f"{name} is {number}; it must be at least {least}")
        if self.realisations > MOST_REALISATIONS:
            raise ValueError(
                f"realisations is {self.realisations}; more than {MOST_REALISATIONS} help nobody, 2 to 20 do"
            )
        if self.ramp < 0 or self.hold < 0:
            raise ValueError("ramp and hold are times; they must not be negative")

    def runs(self, n_u: int) -> int:
        """How many experiments a realisation has on a robot of n_u motors."""
        return n_u if self.experiments is None else self.experiments

    @property
    def kind(self) -> Literal["simulated", "recorded", "responses"]:
        """Where the data come from, which decides what stages a study has."""
        if self.simulated is not None:
            return "simulated"
        return "recorded" if self.recorded is not None else "responses"
