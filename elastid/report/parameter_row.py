"""Row of the table of parameters: estimate, interval, true value and verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from elastid.fit.result import Result
from elastid.fit.status_terms import BIASED, UNCERTAIN

# Limits of classes of the half-width of a 95 % interval over the estimate.
WIDTH_CLASSES = (0.02, 0.1, 0.5)
WIDTH_WORDS = ("±2 % or less", "±2 to 10 %", "±10 to 50 %", "wider")

# Content of a viscous coefficient: the best linear approximation of sgn(v) is 2 p_v(0) v, p_v the density of v.
WITH_COULOMB = "viscous friction. Coulomb friction of the motor, if any, was not compensated and increases the estimate"


@dataclass(frozen=True)
class ParameterRow:
    """Free parameter in SI: estimate, std, 95 % interval, start, bounds, and true value of a simulated rig.

    deviation: (estimate - truth) / std of the solver's variable, which may be logarithmic.  contains: text on the
    friction in a viscous coefficient.  std_contributions: empty for an exact robot model.  verdict: of the fit.  base:
    effect of a typical base.
    """

    name: str
    unit: str
    estimate: float
    std: float
    interval: tuple[float, float]
    start: float
    bounds: tuple[float, float]
    at_bound: bool
    truth: float | None = None
    deviation: float | None = None
    contains: str = ""
    std_contributions: Mapping[str, float] = field(default_factory=dict)
    verdict: str = ""
    base: str = ""

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval over the estimate; infinite for an unidentifiable parameter."""
        low, high = self.interval
        return (high - low) / 2 / abs(self.estimate) if self.estimate and math.isfinite(high - low) else math.inf

    @property
    def width_class(self) -> int:
        """Index of the half-width in WIDTH_WORDS."""
        return int(np.searchsorted(WIDTH_CLASSES, self.half_width))

    @property
    def is_poor(self) -> bool:
        """True for a biased or weakly identifiable estimate."""
        return self.verdict.startswith((BIASED, UNCERTAIN))

    @property
    def has_coulomb(self) -> bool:
        """True for viscous friction that may include Coulomb friction."""
        return self.contains.startswith(WITH_COULOMB)

    @property
    def reference(self) -> float:
        """Reference value: the first nonzero of true value, estimate and start."""
        candidates = (self.truth, self.estimate, self.start)
        return next((value for value in candidates if value is not None and value != 0), 1.0)


def parameter_rows(
    result: Result, truth: Mapping[str, float] | None, contents: Mapping[str, str] | None = None
) -> tuple[ParameterRow, ...]:
    """Return a row per parameter of interest, in the order of x; `truth` and `contents` may be incomplete."""
    truths, estimates, stds = truth or {}, result.values, result.std
    std_x, bases = result.std_of_x, result.base_remarks
    rows = []
    verdicts = result.verdicts or ("",) * len(result.parameters.of_interest)
    for i, parameter in enumerate(result.parameters.of_interest):
        name = parameter.name
        true = truths.get(name, truths.get(parameter.stands_for))
        deviation = None
        if true is not None and std_x[i] > 0:
            deviation = float((result.x[i] - parameter.to_x(true)) / std_x[i])
        numbers = name, parameter.unit, estimates[name], stds[name], result.interval(name)
        start, at_bound = (parameter.value, (parameter.lower, parameter.upper)), bool(result.at_bound[i])
        content = (contents or {}).get(name, "")
        contributions = {kind: stds_by_name[name] for kind, stds_by_name in result.std_contributions.items()}
        base = "" if truths else bases.get(name, "")  # the base of a simulated robot is rigid
        rows.append(
            ParameterRow(*numbers, *start, at_bound, true, deviation, content, contributions, verdicts[i], base)
        )
    return tuple(rows)
