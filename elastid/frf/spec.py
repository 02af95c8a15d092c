"""The `estimator` section of a study."""

import math
from typing import Annotated, Literal, TypeAlias

from elastid.base.section import Key, section
from elastid.base.units import Frequency, Time
from elastid.record import Motion

Method: TypeAlias = Literal[
    "auto", "arithmetic", "h1", "joint", "errors_in_variables", "local_polynomial", "local_rational"
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
    method: Annotated[Method, Key("Estimator. `arithmetic`: mean over realisations. `h1`, `joint` (joint input-output) "
        "and `errors_in_variables`: all experiments together. `local_polynomial` and `local_rational`: wide windows, "
        "for one or more experiments. `auto`: joint with logged references, else arithmetic if possible, else the "
        "smallest stated error.", "`arithmetic` has the smallest bias in closed loop. Use a `local` method for one "
        "experiment, `errors_in_variables` for large input noise, `h1` only for exact inputs.")] = "auto"
    quantity: Annotated[Motion, Key("Output quantity of the responses, converted exactly in the frequency domain.",
        "`position` or `velocity` for other tools; the fit does not depend on it.")] = "acceleration"
    lines: Annotated[Literal["auto", "excited", "full", "odd"], Key("Analysed DFT lines: `auto` (planned lines), "
        "`excited` (detected in the inputs, default of recorded data), `full` or `odd`.", "`full` also shows lines "
        "without excitation; `odd` if noise is mistaken for excited lines.")] = "auto"
    band_hz: Annotated[tuple[Frequency, Frequency] | None, Key("Frequency band of the analysed lines (default: all).",
        "narrower to save time and memory; the fit has a band of its own.", least=0, rising=True)] = None
    transient_periods: Annotated[int | Literal["auto"], Key("Number of discarded periods at the start of a record; "
        "`auto` detects the transient; unused by local methods.", "a number for slow transients such as thermal drift; "
        "0 for logs that start in steady state.", least=0)] = "auto"
    outlier_sigma: Annotated[float, Key("Outlier limit in robust standard deviations from the median of the periods; "
        "such periods are discarded with a note (not by local methods).", "4 if shocks or dropouts disturb periods; at "
        "6, false alarms practically do not occur.", above=0)] = 6.0
    friction: Annotated[Friction, Key("Compensation of motor friction before the estimation: `coulomb` (Coulomb "
        "torque), `curve` (with presliding), `auto` (only if it makes realisations more consistent) or `none`.",
        "`none` for responses that include friction, such as for control design; `curve` if the encoders resolve "
        "presliding.")] = "auto"
    local_order: Annotated[int | Literal["auto"], Key("Degree of the local polynomials; `auto`: 2, rational up to 3.",
        "higher if a window is wider than a resonance; each degree widens the window by n_u "
        "lines.", least=1, most=6)] = "auto"
    window: Annotated[Window, Key("Window of each segment in Welch's method.", "`boxcar` for signals that decay within "
        "a segment, such as hammer impacts; `flattop` only for the amplitude of single lines.")] = "hann"
    segment: Annotated[Time | Literal["auto"], Key("Length of a segment in Welch's method with 50 % overlap; `auto`: "
        "longest power of two with 16 segments, and 8 per input, limited by memory.", "longer for sharp resonances "
        "(1/segment below a quarter of their width), shorter for lower variance.", above=0)] = "auto"
    resolution_hz: Annotated[Frequency | None, Key("Distance of the lines of a local method for aperiodic records, and "
        "minimum width of its windows (default: each DFT line).", "larger for a faster fit; keep it below a quarter of "
        "the narrowest resonance.", above=0)] = None
    # fmt: on

    def experiments_needed(self, n_u: int, realisations: int) -> int:
        """Return experiments of each realisation that are needed to separate n_u inputs."""
        if self.method in _BY_NEIGHBOURS:
            return 1
        return n_u if self.method == "arithmetic" else math.ceil(n_u / realisations)
