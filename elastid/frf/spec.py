"""The `estimator` section of a study."""

import math
from typing import Annotated, Literal, TypeAlias

from elastid.base.section import Key, section
from elastid.base.units import Frequency, Time
from elastid.record import Motion

Method: TypeAlias = Literal[
    "auto",
    "arithmetic",
    "h1",
    "joint",
    "errors_in_variables",
    "local_polynomial",
    "local_rational",
]

Window: TypeAlias = Literal["hann", "hamming", "blackman", "blackmanharris", "flattop", "boxcar"]

Friction: TypeAlias = Literal["none", "coulomb", "curve", "auto"]

_BY_NEIGHBOURS = ("auto", "local_polynomial", "local_rational")


@section
class EstimatorSpec:
    """Estimation of frequency responses from records.

    Records without a period take `h1` by Welch's method, a local method, or `auto`, which compares both; their
    lines are `full`.
    """

    # fmt: off
    method: Annotated[Method, Key("Method of estimation: `arithmetic` mean of the "
        "realisations' responses, each from as many experiments as inputs; or of all experiments together `h1`, "
        "`joint` (input-output, by the injected torque) or `errors_in_variables`; or `local_polynomial` or "
        "`local_rational` (where windows are wider than resonances), from one experiment of all inputs or more, "
        "started from rest or not; `auto` takes the `arithmetic` mean where periods and experiments allow, else the "
        "candidate with the smallest stated error, and reports the errors.", "`arithmetic` has the least bias in "
        "closed loop where realisations can be averaged; a `local` method for one experiment of all inputs, "
        "`errors_in_variables` where input noise is as large as output noise, h1 only where the input is known "
        "exactly.")] = "auto"
    quantity: Annotated[Motion, Key("Quantity of the responses, into which the outputs are turned exactly, in the "
        "frequency domain.", "`position` or `velocity` for tools that read it; the fit is the same, since the factor "
        "(j omega)^n cancels in the weights.")] = "acceleration"
    lines: Annotated[Literal["auto", "excited", "full", "odd"], Key("DFT lines that are analysed: those planned "
        "(`auto`; for recorded data those found `excited` in the inputs), or `full` or `odd`.", "`full` shows what "
        "lies on lines that were not excited; `odd` where the grid of logs is known and the finder takes noise for "
        "lines.")] = "auto"
    band_hz: Annotated[tuple[Frequency, Frequency] | None, Key("Band within which lines are analysed (default: all).",
        "narrower where what lies beyond only takes time and memory; the fit has a band of its own, which needs no new "
        "estimate.", least=0, rising=True)] = None
    transient_periods: Annotated[int | Literal["auto"], Key("Periods left out at the start of a record, or `auto`: "
        "those that differ from the rest; a number where more must go. None with a local method.", "a number where "
        "more must go than `auto` finds, as with slow thermal drift; 0 keeps all periods of a log that begins in "
        "steady state. No effect with a local method, which estimates the transient.", least=0)] = "auto"
    outlier_sigma: Annotated[float, Key("Threshold of outliers: a period further from the median than so many robust "
        "standard deviations is left out with a note, but for local methods.", "lower, about 4, where blows or "
        "dropouts spoil periods; higher keeps all. At 6 a good period is practically never left out; "
        "transient_periods: auto judges by it too.", above=0)] = 6.0
    friction: Annotated[Friction, Key("Friction of the motors that is taken out of the torque before the responses are "
        "estimated, as the records themselves show it: Coulomb's level alone (`coulomb`), with bristles that bend "
        "before they slide (`curve`), or this only where it makes realisations agree better (`auto`).", "`none` for "
        "the response as it is, friction included, such as for a controller's design; `curve` where encoders resolve "
        "the bristles; `auto` takes nothing out unless realisations agree better.")] = "auto"
    local_order: Annotated[int | Literal["auto"], Key("Degree of the local polynomials; `auto` is 2, rational up to 3.",
        "higher where a window is wider than a resonance; each degree costs n_u lines of window, which widens it "
        "again.", least=1, most=6)] = "auto"
    window: Annotated[Window, Key("Window of each segment in Welch's method.", "`boxcar` where signals die out within "
        "a segment, as after a hammer; `flattop` only for the height of single lines, `hann` loses least for "
        "noise.")] = "hann"
    segment: Annotated[Time | Literal["auto"], Key("Length of a segment in Welch's method, whose lines are 1/segment "
        "apart; the next begins in its middle. `auto`: the longest power of two in samples that leaves 16 segments, "
        "and 8 for each input, and holds a million numbers at most in all channels together, for memory.", "longer for "
        "sharp resonances (1/segment below a quarter of their width), shorter for lower variance; the product of both "
        "is bound by the length of the record.", above=0)] = "auto"
    resolution_hz: Annotated[Frequency | None, Key("Distance of the lines of a local method, whose windows are as wide "
        "at least, for records without a period; default: each line of their DFT.", "larger for a faster fit with "
        "fewer lines; it must stay below a quarter of the narrowest resonance.", above=0)] = None
    # fmt: on

    def experiments_needed(self, n_u: int, realisations: int) -> int:
        """Experiments of each realisation that are needed to separate n_u inputs."""
        if self.method in _BY_NEIGHBOURS:
            return 1
        return n_u if self.method == "arithmetic" else math.ceil(n_u / realisations)
