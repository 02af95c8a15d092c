"""The `experiment` section of a study: which configurations, how often, on which rig."""

from __future__ import annotations

from dataclasses import field
from typing import Literal

from elastid.section import section
from elastid.units import Angle, Frequency, Quantity, Time, Torque, TorqueConstant


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

    q(t) = amplitude * sin(2 pi cycles t / period): periodic with the multisine, on a line below the excited band.
    """

    amplitude: Angle
    cycles: int = 1

    def __post_init__(self) -> None:
        """Refuse a carrier that does not move."""
        if not self.amplitude > 0 or self.cycles < 1:
            raise ValueError("the carrier's amplitude must be positive and cycles at least 1")


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
    substeps: integration steps per sample of the controller.
    """

    truth: dict[str, Quantity] = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    controller: ControllerSpec = ControllerSpec()
    carrier: CarrierSpec | None = None
    noise: NoiseSpec = NoiseSpec()
    substeps: int = 2

    def __post_init__(self) -> None:
        """Refuse a simulation without steps."""
        if self.substeps < 1:
            raise ValueError(f"substeps is {self.substeps}; it must be at least 1")


@section
class ChannelSpec:
    """One signal of the log files: where it is in the file, and what it is on the robot.

    channel: variable of a MATLAB file (`theta_m`, `rec.torque` inside a struct), column heading of a CSV file, or path
    of an HDF5 dataset.  column: which column of a matrix, the first is 1.  role: r injected, u acting torque, y motion.
    at: place on the robot (`motor 1`, `joint 1`, `body arm z`).  unit: of the file after `scale`; default SI.
    Value = sign * scale * file value, then unit, then torque_constant (for a current), then the gear ratio for
    side: motor.
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

    def __post_init__(self) -> None:
        """Check that role and quantity agree."""
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
    """One log file: which configuration, realisation and experiment it holds. samples: [first, last) to use of it."""

    path: str
    configuration: str
    realisation: int = 0
    experiment: int = 0
    samples: tuple[int, int] | None = None


@section
class RecordedSpec:
    """A rig that is a folder of lab logs.

    rate_hz: sampling rate, or `unknown`: frequencies are then in units of it.  period: of the excitation in s, or
    period_samples.  text: format of CSV files.  half_wave: the excitation has odd lines only, so that the second half
    of a period is minus the first; each half then counts as a repetition, and one period gives a noise level.
    """

    rate_hz: Frequency | Literal["unknown"]
    channels: tuple[ChannelSpec, ...]
    files: tuple[FileSpec, ...]
    period: Time | None = None
    period_samples: int | None = None
    text: TextFormatSpec = TextFormatSpec()
    half_wave: bool = False

    def __post_init__(self) -> None:
        """Exactly one period; at least one input and one output; a whole number of samples per period."""
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


@section
class ExperimentSpec:
    """Configurations (name to angles of the driven joints), how often each is measured, and on which rig.

    Further configurations are chosen where the study has a section `design`.

    realisations: independent draws of the random phases.  periods: measured after transient_periods that are left out.
    Exactly one of simulated and recorded.
    """

    configurations: dict[str, tuple[Angle, ...]] = field(default_factory=dict)
    realisations: int = 2
    periods: int = 2
    transient_periods: int = 1
    simulated: SimulatedSpec | None = None
    recorded: RecordedSpec | None = None

    def __post_init__(self) -> None:
        """Exactly one rig; counts that give a variance."""
        if (self.simulated is None) == (self.recorded is None):
            raise ValueError("give exactly one of simulated and recorded")
        if self.realisations < 1 or self.periods < 2 or self.transient_periods < 0:
            raise ValueError("realisations must be at least 1, periods at least 2 (for the noise level)")
