"""Confounded parameters: errors of fixed numbers that free parameters compensate, so that no residual shows them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import quotient
from elastid.base.errors import Note
from elastid.fit.diagnosis.hypothesis import Scores
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.score_test import FixedNumber
from elastid.fit.result import Result
from elastid.fit.status_terms import FIXED_VALUES

MIN_SHIFT = 3.0  # standard deviations, by which a fixed number moves a parameter of the fit, and is named


@dataclass(frozen=True)
class UndetectableError:
    """Fixed value, or common factor of several; per_std: its error that shifts a parameter by one std.

    number: the first of them.  parameter: its place in x.  error: the largest common one that nothing finds.
    """

    name: str
    number: FixedNumber
    parameter: int
    per_std: float
    error: float

    def amount(self, error: float) -> str:
        """Return an error with its unit, and the number as the files of study and robot, or fit.parameters, call it."""
        is_relative = self.number.log or self.number.unit == "1"
        return (
            f"{100 * error:.2g} % of {self.name}" if is_relative else f"{error:.2g} {self.number.unit} of {self.name}"
        )


def undetectable_errors(result: Result, scores: Scores) -> Iterator[UndetectableError]:
    r"""Yield errors of fixed values, single or by a common factor, that shift a parameter.

    A gear ratio that is wrong by a little changes the response as stiffness and damping do: free parameters take it up.
    Of a number h, with S and the effects of the score test and the standard deviations of x,

    .. math:: e_1 = \min_i \frac{\sigma_i}{|\partial x_i / \partial h|}, \qquad e_\text{undetectable} = \sqrt{D / S}

    are the error that moves a parameter by its standard deviation, and the largest one whose freeing would lower V by
    no more than the limit of a model error (D, `status.LIMITS.drop`).
    """
    n = len(result.parameters.of_interest)
    test, std = scores.test, result.std_of_x[:n]
    for candidate in scores.candidates:
        places, first = candidate.places, test.numbers[candidate.places[0]]
        is_exact = first.is_stated and not first.is_nuisance and not math.isinf(first.upper)
        if candidate.directions.shape[1] > 1 or not is_exact:
            continue
        direction = candidate.directions[:, 0]
        # A parameter that the data do not reach is not moved.
        changes = quotient(np.abs(test.response[:n, places] @ direction), std)
        worst = int(np.argmax(changes))
        if changes[worst] == 0:
            continue
        information = float(direction @ test.S[np.ix_(places, places)] @ direction) / scores.lines
        is_detectable = test.is_distinct[places].any() and information > 0
        error = min(first.usual, math.sqrt(LIMITS.drop / information)) if is_detectable else first.usual
        yield UndetectableError(candidate.name, first, worst, 1 / float(changes[worst]), error)


def find_undetectable_errors(result: Result, scores: Scores | None) -> tuple[Note, ...]:
    """Return a sentence on the worst of three kinds of numbers, where the intervals are stated as they stand."""
    if scores is None or result.status not in ("converged", "at_bound") or not result.noise_is_known:
        return ()
    # Of two that do exactly the same, rounding does not choose.
    errors = sorted(undetectable_errors(result, scores), key=lambda error: -float(f"{error.error / error.per_std:.6g}"))
    worst = {error.number.family: error for error in reversed(errors) if error.error > MIN_SHIFT * error.per_std}
    largest = [error for error in errors if worst.get(error.number.family) is error][:3]
    if not largest:
        return ()
    free = result.parameters.free_names
    moves = ", ".join(f"{error.amount(error.per_std)} ({free[error.parameter]})" for error in largest)
    text = (
        "the intervals assume that the fixed values of the robot model are exact. Errors that change an estimate by "
        f"one std: {moves}. The residuals do not show an error of {largest[0].amount(largest[0].error)}. State the "
        "tolerances of these values in robot.tolerances, so that the intervals include them"
    )
    return (Note(FIXED_VALUES, text, severity="information"),)
