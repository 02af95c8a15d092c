"""The sections `recorded` and `responses` of an experiment: log files, and responses that were measured elsewhere."""

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from elastid.base.names import at_amplitude
from elastid.base.section import Key, section
from elastid.base.units import Frequency, JointVelocity, Temperature, Time
from elastid.experiment.specs.channels import ChannelSpec
from elastid.record import Hold
from elastid.simulation.spec import ControllerSpec, GainsSpec


@section
class CascadeSpec(GainsSpec):
    """The robot controller of the logs, so that validation can repeat it: a cascade with a share of feed-forward.

    u = H K_v [e + (1 / T_i) integral of e], e = K_p (q_ref - q) + s q_ref' - q', q the motor's angle on the link side.
    """

    # fmt: off
    velocity_feed_forward: Annotated[float, Key("Share s of the reference's velocity that is fed forward, 0 to 1. The "
        "reference is in the log as channels of role reference.", "1 for controllers that follow without lag; too "
        "small a number shows as a position error in proportion to speed.", least=0, most=1)] = 0.0
    # fmt: on

    @property
    def spec(self) -> ControllerSpec:
        """Controller of a simulated rig with these gains, which feeds all velocity forward."""
        return ControllerSpec(kind="cascade", gains=self)


Period: TypeAlias = Time | Literal["find", "none"]


@section
class TextFormatSpec:
    """Format of CSV and text logs."""

    # fmt: off
    delimiter: Annotated[str, Key("Delimiter between columns: a character, `tab`, or `whitespace` (any run of blanks "
        "and tabs).", "`;` comes with a decimal comma, `whitespace` with most MATLAB and Fortran text.")] = ","
    decimal: Annotated[Literal[".", ","], Key("Decimal mark, `,` for numbers such as 1,5.", "for logs from machines "
        "with German or French settings; the delimiter must then be another sign.")] = "."
    header_lines: Annotated[int, Key("Number of lines to skip; headings are the last of them or the first line after "
        "them that holds no numbers.", "where a preamble of text precedes the headings; headings alone are found "
        "without it.")] = 0
    comment: Annotated[str, Key("Character that begins a line that is skipped.", "where notes in the file begin with % "
        "or //, as in exports of some data loggers.")] = "#"
    # fmt: on


