"""The sections `recorded` and `responses` of an experiment: log files, and responses that were measured elsewhere."""

from dataclasses import field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from elastid.base.names import at_amplitude
from elastid.base.section import Key, section
from elastid.base.units import Frequency, JointVelocity, Temperature, Time
from elastid.experiment.specs.channels import ChannelSpec
from elastid.record import Hold
from elastid.simulation.spec import ControllerSpec, GainsSpec, ReferencePathSpec


@section
class CascadeSpec(GainsSpec):
    """The robot controller of the logs, so that validation can repeat it: a cascade with a share of feed-forward.

    u = H K_v [e + (1 / T_i) integral of e], e = K_p (q_ref - q) + s q_ref' - q', q the motor's angle on the link side.
    """

    # fmt: off
    velocity_feedforward: Annotated[float, Key("Velocity feedforward (factor s) of channels with role reference.",
        "1 for controllers without velocity lag; a value that is too small causes a position error proportional to "
        "speed. It replaces reference.velocity_feedforward.", least=0, most=1)] = 0.0
    reference: Annotated[ReferencePathSpec | None, Key("Path of the references into the controller (default: unknown).",
        "if the log has the rate of the references, because their steps then alias into the torques. elastid subtracts "
        "the aliases if the log contains the references. Otherwise this needs positions and a cycle of at least "
        "about 2 ms.")] = None
    velocity: Annotated[Literal["difference", "exact"], Key("Velocity in the feedback: `difference` of two encoder "
        "positions, or `exact` (the velocity of the simulation).", "`exact` for logs of simulators, whose controllers "
        "read the joint velocity of the state.")] = "difference"
    ticks: Annotated[int, Key("Samples of the controller in a cycle of the references.", "4 for a controller at 1 kHz "
        "and references every 4 ms.", least=1)] = 32
    # fmt: on

    @property
    def cycle(self) -> float:
        """Cycle of the references in s, 0 if their path is unknown."""
        return 0.0 if self.reference is None else self.reference.cycle

    @property
    def tick_hz(self) -> float:
        """Sampling rate of the controller, 0 if the path of its references is unknown."""
        return self.ticks / self.cycle if self.cycle else 0.0

    @property
    def spec(self) -> ControllerSpec:
        """Controller of a simulated rig with these gains, which feeds all velocity forward."""
        return ControllerSpec(kind="cascade", gains=self, reference=self.reference)


Period: TypeAlias = Time | Literal["find", "none"]


@section
class TextFormatSpec:
    """Format of CSV and text logs."""

    # fmt: off
    delimiter: Annotated[str, Key("Delimiter between columns: a character, `tab`, or `whitespace` (any run of blanks "
        "and tabs).", "`;` for files with decimal comma, `whitespace` for most MATLAB and Fortran text files.")] = ","
    decimal: Annotated[Literal[".", ","], Key("Decimal mark, `,` for numbers such as 1,5.", "`,` for files with German "
        "or French settings; the delimiter must differ.")] = "."
    header_lines: Annotated[int, Key("Number of header rows to skip; headings are the last skipped row or the next row "
        "without numbers.", "if a preamble precedes the headings.")] = 0
    comment: Annotated[str, Key("Character at the start of a comment row.", "for files with comments that start with % "
        "or //.")] = "#"
    # fmt: on


