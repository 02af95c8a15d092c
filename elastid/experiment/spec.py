"""The `experiment` section of a study: which configurations, how often, on which rig."""

from __future__ import annotations

from dataclasses import field
from typing import Literal

import numpy as np

from elastid.arrays import FloatArray
from elastid.model.spec import ModelSpec
from elastid.record import MOTION_UNIT
from elastid.section import section
from elastid.units import Angle, AngularVelocity, Frequency, Quantity, Time, Torque, TorqueConstant

# Whatever is more is a slip of the pen.
MOST_REALISATIONS = 10_000
# SI units of what channels hold.
QUANTITY_UNIT = {**MOTION_UNIT, "torque": "N*m", "current": "A"}


@section
class ControllerSpec:
    """The joint controller that closes the loop: position and velocity feedback of the motor, gravity feed-forward.

    bandwidth_hz: of the position loop about the configuration; low, so that the plant and not the loop is excited.
    damping_ratio: of that loop.
    """

    bandwidth_hz: Frequency = 1.5
    damping_ratio: float = 0.8

    def __post_init__(self) -> None:
        """Refuse a loop that cannot hold the robot."""
        if not self.bandwidth_hz > 0 or not self.damping_ratio > 0:
            raise ValueError("bandwidth_hz and damping_ratio must be positive")


@section
class CarrierSpec:
    """A slow movement of every driven joint around its configuration, so that friction slides instead of sticking.

    kind: `sine`: q(t) = amplitude * sin(2 pi cycles t / period).  `square`: the velocity is a square wave of `velocity`
    with so many cycles a period, filtered at cutoff_hz, without the harmonics that fall on analysed lines.  `offset`:
    constant `velocity` (its sign the direction), through the configuration in the middle of the measured periods; the
    multisine is kept so small that no motor turns back.  velocity: link-side, one for all joints or one for each.
    Sine and square are periodic with the multisine, on lines below the excited band.
    """

    amplitude: Angle | None = None
    cycles: int = 1
    kind: Literal["sine", "square", "offset"] = "sine"
    velocity: AngularVelocity | tuple[AngularVelocity, ...] | None = None
    cutoff_hz: Frequency = 1.0

    def __post_init__(self) -> None:
        """Refuse a carrier that does not move."""
        if (self.kind == "sine") != (self.amplitude is not None) or (self.kind == "sine") == (
            self.velocity is not None
        ):
            needed = "amplitude" if self.kind == "sine" else "velocity"
            raise ValueError(f"a carrier of kind {self.kind} is given by its {needed} alone")
        if self.amplitude is not None and not self.amplitude > 0:
            raise ValueError("the carrier's amplitude must be positive and cycles at least 1")
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


@section
class NoiseSpec:
    """What the sensors add, link side: torque_std on the logged torque, angle_std on the logged angles, both white.

    encoder_counts: resolution of the motor encoders in counts per motor turn; 0 = unlimited.
    disturbance_std: torque that acts on the motors, white, unknown to the log.
    """

    torque_std: Torque = 0.0
    angle_std: Angle = 0.0
    disturbance_std: Torque = 0.0
    encoder_counts: int = 0

    def __post_init__(self) -> None:
        """Refuse negative spreads."""
        if min(self.torque_std, self.angle_std, self.disturbance_std, self.encoder_counts) < 0:
            raise ValueError("noise levels must not be negative")


@section
class SimulatedSpec:
    """A rig that is a model: the study's robot with some of its numbers replaced by the truth that the fit must find.

    truth: parameter name to value.  outputs: places that are logged (default: every motor).
    substeps: integration steps per sample of the controller.  model: the rig's equations, whatever the fit's are.
    """

    truth: dict[str, Quantity] = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    controller: ControllerSpec = ControllerSpec()
    carrier: CarrierSpec | None = None
    noise: NoiseSpec = NoiseSpec()
    substeps: int = 2
    model: ModelSpec = ModelSpec()

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
    at: place on the robot (`motor 1`, `joint 1`, `body arm z`).  unit: of the file after `scale`; default SI.
    Value = sign * scale * file value, then unit, then torque_constant (for a current), then the gear ratio for
    side: motor.  file: in which file of an experiment it is, 1 is `path` and 2 the first of `also`.  rate_hz: its own
    sampling rate where it differs; all channels are brought to the lowest one, band-limited.
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
        if self.scale == 0:
            raise ValueError("scale is 0; the channel would be lost")


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

    Further configurations are chosen where the study has a section `design`.

    realisations: independent draws of the random phases.  experiments: of every realisation (default: as many as
    motors, each with all motors moving); fewer are for the local methods of `estimator`, which tell inputs apart by
    neighbouring lines.  periods: measured after transient_periods that are left out.
    ramp: time in which torque and movement grow at the start and fade at the end.  hold: rest before and after that.
    Exactly one of simulated, recorded (logs) and responses (frequency responses from elsewhere).
    """

    configurations: dict[str, tuple[Angle, ...]] = field(default_factory=dict)
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
