"""The `estimator` section of a study."""

from __future__ import annotations

from typing import Literal

from elastid.record import Motion
from elastid.section import section
from elastid.units import Frequency


@section
class EstimatorSpec:
    """How records become frequency responses.

    method: `arithmetic`, `harmonic` or `logarithmic` mean of the realisations' responses; or of all experiments
    together `h1`, `h2`, `hv`, `joint` (input-output, by the injected torque) or `errors_in_variables`; `auto` takes
    what closed-loop robot data want and says why.  quantity: what the outputs are turned into, exactly, in
    the frequency domain.  lines: which DFT lines are analysed, within band_hz: those planned (`auto`; for recorded
    data those found `excited` in the inputs), or `full` or `odd`.  transient_periods: left out at the start of a
    record, or `auto`: those that differ from the rest.  outlier_sigma: a period further from the median than so many
    robust standard deviations is left out with a word.
    """

    method: Literal[
        "auto", "arithmetic", "harmonic", "logarithmic", "h1", "h2", "hv", "joint", "errors_in_variables"
    ] = "arithmetic"
    quantity: Motion = "acceleration"
    lines: Literal["auto", "excited", "full", "odd"] = "auto"
    band_hz: tuple[Frequency, Frequency] | None = None
    transient_periods: int | Literal["auto"] = "auto"
    outlier_sigma: float = 6.0

    def __post_init__(self) -> None:
        """Check band, counts and threshold."""
        if self.band_hz is not None and not 0 <= self.band_hz[0] < self.band_hz[1]:
            raise ValueError(f"band_hz is [{self.band_hz[0]:g}, {self.band_hz[1]:g}]; give [lowest, highest]")
        if self.transient_periods != "auto" and self.transient_periods < 0:
            raise ValueError(f"transient_periods is {self.transient_periods}; it must not be negative")
        if not self.outlier_sigma > 0:
            raise ValueError(f"outlier_sigma is {self.outlier_sigma:g}; it must be positive")