@section
class FileSpec:
    """One log file and its contents."""

    # fmt: off
    path: Annotated[str, Key("Path of the log file, relative to the study.", "keep the logs next to the study.")]
    configuration: Annotated[str, Key("Configuration of the measurement (default: none in friction studies; needed "
        "otherwise, and for joints without a channel).", "a name of experiment.configurations; logs of one "
        "configuration are estimated together.")] = ""
    realisation: Annotated[int, Key("Number of the realisation of the phases, from 0.", "a new number for new random "
        "phases.", least=0)] = 0
    experiment: Annotated[int, Key("Number of the experiment in its realisation, from 0.", "as many as motors unless a "
        "local method is used; equal numbers are further periods of one experiment.", least=0)] = 0
    at: Annotated[dict[str, str], Key("Locations of hammer and sensors in this file, by `at` of their channels "
        "(default: the locations in channels).", "{hammer: point 2} for the file of the second hit "
        "point; each point needs its own experiment number.")] = field(default_factory=dict)
    amplitude: Annotated[int, Key("Number of the excitation amplitude, from 1.", "2 and so on for the same "
        "configuration with another torque; elastid estimates one response per amplitude.", least=1)] = 1
    samples: Annotated[tuple[int, int] | None, Key("Range [first, last) of the used samples (default: all).",
        "to remove samples before the start or after a stop; elastid selects whole periods itself. If channels have "
        "several clocks, count at rate_hz from the latest start of a channel.")] = None
    also: Annotated[tuple[str, ...], Key("Other logs of the same experiment, aligned by a signal in both, by "
        "recorded.time, by torques and accelerations, or by row number.", "for signals of another logger; log r, "
        "reference or a motion in both files if it started at another time.")] = ()
    period: Annotated[Period | None, Key("Period of the excitation in this file (default: period of the section).",
        "for files with different excitations; `none` for a transient.", most=1e6)] = None
    period_samples: Annotated[float | None, Key("Period of the excitation in this file in samples (default: "
        "period_samples of the section).", "for one file with a drifting clock.")] = None
    joint: Annotated[str, Key("Name of the joint that moves (default: every moving joint with torque and position).",
        "if several joints move and only one is to be identified.")] = ""
    purpose: Annotated[Literal["motion", "presliding_loops", "presliding_test", "warm_up", "coast_down"], Key(
        "Purpose of the log in a friction study. `motion`: constant-velocity runs and any other motion. "
        "`presliding_loops`: growing torque, no sliding. `presliding_test`: small multisine or noise, zero velocity. "
        "`warm_up`: motion to and fro until the joint is warm. `coast_down`: one direction until the joint stops.",
        "presliding_loops identify friction before sliding, presliding_test the stiffness and damping of the bristles, "
        "warm_up the thermal time constants. coast_down identifies friction relative to a known inertia, with drive "
        "off or its torque known.")] = "motion"
    start: Annotated[Time | None, Key("Start time of the log, from the start of the first one (default: end of the log "
        "before).", "for a warm-up in several logs with pauses between them.")] = None
    ambient: Annotated[Temperature | None, Key("Room temperature during a warm-up (default: joint temperature at its "
        "start).", "if the joint was still warm when the log began.")] = None
    speed: Annotated[JointVelocity | None, Key("Speed of the runs in the file (default: any constant velocity).",
        "if several speeds are close together, or the log is noisy.", above=0)] = None
    load: Annotated[str, Key("Name of an entry of friction.loads (default: robot without load).", "give it for every "
        "log with a load.")] = ""
    temperature: Annotated[Temperature | None, Key("Temperature of the joint, for a warm-up at its start (default: "
        "from a channel of role t).", "from a hand-held thermometer; two temperatures identify a temperature "
        "dependence, three over more than 20 K its shape.")] = None
    # fmt: on

    @property
    def run(self) -> tuple[str, int, int]:
        """Configuration, realisation and experiment; files of one run hold further periods of its excitation."""
        return at_amplitude(self.configuration, self.amplitude), self.realisation, self.experiment

    def __post_init__(self) -> None:
        _check_period(self.period, self.period_samples)


