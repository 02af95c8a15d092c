r"""Goals of an identification: how wide the 95 % intervals of parameters may be, relative to their values.

.. math:: r_p = \frac{1.96\, \sigma_p}{w_p |p|} \le 1

w_p: the half width that is asked for, sigma_p the standard deviation (of ln p times p for a logarithmic parameter).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.names import matching
from elastid.base.statistics import QUANTILE_95
from elastid.fit.result import FitResult
from elastid.parameters import ParameterSet

EXAMPLE = '"k_*: 1 %"'


@dataclass(frozen=True)
class Goal:
    """widths: name of a parameter to the half width of its 95 % interval, relative to its value."""

    widths: Mapping[str, float]

    def used(self, parameters: ParameterSet, x: FloatArray, covariance: FloatArray) -> FloatArray:
        """r (n_goals,) at x (n_x,) with a covariance (n_x, n_x) of x; at most 1 where the goal is reached."""
        names, values = parameters.free_names, parameters.as_dict(x)
        places = [names.index(name) for name in self.widths]
        std = np.sqrt(np.maximum(np.diag(covariance)[places], 0.0))
        size = [1.0 if parameters[name].log else max(abs(values[name]), 1e-300) for name in self.widths]
        return np.asarray(QUANTILE_95 * std / size / np.array([*self.widths.values()]))

    def reached(self, result: FitResult) -> dict[str, float]:
        """Half width of each interval of a fit, relative to the value, over what the goal asks for."""
        used = {}
        for name, width in self.widths.items():
            low, high = result.interval(name)
            share = (high - low) / 2 / max(abs(result.values[name]), 1e-300) / width
            used[name] = share if np.isfinite(share) else np.inf  # of what the data do not reach
        return used


def read_goal(texts: Sequence[str], names: Sequence[str]) -> Goal:
    """The goal of texts such as `k_*: 1 %` or `k_1: 0.5 %, d_*: 5 %`; the narrower of two that name one parameter.

    names: of the parameters that the fit identifies.  StudyError for a text without a width, or of no parameter.
    """
    widths: dict[str, float] = {}
    for text in (part.strip() for whole in texts for part in whole.split(",")):
        pattern, colon, width = (part.strip() for part in text.partition(":"))
        matches = matching(pattern, names)
        if not colon or not pattern:
            raise StudyError(f"--goal '{text}': give parameters and the half width of their intervals, as {EXAMPLE}")
        if not matches:
            raise StudyError(f"--goal '{text}': the fit does not identify '{pattern}'; {did_you_mean(pattern, names)}")
        for name in matches:
            widths[name] = min(_share(width, text), widths.get(name, np.inf))
    return Goal({name: widths[name] for name in names if name in widths})


def _share(width: str, text: str) -> float:
    number, is_percent = width.removesuffix("%").strip(), width.endswith("%")
    try:
        share = float(number) / 100
    except ValueError:
        share = np.nan
    if not is_percent or not 0 < share < 1:
        raise StudyError(
            f"--goal '{text}': '{width}' is no width; give percent of the value, above 0 % and below 100 %, "
            f"as {EXAMPLE}"
        )
    return share
