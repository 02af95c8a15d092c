"""The `estimator` section of a study."""

from __future__ import annotations

from typing import Literal

from elastid.record import Motion
from elastid.section import section
from elastid.units import Frequency


@section
class EstimatorSpec:
    """How records become frequency responses.

    method: arithmetic mean of the realisations' responses.  quantity: what the outputs are turned into, exactly, in
    the frequency domain.  lines: which DFT lines are analysed: those planned (`auto`, or for
    recorded data those found `excited` in the inputs), or `full` or `odd` within band_hz.  transient_periods: left out at the start of a record, or `auto`: those
    that differ from the rest.  outlier_sigma: a period further from the median than so many robust standard deviations
    is left out with a word.
    """

    method: Literal["arithmetic"] = "arithmetic"
    quantity: Motion = "acceleration"
    lines: Literal["auto", "excited", "full", "odd"] = "auto"
    band_hz: tuple[Frequency, Frequency] | None = None
    transient_periods: int | Literal["auto"] = "auto"
    outlier_sigma: float = 6.0