@section
class RecordedSpec:
    """A rig that is a folder of lab logs."""

    # fmt: off
    rate_hz: Annotated[Frequency | Literal["unknown"], Key("Sampling rate of the logs, or `unknown` (frequencies are "
        "then relative to it).", "an error scales all frequencies, and all stiffnesses by its square; `unknown` only "
        "for structures without a robot.", above=0, most=1e9)]
    channels: Annotated[tuple[ChannelSpec, ...], Key("Signals of the logs.", "at least one torque (u) and one "
        "position, velocity or acceleration (y); add the injected torque (r) for closed-loop estimators. References "
        "of a known controller may replace the torques.")]
    files: Annotated[tuple[FileSpec, ...], Key("Log files.", "one entry per experiment; realisations and experiments "
        "are numbered from 0 in each configuration.", filled=True)]
    period: Annotated[Period | None, Key("Period of the excitation, `find` to estimate it from the torques, or `none` "
        "for an aperiodic record such as noise or a sweep from rest (default: none).", "the period of the signal "
        "generator is best; `find` needs two periods and distinct lines.", most=1e6)] = None
    period_samples: Annotated[float | None, Key("Period of the excitation in samples, also fractional, instead of "
        "period (default: period).", "if the clocks of generator and logger differ, such as 12480.02 samples.")] = None
    text: Annotated[TextFormatSpec, Key("Format of CSV files.", "if `elastid inspect` shows one column instead of "
        "several, or numbers as text.")] = TextFormatSpec()
    half_wave: Annotated[bool, Key("If true, the excitation has odd lines only, and the negated second half of a "
        "period counts as a repetition.", "true for odd grids with few periods; even lines would turn into "
        "noise.")] = False
    time: Annotated[str, Key("Name of the channel with time stamps (s, ms, us, ns, or date and time), from which "
        "the samples are interpolated to rate_hz (default: uniform sampling).", "for logs with dropouts or jitter, or "
        "with an uncertain rate.")] = ""
    hold: Annotated[Hold, Key("Behaviour of the acting torques between samples. `zero-order`: logged commands; the "
        "model then includes half a sample of delay, a sinc and aliases. `band-limited`: torques measured through a "
        "filter, or much faster than the update of the drive.", "`zero-order` for commands; a wrong choice shows as a "
        "misfit that grows towards half the sampling rate.")] = "band-limited"
    controller: Annotated[CascadeSpec | None, Key("Controller of the robot, for `elastid loops` and for studies with "
        "reference channels (default: unknown controller).", "give it to validate friction in closed loop; needed to "
        "identify friction or elasticity from references without torques.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        self._check_files_and_rates()
        _check_period(self.period, self.period_samples)
        periods = (self.period, *(file.period for file in self.files))
        if self.rate_hz == "unknown" and any(isinstance(period, float | int) for period in periods):
            raise ValueError("rate_hz is unknown. Give period_samples instead of period")
        roles = {channel.role for channel in self.channels}
        if "u" not in roles and "reference" in roles and self.controller is None:
            raise ValueError("no channel has role u. Add a torque; or, for friction by commands alone, give controller")
        for role, name in (("u", "input"), ("y", "output")):
            if role not in roles and not (role == "u" and self.has_no_torque):
                raise ValueError(f"no channel has role {role} (an {name})")
        for file in self.files:
            samples = self.period_of(file)
            if samples is None and self.half_wave:
                raise ValueError(
                    f"half_wave needs a period, and {file.path} has no period. Give period or period_samples, or "
                    "remove half_wave"
                )
            if self.half_wave and isinstance(samples, float) and samples % 2 == 1:
                raise ValueError(f"half_wave needs an even number of samples per period, not {samples:g}")
            if isinstance(samples, float) and samples < 2:
                raise ValueError(
                    f"the period of {file.path} is {samples:.6g} samples; at least 2 are needed. Check period and "
                    "rate_hz"
                )

    @property
    def has_no_torque(self) -> bool:
        """True if the logs have references of a known controller, and no torque."""
        roles = {channel.role for channel in self.channels}
        return "u" not in roles and "reference" in roles and self.controller is not None

    def places_of(self, configuration: str, role: str) -> tuple[str, ...]:
        """Return locations of the channels of a role (u, y) in all files of a configuration."""
        files = [file for file in self.files if file.configuration == configuration]
        channels = [channel.at for channel in self.channels if channel.role == role]
        return tuple(dict.fromkeys(file.at.get(at, at) for file in files for at in channels))

    @property
    def log_names(self) -> tuple[str, ...]:
        """The names that records of the files have: their stems, numbered where two are the same."""
        stems = [Path(file.path).stem for file in self.files]
        return tuple(f"{stem}-{i}" if stems.count(stem) > 1 else stem for i, stem in enumerate(stems, start=1))

    @property
    def known_rate_hz(self) -> float:
        """The sampling rate, 1 where unknown."""
        return 1.0 if isinstance(self.rate_hz, str) else float(self.rate_hz)

    def period_of(self, file: FileSpec) -> float | Literal["find"] | None:
        """Return samples of a file's period at the study's rate, whole or not; `find` as stated, None without one."""
        section = self if file.period is None and file.period_samples is None else file
        if section.period_samples is not None:
            return float(section.period_samples)
        if section.period is None or section.period == "none":
            return None
        return "find" if section.period == "find" else float(section.period) * self.known_rate_hz

    def repeat_refusal(self, number: int) -> str:
        """Return why a file may not have the numbers of an earlier one; empty if it has further periods, or no one."""
        file = self.files[number]
        earlier = [previous for previous in self.files[:number] if previous.run == file.run]
        periods = {self.period_of(entry) for entry in (*earlier[:1], file)}
        is_repeated = any((previous.path, previous.samples) == (file.path, file.samples) for previous in earlier)
        is_repeated |= any(previous.at != file.at for previous in earlier)
        if not earlier or (len(periods) == 1 and None not in periods and not is_repeated):
            return ""
        return (
            f"{earlier[0].path} and {file.path} are both configuration {file.configuration}, realisation "
            f"{file.realisation}, experiment {file.experiment}, but not samples of one known period. Give each its own "
            "experiment (same phases or another input) or realisation (other phases)"
        )

    def _check_files_and_rates(self) -> None:
        last = 1 + min((len(file.also) for file in self.files), default=0)
        for channel in self.channels:
            if channel.file > last:
                raise ValueError(
                    f"a channel is in file {channel.file} of an experiment with {last} (path, also). Correct file"
                )
            if channel.role == "u" and channel.file != 1:
                raise ValueError("acting torques (role u) must be in the first file of an experiment")
        if self.rate_hz == "unknown" and (self.time or any(channel.rate_hz is not None for channel in self.channels)):
            raise ValueError("with rate_hz: unknown, time and a channel's rate_hz have no meaning. Omit them")


def _check_period(period: Period | None, samples: float | None) -> None:
    if period is not None and samples is not None:
        raise ValueError("give either period (s) or period_samples")


@section
class ResponseColumnsSpec:
    """Names of the columns or datasets of a frequency response in a CSV or HDF5 file.

    In a CSV file {y} and {u} stand for the names (`channel`) or the numbers (`column`) of output and input. Either real
    and imaginary, or magnitude and phase.
    """

    # fmt: off
    frequency: Annotated[str, Key("Frequency of the lines.", "heading of the first column in most exports, such as f "
        "or Frequency.")] = "freq_hz"
    response: Annotated[str, Key("Complex dataset of an HDF5 file, with axes frequency, output, input.",
        "for one complex array; its shape identifies the frequency axis.")] = "G"
    real: Annotated[str, Key("Real part of G.", "a pattern with {y} and {u} for several elements, such as "
        "Re({y}/{u}).")] = "re_{y}_{u}"
    imaginary: Annotated[str, Key("Imaginary part of G.", "use the same pattern as for real.")] = "im_{y}_{u}"
    magnitude: Annotated[str, Key("Magnitude |G| (default: real and imaginary parts).", "for files in polar form, "
        "together with phase.")] = ""
    phase: Annotated[str, Key("Phase of G (default: real and imaginary parts).", "needed with magnitude, wrapped or "
        "unwrapped.")] = ""
    std: Annotated[str, Key("Standard deviation of the complex response, sqrt(E|dG|^2) (default: relative_std of the "
        "section).", "give it if available, for the weights; multiply standard deviations of real or imaginary parts "
        "by sqrt(2).")] = ""
    magnitude_unit: Annotated[Literal["1", "dB"], Key("Unit of the magnitude, 1 or dB.", "dB is 20 log10 |G|; negative "
        "magnitudes indicate dB.")] = "1"
    phase_unit: Annotated[Literal["deg", "rad"], Key("Unit of the phase, deg or rad.", "rad if the values stay within "
        "3.2, or are unwrapped.")] = "deg"
    # fmt: on

    def __post_init__(self) -> None:
        if bool(self.magnitude) != bool(self.phase):
            raise ValueError("magnitude and phase belong together. Give both")


@section
class ResponseFileSpec:
    """One file with the frequency response of one configuration."""

    # fmt: off
    path: Annotated[str, Key("Path of the file, relative to the study.", "configurations may come from different "
        "programs and formats.")]
    configuration: Annotated[str, Key("Configuration of the measurement.", "a name of experiment.configurations, whose "
        "angles the model uses.")]
    response: Annotated[str, Key("Name of the response in the file: MATLAB variable or configuration of a frf.h5 "
        "(default: the only one, or the configuration of the same name).", "if a file contains several "
        "responses.")] = ""


@section
class ResponsesSpec:
    """Frequency responses that were measured elsewhere: MATLAB structs, HDF5, CSV, UFF 58, or frf.h5 of elastid."""

    # fmt: off
    files: Annotated[tuple[ResponseFileSpec, ...], Key("Files of the responses, one per configuration.",
        "several configurations separate springs that one configuration cannot.", filled=True)]
    channels: Annotated[tuple[ChannelSpec, ...], Key("Inputs (role u) and outputs (role y) of the files, by column "
        "(from 1) or channel name; not needed for frf.h5.", "list all inputs and outputs in the order of the "
        "files.")] = ()
    frequency_unit: Annotated[Literal["auto", "Hz", "rad/s", "kHz", "rpm"], Key("Unit of the frequencies; `auto` reads "
        "it from the file, or assumes Hz for CSV, UFF and HDF5 without units.", "if all stiffnesses are wrong by a "
        "factor of 39.5 = (2 pi)^2.")] = "auto"
    columns: Annotated[ResponseColumnsSpec, Key("Names of CSV columns and HDF5 datasets.", "for headings other than "
        "freq_hz, re_1_1, im_1_1.")] = field(default_factory=ResponseColumnsSpec)
    text: Annotated[TextFormatSpec, Key("Format of CSV files.", "for a delimiter or decimal sign other than comma and "
        "point.")] = TextFormatSpec()
    relative_std: Annotated[float | None, Key("Standard deviation of G relative to |G| for files without one (default: "
        "unknown; the status is then noise_unknown).", "0.01 to 0.05; the weights are then a guess, and the intervals "
        "rely on the scatter of the residuals.", above=0)] = None
    hold: Annotated[Hold, Key("Behaviour of the inputs between samples. `zero-order`: responses to commands; elastid "
        "removes the hold. A frf.h5 contains its own value.", "`zero-order` for responses from commands to encoder "
        "angles, as most controllers export them.")] = "band-limited"
    rate_hz: Annotated[Frequency | None, Key("Sampling rate of the commands, needed with hold: zero-order here or in "
        "the channels (default: none).", "rate of the controller; half a sample is the delay that elastid removes.",
        above=0)] = None
    # fmt: on

    def __post_init__(self) -> None:
        if self.channels and {channel.role for channel in self.channels} != {"u", "y"}:
            raise ValueError("channels need at least one role u (input) and one role y (output), and no other role")
        if any(
            self.hold_of(channel) != "band-limited" and not (channel.rate_hz or self.rate_hz)
            for channel in self.channels
            if channel.role == "u"
        ):
            raise ValueError("hold: zero-order needs the sampling rate of the commands. Give rate_hz")

    def hold_of(self, channel: ChannelSpec) -> Hold:
        """Return the hold of an input from its channel, or else from the section."""
        return channel.hold or self.hold
