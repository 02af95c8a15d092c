"""The `responses` section of an experiment: frequency responses that were measured elsewhere."""

from __future__ import annotations

from typing import Annotated, Literal

from elastid.base.section import Key, section
from elastid.base.units import Frequency
from elastid.experiment.specs.channels import ChannelSpec, check_rate
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.record import Hold


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
    # fmt: on


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
        "and without a std in the file the status says noise_unknown.")] = None
    hold: Annotated[Hold, Key("Course of the inputs between their samples; `zero-order` where the responses are from "
        "commands that were held. It is taken out of responses of other programs; a frf.h5 has that of its own study. "
        "Angles (quantity: position) are then taken as sampled at the same rate without a filter, and the model has "
        "the images of the held torque as they have.", "zero-order for responses of commands to encoder angles, as "
        "most controllers' own tools give them.")] = "band-limited"
    rate_hz: Annotated[Frequency | None, Key("Rate of the held commands, needed with hold: zero-order (or in their "
        "channels).", "the controller's, since half a sample of it is the delay that is taken out.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if not self.files:
            raise ValueError("files is empty; list at least one file")
        check_rate(self.rate_hz)
        roles = {channel.role for channel in self.channels}
        if self.channels and roles != {"u", "y"}:
            raise ValueError("channels must have roles u (inputs) and y (outputs), at least one of each and no other")
        if self.relative_std is not None and not self.relative_std > 0:
            raise ValueError(f"relative_std is {self.relative_std:g}; it must be positive, for example 0.02")
        if any(
            self.hold_of(channel) != "band-limited" and not (channel.rate_hz or self.rate_hz)
            for channel in self.channels
            if channel.role == "u"
        ):
            raise ValueError("hold: zero-order needs the rate of the held commands; give rate_hz")

    def hold_of(self, channel: ChannelSpec) -> Hold:
        """The hold of an input: its own, or else that of the section."""
        return channel.hold or self.hold

    @property
    def is_held(self) -> bool:
        """True if some input is held."""
        return any(hold == "zero-order" for hold in (self.hold, *(channel.hold for channel in self.channels)))
