r"""Confounded parameters: errors of fixed numbers, and a rigid base, that free parameters compensate.

No residual shows them. A stiff base is a spring in series with the first gear, and is not identifiable from motor
responses: the gear appears slightly softer. By the score test, a base with compliance c changes the estimates x by

.. math:: \Delta x = c\, \partial x / \partial c, \qquad
          \Delta \ln k_1 = -c\, k_1, \; \Delta \ln d_1 = -2 c\, k_1 \quad \text{of a base about the first axis.}
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, quotient
from elastid.base.errors import Note
from elastid.base.statistics import QUANTILE_95
from elastid.fit.diagnosis.hypothesis import Scores
from elastid.fit.diagnosis.score_test import FixedNumber
from elastid.fit.result import Result
from elastid.fit.result_rows import RigidPart
from elastid.fit.status_terms import FIXED_VALUES

# Assumed stiffness of a pedestal over the gear stiffness, and its maximum in N m/rad, a steel pedestal on a floor. The
# bias by a base is proportional to its compliance; the stiffness from which on it is within the intervals depends on
# neither.
BASE_RATIO, STIFFEST_BASE = 100.0, 1e7

NEGLIGIBLE = 1e-3  # change over the half of an interval, below which a part is not named
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
        error = min(first.usual, scores.detectable(places, direction))
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


def find_rigid_parts(result: Result, scores: Scores) -> tuple[RigidPart, ...]:
    """Return the base about three axes, as far as no response shows it; the axis first about which it takes most."""
    of_interest, parts = result.parameters.of_interest, list[RigidPart]()
    robot = scores.extended.linearisation.model.robot
    k = {p.name: math.exp(x) for p, x in zip(of_interest, result.x, strict=False) if p.log and p.name.startswith("k_")}
    std = result.std_of_x[: len(of_interest)]
    limits = QUANTILE_95 * np.where(np.isfinite(std) & (std > 0), std, np.inf)
    owners = {body.name for body in robot.bodies}
    for body in (body for body in robot.bodies if body.joints and body.parent not in owners):
        first = next((joint for joint in body.joints if joint.motor is not None), None)
        if first is None or first.slides or f"k_{first.name}" not in k:
            continue
        gear, springs = k[f"k_{first.name}"], _tilting(scores, len(of_interest))
        if not any(joint.axis == first.axis for joint in body.joints if joint is not first):
            series = {f"k_{first.name}": -gear, f"d_{first.name}": -2 * gear}
            slope = np.array([series.get(parameter.name, 0.0) for parameter in of_interest])
            springs[f"base about axis {first.name}"] = slope, math.inf
        usual = max(1 / (BASE_RATIO * gear), 1 / STIFFEST_BASE)
        for name, (slope, visible) in springs.items():
            changes = min(usual, visible) * slope
            if np.max(np.abs(changes) / limits) > NEGLIGIBLE:
                parts.append(RigidPart(name, 1 / usual, changes, float(np.max(np.abs(slope) / limits))))
    return tuple(sorted(parts, key=lambda part: -part.detection_limit / part.stiffness))


def _tilting(scores: Scores, n: int) -> dict[str, tuple[FloatArray, float]]:
    """Return dx / dc (n,) of elastic rotations of the base, and the detectable compliance c, by their names."""
    test = scores.test
    return {
        f"base about {number.name[-1]}": (test.response[:n, place], scores.detectable(np.array([place]), np.ones(1)))
        for place, number in enumerate(test.numbers)
        if number.name.startswith("base_")
    }


def find_elastic_base(result: Result) -> tuple[Note, ...]:
    """Return a note on the base that lowers the stiffnesses most, where they would leave an interval."""
    remarks = result.base_remarks
    if not remarks:
        return ()
    text = f"{'. '.join(remarks.values())}. If the base is elastic, add its measured stiffness to the robot model"
    return (Note("fit/assumed-rigid", text, severity="information"),)
