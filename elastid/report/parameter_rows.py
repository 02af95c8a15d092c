"""The table of estimated parameters, a row each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from elastid.fit.result import FitResult


@dataclass(frozen=True)
class ParameterRow:
    """A free parameter in SI: estimate, std, 95 % interval, start, bounds; truth where the rig is simulated.

    deviation: estimate less truth in standard deviations of the solver's variable, so of ln p for a logarithmic one.
    contains: in words, of a viscous coefficient that may contain dry friction.
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

    @property
    def reference(self) -> float:
        """The value it is compared with: the truth, the estimate where none is known, the start where that is zero."""
        candidates = (self.truth, self.estimate, self.start)
        return next((value for value in candidates if value is not None and value != 0), 1.0)


def parameter_rows(
    result: FitResult, truth: Mapping[str, float] | None, contents: Mapping[str, str] | None = None
) -> tuple[ParameterRow, ...]:
    """One row for each free parameter, in the order of x; truth and contents (in words) may name only some of them."""
    known, estimates, stds = truth or {}, result.values, result.std
    std_x = np.sqrt(np.diag(result.covariance))
    rows = []
    for i, parameter in enumerate(result.parameters.free):
        name = parameter.name
        true = known.get(name, known.get(parameter.stands_for))
        deviation = None
        if true is not None and std_x[i] > 0:
            deviation = float((result.x[i] - parameter.to_x(true)) / std_x[i])
        rows.append(
            ParameterRow(
                name=name,
                unit=parameter.unit,
                estimate=estimates[name],
                std=stds[name],
                interval=result.interval(name),
                start=parameter.value,
                bounds=(parameter.lower, parameter.upper),
                at_bound=bool(result.at_bound[i]),
                truth=true,
                deviation=deviation,
                contains=(contents or {}).get(name, ""),
            )
        )
    return tuple(rows)