@section
class FileSpec:
    """One log file and its contents."""

    # fmt: off
    path: Annotated[str, Key("Path of the log file, relative to the study.", "put the logs next to the study, so that "
        "both move together.")]
    configuration: Annotated[str, Key("Configuration that the file was measured in. Studies of friction need none but "
        "for joints at rest that are not in the log.", "one of experiment.configurations; logs of one posture are "
        "estimated together.")] = ""
    realisation: Annotated[int, Key("Number of the phases' realisation, from 0.", "another number for other random "
        "phases; the same phases again add nothing about distortion.")] = 0
    experiment: Annotated[int, Key("Number of the experiment in its realisation, from 0.", "as many as motors unless a "
        "local method is used. Files with the same configuration, realisation and experiment are further periods of "
        "one excitation.")] = 0
    amplitude: Annotated[int, Key("Number of the excitation amplitude, from 1.", "2 and so on for logs of the same "
        "posture with less or more torque. Each amplitude is a response of its own; `gears` fits all of them "
        "together.", least=1)] = 1
    samples: Annotated[tuple[int, int] | None, Key("Range [first, last) of the samples that are used.", "to cut off "
        "what is before the start, or after a stop; whole periods are found by themselves.")] = None
    also: Annotated[tuple[str, ...], Key("Other logs of the same experiment, aligned by a common reference r, by "
        "recorded.time, or by row number.", "for signals of another logger. A log that started at another time needs "
        "the excitation r of a motor whose r or u is in `path`: elastid estimates the delay and removes it.")] = ()
    period: Annotated[Period | None, Key("Period of the excitation in this file where it differs from that of the "
        "others.", "where files of several excitations are in one study; `none` for a single transient among "
        "them.")] = None
    period_samples: Annotated[float | None, Key("Period of the excitation in this file in samples where it differs "
        "from that of the others.", "for one file whose clock drifted, instead of its period in s.")] = None
    joint: Annotated[str, Key("Name of the joint that moves (default: every moving joint with torque and position).",
        "if several joints move and only one is to be identified.")] = ""
    purpose: Annotated[Literal["motion", "presliding_loops", "presliding_test", "warm_up", "coast_down"], Key(
        "Purpose of the log in a friction study: `motion` (constant-velocity runs and any other motion), "
        "`presliding_loops` (growing torque, no sliding), `presliding_test` (small multisine or noise, zero velocity), "
        "`warm_up` (motion to and fro until the joint is warm) or `coast_down` (one direction until standstill).",
        "presliding_loops identify friction before sliding, presliding_test the stiffness and damping of the bristles, "
        "warm_up the thermal time constants. coast_down identifies friction relative to a known inertia, with drive "
        "off or its torque known.")] = "motion"
    start: Annotated[Time | None, Key("Start time of the log, from the start of the first one (default: end of the log "
        "before).", "for a warm-up in several logs with pauses between them.")] = None
    ambient: Annotated[Temperature | None, Key("Room temperature during a warm-up (default: joint temperature at its "
        "start).", "if the joint was still warm when the log began.")] = None
    speed: Annotated[JointVelocity | None, Key("Speed of the runs in the file (default: any constant velocity).",
        "if several speeds are close together, or the log is noisy.", above=0)] = None
    load: Annotated[str, Key("Name of one of friction.loads.", "name it in every log of a study with loads; logs "
        "without it count as the robot alone.")] = ""
    temperature: Annotated[Temperature | None, Key("Temperature of the joint, of a warm-up at its start, where no "
        "channel of role t has it.",
        "a hand thermometer's reading; two of them let friction depend on temperature, three over more than 20 K show "
        "how.")] = None
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
    rate_hz: Annotated[Frequency | Literal["unknown"], Key("Sampling rate of the logs, or `unknown`: frequencies are "
        "then in units of it.", "the clock of the log; a wrong number scales all frequencies and, squared, all "
        "stiffnesses. `unknown` is for structures without a robot.", above=0)]
    channels: Annotated[tuple[ChannelSpec, ...], Key("Signals of the logs.", "at least one torque (u) and one motion "
        "(y); give r as well where the injected torque is logged, which closed-loop estimators use.")]
    files: Annotated[tuple[FileSpec, ...], Key("Log files.", "one entry an experiment; realisations and experiments "
        "are numbered in each configuration from 0.")]
    period: Annotated[Period | None, Key("Period of the excitation, `find` where it is to be found in the torques, or "
        "`none`, as without the key: the whole record is then one transient (noise, a sweep from rest).", "the number "
        "that the generator had is best; `find` needs two periods in the log and lines that stand out; `none` for "
        "noise and for sweeps from rest.")] = None
    period_samples: Annotated[float | None, Key("Period of the excitation in samples, in place of period, whole or "
        "not.", "where the clocks of generator and logger differ and the period is no whole number of samples, such as "
        "12480.02.")] = None
    text: Annotated[TextFormatSpec, Key("Format of CSV files.", "where `elastid inspect` shows one column in place of "
        "several, or numbers as text.")] = TextFormatSpec()
    half_wave: Annotated[bool, Key("The excitation has odd lines only if true, so that the second half of a period is "
        "minus the first; each half then counts as a repetition, and one period gives a noise level.", "true for odd "
        "grids with few periods; wrong for full or even lines, whose response it would halve into noise.")] = False
    time: Annotated[str, Key("Name of the channel that holds the time in s; samples are brought from its stamps to "
        "rate_hz where they are uneven or have another rate, and gaps in it are missing samples.", "give it for logs "
        "with dropouts or jitter, or whose rate is not known well; with a fixed clock rate_hz is enough.")] = ""
    hold: Annotated[Hold, Key("Course of the acting torques between their samples. `zero-order` where u is a command "
        "that the drive keeps from each sample to the next: it acts half a sample later than its samples say, and "
        "weaker by a sinc, and angles (quantity: position) that are logged at the same rate, sampled without a filter, "
        "contain images of it, which the model then has too. `band-limited` where u was measured through a filter, or "
        "logged much faster than the drive updates it.", "a wrong choice costs half a sample of delay and, towards "
        "half the rate, a sinc; a misfit that grows so towards the upper edge is its sign (residuals 1.27 times the "
        "noise and a spring off by 13 % in one case). Measured torques have passed a filter, hence the "
        "default.")] = "band-limited"
    controller: Annotated[CascadeSpec | None, Key("Controller of the robot, whose sensitivity `elastid loops` states; "
        "in studies of friction whose channels have its reference.", "so that validation of friction replays the logs "
        "in closed loop; without it the law is judged on torques alone.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        self._check_files_and_rates()
        _check_period(self.period, self.period_samples)
        periods = (self.period, *(file.period for file in self.files))
        if self.rate_hz == "unknown" and any(isinstance(period, float | int) for period in periods):
            raise ValueError("with rate_hz: unknown give period_samples instead of period")
        for role, name in (("u", "input"), ("y", "output")):
            if not any(channel.role == role for channel in self.channels):
                raise ValueError(f"no channel has role {role} (an {name})")
        if not self.files:
            raise ValueError("files is empty; list at least one log file")
        for file in self.files:
            samples = self.period_of(file)
            if samples is None and self.half_wave:
                raise ValueError(
                    f"half_wave says that {file.path} repeats with opposite sign, but it has no period; give period or "
                    "period_samples, or leave half_wave out"
                )
            if self.half_wave and isinstance(samples, float) and samples % 2 == 1:
                raise ValueError(f"half_wave needs an even number of samples per period, not {samples:g}")
            if isinstance(samples, float) and samples < 2:
                raise ValueError(
                    f"the period of {file.path} is {samples:.6g} samples; it must be 2 at least: check period and "
                    "rate_hz"
                )

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
        """Samples of the period of a file at the study's rate, whole or not; `find` as stated, None without one."""
        place = self if file.period is None and file.period_samples is None else file
        if place.period_samples is not None:
            return float(place.period_samples)
        if place.period is None or place.period == "none":
            return None
        return "find" if place.period == "find" else float(place.period) * self.known_rate_hz

    def repeat_refusal(self, number: int) -> str:
        """Why a file may not have the numbers of an earlier one; empty where it has further periods, or none has."""
        file = self.files[number]
        earlier = [before for before in self.files[:number] if before.run == file.run]
        periods = {self.period_of(of_run) for of_run in (*earlier[:1], file)}
        is_repeated = any((before.path, before.samples) == (file.path, file.samples) for before in earlier)
        if not earlier or (len(periods) == 1 and None not in periods and not is_repeated):
            return ""
        return (
            f"{earlier[0].path} and {file.path} are both configuration {file.configuration}, realisation "
            f"{file.realisation}, experiment {file.experiment}, but not other samples of one known period; give "
            "each its own numbers (experiment: same phases or another input; realisation: other phases)"
        )

    def _check_files_and_rates(self) -> None:
        last = 1 + min((len(file.also) for file in self.files), default=0)
        for channel in self.channels:
            if channel.file > last:
                raise ValueError(
                    f"a channel is in file {channel.file} of an experiment; one has {last} only (path, also)"
                )
            if channel.role == "u" and channel.file != 1:
                raise ValueError("the acting torques (role u) must be in the first file of an experiment")
        if self.rate_hz == "unknown" and (self.time or any(channel.rate_hz is not None for channel in self.channels)):
            raise ValueError("with rate_hz: unknown time and a channel's own rate_hz have no meaning; leave them out")


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
    frequency: Annotated[str, Key("Frequency of the lines.", "the heading of the first column in most exports, such as "
        "f or Frequency.")] = "freq_hz"
    response: Annotated[str, Key("Complex dataset of an HDF5 file with an axis of frequencies; the two others are "
        "outputs, inputs.", "for HDF5 with one complex array, of any name; its shape decides which axis holds the "
        "lines.")] = "G"
    real: Annotated[str, Key("Real part of G.", "a pattern with {y} and {u} where the file has several elements, such "
        "as Re({y}/{u}).")] = "re_{y}_{u}"
    imaginary: Annotated[str, Key("Imaginary part of G.", "the partner of real, with the same pattern; give both or "
        "neither.")] = "im_{y}_{u}"
    magnitude: Annotated[str, Key("Magnitude |G|, in place of real and imaginary.", "for files in polar form, with "
        "phase; a magnitude alone cannot be fitted.")] = ""
    phase: Annotated[str, Key("Phase of G, together with the magnitude.", "needed with magnitude; unwrapped or wrapped "
        "makes no difference.")] = ""
    std: Annotated[str, Key("Standard deviation of the complex number, sqrt(E|dG|^2), if there is one.", "gives each "
        "line its weight; where the file states that of real and imaginary part, multiply by sqrt(2).")] = ""
    magnitude_unit: Annotated[Literal["1", "dB"], Key("Unit of the magnitude, 1 or dB.", "dB is 20 log10 |G|; negative "
        "magnitudes in the file are a sure sign of it.")] = "1"
    phase_unit: Annotated[Literal["deg", "rad"], Key("Unit of the phase, deg or rad.", "rad where the numbers stay "
        "within 3.2, or unwrapped multiples of it.")] = "deg"
    # fmt: on

    def __post_init__(self) -> None:
        if bool(self.magnitude) != bool(self.phase):
            raise ValueError("give magnitude and phase together; without the phase nothing can be fitted")


@section
class ResponseFileSpec:
    """One file with the frequency response of one configuration."""

    # fmt: off
    path: Annotated[str, Key("Path of the file, relative to the study.", "any of the formats; each configuration may "
        "come from another program.")]
    configuration: Annotated[str, Key("Configuration that the response was measured in.", "a name of "
        "experiment.configurations, whose angles the model takes.")]
    response: Annotated[str, Key("Name of the response in the file: variable of a MATLAB file, configuration of a "
        "frf.h5 of elastid (default: the only one; of frf.h5 the configuration of the same name).", "where a file "
        "holds several; the error lists the names that there are.")] = ""


@section
class ResponsesSpec:
    """Frequency responses that were measured elsewhere: MATLAB structs, HDF5, CSV, UFF 58, or frf.h5 of elastid."""

    # fmt: off
    files: Annotated[tuple[ResponseFileSpec, ...], Key("Files of the responses, one for each configuration.", "several "
        "configurations make springs separable that one alone does not.")]
    channels: Annotated[tuple[ChannelSpec, ...], Key("Inputs (role u) and outputs (role y) of the files; column is "
        "their number in the file, the first is 1, or channel their name. frf.h5 of elastid needs none.", "name all "
        "inputs and outputs of the files in their order; an frf.h5 of elastid names its own.")] = ()
    frequency_unit: Annotated[Literal["auto", "Hz", "rad/s", "kHz", "rpm"], Key("Unit of the frequencies; `auto` takes "
        "that of the file, or Hz for CSV, HDF5 without units and UFF.", "a fit whose stiffnesses are all off by about "
        "39.5 = (2 pi)^2 has the wrong one, and says so.")] = "auto"
    columns: Annotated[ResponseColumnsSpec, Key("Names of the columns in CSV and of the datasets in HDF5 files.",
        "for files whose headings are others than freq_hz, re_1_1, im_1_1.")] = ResponseColumnsSpec()
    text: Annotated[TextFormatSpec, Key("Format of CSV files.", "for a delimiter or decimal sign other than comma and "
        "point.")] = TextFormatSpec()
    relative_std: Annotated[float | None, Key("Standard deviation of G as a part of |G| where a file has none.",
        "0.01 to 0.05; the weights are then a guess, and intervals rest on the scatter of the residuals. Without it "
        "and without a std in the file the status says noise_unknown.", above=0)] = None
    hold: Annotated[Hold, Key("Course of the inputs between their samples; `zero-order` where the responses are from "
        "commands that were held. It is taken out of responses of other programs; a frf.h5 has that of its own study. "
        "Angles (quantity: position) are then taken as sampled at the same rate without a filter, and the model has "
        "the images of the held torque as they have.", "zero-order for responses of commands to encoder angles, as "
        "most controllers' own tools give them.")] = "band-limited"
    rate_hz: Annotated[Frequency | None, Key("Rate of the held commands, needed with hold: zero-order (or in their "
        "channels).", "the controller's, since half a sample of it is the delay that is taken out.", above=0)] = None
    # fmt: on

    def __post_init__(self) -> None:
        if not self.files:
            raise ValueError("files is empty; list at least one file")
        roles = {channel.role for channel in self.channels}
        if self.channels and roles != {"u", "y"}:
            raise ValueError("channels must have roles u (inputs) and y (outputs), at least one of each and no other")
        if any(
            self.hold_of(channel) != "band-limited" and not (channel.rate_hz or self.rate_hz)
            for channel in self.channels
            if channel.role == "u"
        ):
            raise ValueError("hold: zero-order needs the rate of the held commands; give rate_hz")

    def hold_of(self, channel: ChannelSpec) -> Hold:
        """The hold of an input: its own, or else that of the section."""
        return channel.hold or self.hold
