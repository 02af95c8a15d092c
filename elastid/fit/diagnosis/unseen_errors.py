r"""Errors of held numbers that no test of the responses finds, since the free parameters take them up.

A gear ratio that is wrong by a little changes the response as stiffness and damping do.  Of a number h that the fit
held, with S and the effects of the score test (`modification.score_test`) and the standard deviations of x,

.. math:: e_1 = \min_i \frac{\sigma_i}{|\partial x_i / \partial h|}, \qquad e_\text{unseen} = \sqrt{D / S}

are the error that moves a parameter by its standard deviation, and the largest one whose freeing would lower V by no
more than what shows a model to be wrong (D, `misfit.MIN_DROP`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.fit.diagnosis.misfit import MIN_DROP, MIN_EFFECT
from elastid.fit.diagnosis.modification.held_numbers import RATE
from elastid.fit.diagnosis.modification.scores import Scores
from elastid.fit.result import FitResult

# The sentence names so many numbers, each of another kind.
MAX_NAMED = 3
# Results whose intervals are stated as they stand.
FINE = ("converged", "at_bound")


@dataclass(frozen=True)
class UnseenError:
    """name, group: of a held number.  per_std: its error that moves parameter (its place in x) by one deviation.

    error: the largest common one that nothing finds; both of ln p where log, else SI in unit.
    """

    name: str
    group: str
    unit: str
    log: bool
    parameter: int
    per_std: float
    error: float

    @property
    def moved(self) -> float:
        """By how many of its deviations the parameter may be off unseen."""
        return self.error / self.per_std


def find_unseen_errors(result: FitResult, scores: Scores | None) -> tuple[Note, ...]:
    """A sentence on the worst of several kinds of numbers, where the intervals are stated as they stand."""
    if scores is None or result.status not in FINE or not result.noise_is_known:
        return ()
    every = sorted(unseen_errors(result, scores), key=lambda one: one.moved, reverse=True)
    every = [one for one in every if one.moved > MIN_EFFECT]
    return (_note(every, result),) if every else ()


def unseen_errors(result: FitResult, scores: Scores) -> Iterator[UnseenError]:
    """Of every held number, alone or with all of its kind by one factor, whose error moves a parameter."""
    test, std = scores.test, np.sqrt(np.diag(result.covariance))
    for one in scores.candidates:
        first = test.numbers[one.places[0]]
        if one.directions.shape[1] > 1 or not math.isfinite(first.usual):
            continue
        direction = one.directions[:, 0]
        at, parameter = _most_moved(test.response[:, one.places] @ direction, std)
        if at == 0:
            continue
        information = float(direction @ test.S[np.ix_(one.places, one.places)] @ direction) / scores.lines
        found = test.known[one.places].any() and information > 0
        error = min(first.usual, math.sqrt(MIN_DROP / information)) if found else first.usual
        yield UnseenError(one.name, one.group, first.unit, first.log, parameter, 1 / at, error)


def _most_moved(effects: FloatArray, std: FloatArray) -> tuple[float, int]:
    """Largest |effect| / std and its place; a parameter that the data do not reach is not moved."""
    moved = np.divide(np.abs(effects), std, out=np.zeros(len(std)), where=np.isfinite(std) & (std > 0))
    worst = int(np.argmax(moved))
    return float(moved[worst]), worst


def _note(every: list[UnseenError], result: FitResult) -> Note:
    """every: worst first."""
    worst = {one.group: one for one in reversed(every)}
    named = [one for one in every if worst[one.group] is one][:MAX_NAMED]
    others = sum(not one.name.endswith("*") for one in every if one not in named)
    moves = [
        f"{_stated(place, result)} moves by one standard deviation with {' or '.join(map(_per_std, ones))}"
        for place in dict.fromkeys(one.parameter for one in named)
        if (ones := [one for one in named if one.parameter == place])
    ]
    more = f", and others with {others} further numbers" if others else ""
    return Note(
        "held-as-exact",
        f"the intervals take as exact what the fit held: {', '.join(moves)}{more}; up to "
        f"{_amount(every[0].error, every[0])} of {_key(every[0])} shows in no residual: measure them as exactly, or "
        "fit those that can be with a prior",
        severity="information",
    )


def _stated(place: int, result: FitResult) -> str:
    parameter = result.parameters.free[place]
    value, std = result.values[parameter.name], result.std[parameter.name]
    share = f"{100 * std / abs(value):.2g} %" if parameter.log else f"{std:.2g} {parameter.unit}"
    return f"{parameter.name} (stated to {share})"


def _per_std(one: UnseenError) -> str:
    return f"{_amount(one.per_std, one)} of {_key(one)}"


def _key(one: UnseenError) -> str:
    """As the files of study and robot, or fit.parameters, call the number."""
    return "rate_hz" if one.name == RATE else one.name


def _amount(error: float, one: UnseenError) -> str:
    return f"{100 * error:.2g} %" if one.log or one.unit == "1" else f"{error:.2g} {one.unit}"
