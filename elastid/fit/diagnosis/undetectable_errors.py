"""Undetectable errors of held numbers: no test of the responses finds them, since free parameters take them up."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elastid.base.note import Note
from elastid.fit.diagnosis.hypothesis import Scores
from elastid.fit.diagnosis.sensitivities import RATE
from elastid.fit.diagnosis.status import MISFIT
from elastid.fit.result import HELD_AS_EXACT, Result

SAID = 3.0  # standard deviations, by which a number that is held moves one of the fit, and is named


@dataclass(frozen=True)
class UndetectableError:
    """name, family: of a held number.  per_std: its error that moves parameter (its place in x) by one deviation.

    error: the largest common one that nothing finds; both of ln p where log, else SI in unit.
    """

    name: str
    family: str
    unit: str
    log: bool
    parameter: int
    per_std: float
    error: float

    @property
    def moved(self) -> float:
        """The undetected error of the parameter, in its standard deviations."""
        return self.error / self.per_std

    def amount(self, error: float) -> str:
        """An error with its unit, and the number as the files of study and robot, or fit.parameters, call it."""
        size = f"{100 * error:.2g} %" if self.log or self.unit == "1" else f"{error:.2g} {self.unit}"
        return f"{size} of {'rate_hz' if self.name == RATE else self.name}"


def undetectable_errors(result: Result, scores: Scores) -> Iterator[UndetectableError]:
    r"""Of every held number, alone or with all of its kind by one factor, whose error moves a parameter.

    A gear ratio that is wrong by a little changes the response as stiffness and damping do: free parameters take it up.
    Of a number h, with S and the effects of the score test and the standard deviations of x,

    .. math:: e_1 = \min_i \frac{\sigma_i}{|\partial x_i / \partial h|}, \qquad e_\text{undetectable} = \sqrt{D / S}

    are the error that moves a parameter by its standard deviation, and the largest one whose freeing would lower V by
    no more than what shows a model to be wrong (D, `status.MISFIT.drop`).
    """
    n = len(result.parameters.asked)
    test, std = scores.test, np.sqrt(np.diag(result.covariance)[:n])
    for candidate in scores.candidates:
        places, first = candidate.places, test.numbers[candidate.places[0]]
        is_exact = first.is_stated and not first.tolerated and not math.isinf(first.upper)
        if candidate.directions.shape[1] > 1 or not is_exact:
            continue
        direction = candidate.directions[:, 0]
        effects = np.abs(test.response[:n, places] @ direction)
        # A parameter that the data do not reach is not moved.
        moved = np.divide(effects, std, out=np.zeros(len(std)), where=np.isfinite(std) & (std > 0))
        worst = int(np.argmax(moved))
        if moved[worst] == 0:
            continue
        information = float(direction @ test.S[np.ix_(places, places)] @ direction) / scores.lines
        is_detectable = test.known[places].any() and information > 0
        error = min(first.usual, math.sqrt(MISFIT.drop / information)) if is_detectable else first.usual
        of_number = candidate.name, candidate.family, first.unit, first.log
        yield UndetectableError(*of_number, worst, 1 / float(moved[worst]), error)


def find_undetectable_errors(result: Result, scores: Scores | None) -> tuple[Note, ...]:
    """A sentence on the worst of several kinds of numbers, where the intervals are stated as they stand."""
    if scores is None or result.status not in ("converged", "at_bound") or not result.noise_is_known:
        return ()
    # Of two that do exactly the same, rounding does not choose.
    errors = sorted(undetectable_errors(result, scores), key=lambda error: -float(f"{error.moved:.6g}"))
    errors = [error for error in errors if error.moved > SAID]
    if not errors:
        return ()
    worst = {error.family: error for error in reversed(errors)}
    named = [error for error in errors if worst[error.family] is error][:3]  # one of a kind
    further = sum(not error.name.endswith("*") for error in errors if error not in named)
    moves = [
        f"{_stated(place, result)} moves by one standard deviation with "
        + " or ".join(error.amount(error.per_std) for error in named if error.parameter == place)
        for place in dict.fromkeys(error.parameter for error in named)
    ]
    more = f", and others with {further} further numbers" if further else ""
    text = (
        f"the intervals take as exact what the fit held: {', '.join(moves)}{more}; up to "
        f"{errors[0].amount(errors[0].error)} shows in no residual: measure them as exactly, or fit those that can be "
        "with a prior"
    )
    return (Note(HELD_AS_EXACT, text, severity="information"),)


def _stated(place: int, result: Result) -> str:
    parameter = result.parameters.free[place]
    value, std = result.values[parameter.name], result.std[parameter.name]
    share = f"{100 * std / abs(value):.2g} %" if parameter.log else f"{std:.2g} {parameter.unit}"
    return f"{parameter.name} (stated to {share})"
