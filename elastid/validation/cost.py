r"""Why the cost of a fit is what it is: beside what the noise alone would leave, and where the rest of it lies.

.. math:: V - \nu \approx \sum_k (|E_k|^2 / \sigma_k^2 - 1)

over all lines and elements that count, so that the excess can be shared out to configurations, elements and bands.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.result import FitResult
from elastid.fit.spec import FitSpec
from elastid.fit.weights.weights import weigh
from elastid.response import FrequencyResponse
from elastid.validation.agreement import Agreement, are_white

# A cost this far from the expected one, relative, beyond its own scatter needs a reason.
TOLERANCE = 0.1
# A configuration or element is named that holds this part of the excess and twice its part of the lines.
NAMED = 0.25
# A band is named that holds half of the excess in at most this part of the lines.
NARROW = 0.2
# One line in a hundred that carries this part of the cost is an outlier.
FEW, OUTLYING = 0.01, 0.3


@dataclass(frozen=True)
class Excess:
    """|E|^2 / sigma^2 (n,) of every line and element that counts, and where each lies."""

    power: FloatArray
    configuration: tuple[str, ...]
    element: tuple[str, ...]
    freq_hz: FloatArray

    @classmethod
    def of(cls, measured: Sequence[FrequencyResponse], modelled: Sequence[FrequencyResponse], spec: FitSpec) -> Excess:
        """Of fitted responses under the weights of the fit."""
        power: list[float] = []
        configuration: list[str] = []
        element: list[str] = []
        freq_hz: list[float] = []
        for Ghat, G in zip(measured, modelled, strict=True):
            weights = weigh(Ghat, spec)
            counted = np.argwhere(weights.used)
            power += (np.abs(Ghat.G - G.G)[weights.used] / weights.sigma[weights.used]).tolist()
            configuration += [Ghat.configuration.name] * len(counted)
            element += [f"{Ghat.inputs[j]} to {Ghat.outputs[i]}" for _, i, j in counted]
            freq_hz += Ghat.freq_hz[counted[:, 0]].tolist()
        return cls(np.square(power), tuple(configuration), tuple(element), np.array(freq_hz))

    def largest(self, where: Sequence[str]) -> tuple[str, float] | None:
        """The configuration or element with the most of the excess and its part of it, if that stands out."""
        above = np.maximum(self.power - 1, 0.0)
        names = list(dict.fromkeys(where))
        places = np.array([names.index(name) for name in where])
        share = np.bincount(places, above, len(names)) / max(float(above.sum()), 1e-300)
        lines = np.bincount(places, minlength=len(names)) / len(places)
        most = int(np.argmax(share))
        return (names[most], float(share[most])) if share[most] > max(NAMED, 2 * lines[most]) else None

    def band_hz(self) -> tuple[float, float] | None:
        """The band with half of the excess and the fewest of the lines, if these are few."""
        order = np.argsort(self.freq_hz, kind="stable")
        f, above = self.freq_hz[order], np.maximum(self.power - 1, 0.0)[order]
        total = np.concatenate([[0.0], np.cumsum(above)])
        last = np.searchsorted(total, total[:-1] + total[-1] / 2)
        count = np.where(last < len(total), last - np.arange(len(f)), len(f))
        start = int(np.argmin(count))
        if count[start] > NARROW * len(f):
            return None
        return float(f[start]), float(f[last[start] - 1])

    @property
    def outlying(self) -> float:
        """What part of the cost the largest one in a hundred carries."""
        n = max(1, int(FEW * len(self.power)))
        return float(np.sort(self.power)[-n:].sum() / max(float(self.power.sum()), 1e-300))


def cost_words(
    result: FitResult,
    measured: Sequence[FrequencyResponse],
    modelled: Sequence[FrequencyResponse],
    agreements: Sequence[Agreement],
    spec: FitSpec,
) -> str:
    """The reason in words; all of the fitted configurations, agreements and masks of others being left aside."""
    names = [response.configuration.name for response in measured]
    ratio = result.cost / max(result.cost_expected, 1e-300)
    beside = f"The cost is {result.cost:.4g}, and {result.cost_expected:.4g} is what the noise alone would leave"
    if all(response.uncertainty is None for response in measured):
        return (
            f"The cost is {result.cost:.4g} for {result.dof} degrees of freedom, in units of fit.weights.floor: the "
            "responses came without an uncertainty, so that there is no noise to compare it with."
        )
    margin = TOLERANCE + 3 * math.sqrt(2 / max(result.dof, 1))
    if abs(ratio - 1) <= margin:
        fitted = [a for a in agreements if a.configuration in names]
        coloured = [] if are_white(fitted) else [a.configuration for a in fitted if not a.is_white]
        though = f", though the residuals of {', '.join(coloured)} hang together along frequency" if coloured else ""
        return f"{beside}: these data show nothing that the model lacks{though}."
    if ratio < 1:
        return (
            f"{beside}: the residuals are smaller than their uncertainty. It is overestimated, as where realisations "
            "or periods differ by more than the mean of them errs, or where fit.weights.floor is above the model's "
            "error; the intervals are then too wide rather than too narrow."
        )
    excess = Excess.of(measured, modelled, spec)
    return (
        f"{beside}: the residuals are {math.sqrt(ratio):.3g} times the noise, rms. "
        + _kind(excess, [a for a in agreements if a.configuration in names])
        + _places(excess, measured[0])
    )


def _kind(excess: Excess, agreements: Sequence[Agreement]) -> str:
    """What kind of residuals these are, and so what is the matter."""
    if not are_white(agreements):
        return (
            "They hang together along frequency, so the model lacks something that these data show, such as a mode, or "
            "a number that was taken as known"
        )
    if excess.outlying > OUTLYING:
        return (
            f"One line in a hundred carries {100 * excess.outlying:.0f} % of the cost: single lines are far off, as by "
            "interference or a grid of another rate; leave them out with fit.mask, or give the fit a robust loss"
        )
    return (
        "They are white along frequency, so it is rather the noise that is larger than its estimate, as where "
        "friction differs from run to run: more realisations would tell"
    )


def _places(excess: Excess, first: FrequencyResponse) -> str:
    """Where most of the excess lies."""
    found = list(_found(excess, first))
    return f"; of the excess, {', '.join(found)}." if found else "; it is spread over all configurations and elements."


def _found(excess: Excess, first: FrequencyResponse) -> Iterator[str]:
    for where, word in ((excess.configuration, "in configuration "), (excess.element, "in ")):
        largest = excess.largest(where) if len(set(where)) > 1 else None
        if largest is not None:
            yield f"{100 * largest[1]:.0f} % lies {word}{largest[0]}"
    band = excess.band_hz()
    if band is not None:
        unit = "Hz" if first.rate_is_known else "of the sampling rate"
        yield f"half lies between {band[0]:.4g} and {band[1]:.4g} {unit}"
