"""The `responses` section of an experiment: frequency responses that were measured elsewhere."""

from __future__ import annotations

from typing import Literal

from elastid.base.section import section
from elastid.base.units import Frequency
from elastid.experiment.specs.channels import ChannelSpec, check_rate
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.record import Hold


@section
class ResponseColumnsSpec:
    """Where a CSV or HDF5 file keeps a frequency response: names of columns or datasets.

    In a CSV file {y} and {u} stand for the names (`channel`) or the numbers (`column`) of output and input. Either real
    and imaginary, or magnitude and phase.

    frequency: of the lines. -- the heading of the first column in most exports, such as f or Frequency.
    response: HDF5, a complex dataset with an axis of frequencies; the two others are outputs, inputs. -- for HDF5 with
    one complex array, of any name; its shape decides which axis holds the lines.
    real: part of G. -- a pattern with {y} and {u} where the file has several elements, such as Re({y}/{u}).
    imaginary: part of G. -- the partner of real, with the same pattern; give both or neither.
    magnitude: |G|, in place of real and imaginary. -- for files in polar form, with phase; a magnitude alone cannot be
    fitted.
    phase: of G, beside the magnitude. -- needed with magnitude; unwrapped or wrapped makes no difference.
    std: standard deviation of the complex number, sqrt(E|dG|^2), if there is one. -- gives each line its weight; where
    the file states that of real and imaginary part, multiply by sqrt(2).
    magnitude_unit: 1 or dB. -- dB is 20 log10 |G|; negative magnitudes in the file are a sure sign of it.
    phase_unit: deg or rad. -- rad where the numbers stay within 3.2, or unwrapped multiples of it.
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

    path: relative to the study. -- any of the formats; each configuration may come from another program.
    configuration: that it was measured in. -- a name of experiment.configurations, whose angles the model takes.
    response: which response of the file: variable of a MATLAB file, configuration of a frf.h5 of elastid (default: the
    only one; of frf.h5 the configuration of the same name). -- where a file holds several; the error lists the names
    that there are.
    """

    path: str
    configuration: str
    response: str = ""


@section
class ResponsesSpec:
    """Frequency responses that were measured elsewhere: MATLAB structs, HDF5, CSV, UFF 58, or frf.h5 of elastid.

    files: one for each configuration. -- several configurations make springs separable that one alone does not.
    channels: inputs (role u) and outputs (role y) of the files; column is their number in the file, the first is 1, or
    channel their name. frf.h5 of elastid needs none. -- name all inputs and outputs of the files in their order; an
    frf.h5 of elastid names its own.
    frequency_unit: `auto` takes that of the file, or Hz for CSV, HDF5 without units and UFF. -- a fit whose stiffnesses
    are all off by about 39.5 = (2 pi)^2 has the wrong one, and says so.
    columns: names in CSV and HDF5 files. -- for files whose headings are others than freq_hz, re_1_1, im_1_1.
    text: format of CSV files. -- for a delimiter or decimal sign other than comma and point.
    relative_std: standard deviation of G as a part of |G| where a file has none. -- 0.01 to 0.05; the weights are then
    a guess, and intervals rest on the scatter of the residuals. Without it and without a std in the file the status
    says noise_unknown.
    hold: of the inputs between their samples; `zero-order` where the responses are from commands that were held. It is
    taken out of responses of other programs; a frf.h5 has that of its own study. Angles (quantity: position) are then
    taken as sampled at the same rate without a filter, and the model has the images of the held torque as they have. --
    zero-order for responses of commands to encoder angles, as most controllers' own tools give them.
    rate_hz: of the commands, needed then (or in their channels). -- the controller's, since half a sample of it is the
    delay that is taken out.
    """

    files: tuple[ResponseFileSpec, ...]
    channels: tuple[ChannelSpec, ...] = ()
    frequency_unit: Literal["auto", "Hz", "rad/s", "kHz", "rpm"] = "auto"
    columns: ResponseColumnsSpec = ResponseColumnsSpec()
    text: TextFormatSpec = TextFormatSpec()
    relative_std: float | None = None
    hold: Hold = "band-limited"
    rate_hz: Frequency | None = None

    def __post_init__(self) -> None:
        """At least one file; inputs and outputs, or no channels at all."""
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
        """Whether some input is held."""
        return any(hold == "zero-order" for hold in (self.hold, *(channel.hold for channel in self.channels)))
