r"""The cost of a fit explained: its excess over the cost that noise alone would leave, and the location of that excess.

.. math:: V - \nu \approx \sum_k (|E_k|^2 / \sigma_k^2 - 1)

over all lines and elements that count: the excess of a configuration, element or band is its part of the sum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.fit.problem.weights import weigh
from elastid.fit.result import FitResult
from elastid.fit.spec import FitSpec
from elastid.response import FrequencyResponse
from elastid.validation.residual_tests import FALSE_ALARM, exceeds_by_chance, falls_short_by_chance
from elastid.validation.results import Agreement, are_white, noise_p, power_ratio


@dataclass(frozen=True)
class ExcessLimits:
    """Limits of the judgement where the excess of a cost lies, found by a test whose rate is FALSE_ALARM.

    False alarms of 300 clean logs: excess-of-cost 2.
    """

    min_share: float = 0.25  # of the excess, from which a configuration or element is named; also twice its lines
    max_band_lines: float = 0.2  # share of the lines up to which a band with half of the excess is named
    outliers: float = 0.01  # share of the residuals that may be outliers
    min_outlier_cost: float = 0.3  # share of the cost in these from which they are


LIMITS = ExcessLimits()


@frozen_value
class Excess:
    """power (n,): |E|^2 / sigma^2 of every line and element that counts, each with its place."""

    power: FloatArray
    configuration: tuple[str, ...]
    element: tuple[str, ...]
    freq_hz: FloatArray

    @classmethod
    def of(cls, measured: Sequence[FrequencyResponse], modelled: Sequence[FrequencyResponse], spec: FitSpec) -> Excess:
        """Of fitted responses under the weights of the fit."""
        power, freq_hz = list[float](), list[float]()
        configuration, element = list[str](), list[str]()
        for Ghat, G in zip(measured, modelled, strict=True):
            weights = weigh(Ghat, spec)
            counted = np.argwhere(weights.used)
            power += (np.abs(Ghat.G - G.G)[weights.used] / weights.sigma[weights.used]).tolist()
            configuration += [Ghat.configuration.name] * len(counted)
            element += [f"{Ghat.inputs[j]} to {Ghat.outputs[i]}" for _, i, j in counted]
            freq_hz += Ghat.freq_hz[counted[:, 0]].tolist()
        return cls(np.square(power), tuple(configuration), tuple(element), np.array(freq_hz))

    def largest(self, where: Sequence[str]) -> tuple[str, float] | None:
        """The configuration or element with the largest share of the excess, and that share; None if none is large."""
        above = np.maximum(self.power - 1, 0.0)
        names = list(dict.fromkeys(where))
        places = np.array([names.index(name) for name in where])
        share = np.bincount(places, above, len(names)) / max(float(above.sum()), 1e-300)
        lines = np.bincount(places, minlength=len(names)) / len(places)
        most = int(np.argmax(share))
        return (names[most], float(share[most])) if share[most] > max(LIMITS.min_share, 2 * lines[most]) else None

    def band_hz(self) -> tuple[float, float] | None:
        """The band with half of the excess and the fewest lines, where these are few enough."""
        order = np.argsort(self.freq_hz, kind="stable")
        f, above = self.freq_hz[order], np.maximum(self.power - 1, 0.0)[order]
        total = np.concatenate([[0.0], np.cumsum(above)])
        last = np.searchsorted(total, total[:-1] + total[-1] / 2)
        count = np.where(last < len(total), last - np.arange(len(f)), len(f))
        start = int(np.argmin(count))
        if count[start] > LIMITS.max_band_lines * len(f):
            return None
        return float(f[start]), float(f[last[start] - 1])

    @property
    def outlying(self) -> float:
        """The share of the cost that the largest one in a hundred carries."""
        n = max(1, int(LIMITS.outliers * len(self.power)))
        return float(np.sort(self.power)[-n:].sum() / max(float(self.power.sum()), 1e-300))


def explain_cost(
    result: FitResult,
    measured: Sequence[FrequencyResponse],
    modelled: Sequence[FrequencyResponse],
    agreements: Sequence[Agreement],
    spec: FitSpec,
) -> str:
    """The explanation in words. measured, modelled: of the fitted configurations; agreements of others are ignored."""
    names = [response.configuration.name for response in measured]
    ratio = result.cost / max(result.cost_expected, 1e-300)
    opening = f"The residuals of the fit are {result.residual_ratio:.3g} times the noise, rms"
    if all(response.uncertainty is None for response in measured):
        return "The responses came without an uncertainty: nothing says how large the residuals of the fit may be."
    fitted = [a for a in agreements if a.configuration in names]
    more = noise_p(fitted, cost_p(result)) < FALSE_ALARM
    less = falls_short_by_chance(ratio, result.cost_dof) < FALSE_ALARM
    rate = f"of a true model this test says otherwise in {100 * FALSE_ALARM:g} % of measurements"
    if not more and not less:
        coloured = [] if are_white(fitted) else [a.configuration for a in fitted if not a.is_white]
        though = f", though residuals of neighbouring lines are correlated in {', '.join(coloured)}" if coloured else ""
        return f"{opening}, and show no error of the model ({rate}){though}."
    if not more:
        return (
            f"{opening}, smaller than their uncertainty, which is overestimated, for instance by "
            "realisations or periods that differ by more than their mean is wrong, or by fit.weights.floor above the "
            "error of the model; the intervals are then too wide rather than too narrow."
        )
    excess = Excess.of(measured, modelled, spec)
    times = math.sqrt(max(ratio, power_ratio(fitted)[0]))
    if not cost_p(result) < FALSE_ALARM and result.floor > 0:
        opening = (
            f"{opening}, with a floor of {100 * result.floor:.3g} % of each element in addition to it, and show "
            f"no more. Without the floor, which the intervals hold, they are {times:.3g} times the noise"
        )
    elif times > 1.01 * result.residual_ratio:
        opening = f"{opening}, and {times:.3g} times without the weights of the fit"
    return f"{opening} ({rate}). " + _kind(excess, fitted) + _places(excess, measured[0])


def cost_p(result: FitResult) -> float:
    """P(as large a cost) by noise alone; NaN where no noise is known."""
    return exceeds_by_chance(result.cost / max(result.cost_expected, 1e-300), result.cost_dof)


def _kind(excess: Excess, agreements: Sequence[Agreement]) -> str:
    """The kind of the residuals and its likely cause."""
    if not are_white(agreements):
        return (
            "Residuals of neighbouring lines are correlated: the model lacks something that the data show, such as a "
            "mode, or a number that was taken as known is wrong"
        )
    if excess.outlying > LIMITS.min_outlier_cost:
        return (
            f"One line in a hundred carries {100 * excess.outlying:.0f} % of the cost: single lines are far off, for "
            "instance by interference or a grid of another rate; leave them out with fit.weights.factors, or choose a "
            "robust loss"
        )
    return (
        "Residuals of neighbouring lines are uncorrelated: the noise is probably larger than its estimate, for "
        "instance where friction differs from run to run; measure more realisations"
    )


def _places(excess: Excess, first: FrequencyResponse) -> str:
    """The location of most of the excess, as the end of a sentence."""
    places = []
    for where, word in ((excess.configuration, "in configuration "), (excess.element, "in ")):
        largest = excess.largest(where) if len(set(where)) > 1 else None
        if largest is not None:
            places.append(f"{100 * largest[1]:.0f} % lies {word}{largest[0]}")
    if (band := excess.band_hz()) is not None:
        unit = "Hz" if first.rate_is_known else "of the sampling rate"
        places.append(f"half lies between {band[0]:.4g} and {band[1]:.4g} {unit}")
    if not places:
        return "; the excess is spread over all configurations and elements."
    return f"; of the excess, {', '.join(places)}."
