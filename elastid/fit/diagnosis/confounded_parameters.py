r"""Confounded parameters: errors of fixed parameters, and an unmodelled base, that free parameters compensate.

They do not change the residuals. A stiff base is a spring in series with the first gear. It is not identifiable from
motor responses: the gear appears softer. By the score test, a base with compliance c changes the estimates x by

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

# Assumed stiffness of a base relative to the gear, and its maximum, N m/rad, for a steel pedestal on a floor. The bias
# is proportional to the compliance of the base. The base stiffness above which the bias is within the intervals depends
# on neither number.
BASE_RATIO, STIFFEST_BASE = 100.0, 1e7

NEGLIGIBLE = 1e-3  # bias relative to half of the interval, below which a part is not reported
MIN_SHIFT = 3.0  # least shift of an estimate in standard deviations for which a fixed parameter is reported


@dataclass(frozen=True)
class UndetectableError:
    """Undetectable error of a fixed parameter, or of a common factor of several.

    number: the first of them.  parameter: index in x of the parameter with the largest shift.  per_std: error that
    shifts it by one std.  error: largest undetectable error.
    """

    name: str
    number: FixedNumber
    parameter: int
    per_std: float
    error: float

    def amount(self, error: float) -> str:
        """Return a text with the error, its unit, and the name of the value."""
        is_relative = self.number.log or self.number.unit == "1"
        return (
            f"{100 * error:.2g} % of {self.name}" if is_relative else f"{error:.2g} {self.number.unit} of {self.name}"
        )


def undetectable_errors(result: Result, scores: Scores) -> Iterator[UndetectableError]:
    r"""Yield errors of fixed values, single or by a common factor, that shift a parameter.

    For example, free stiffness and damping compensate a small error of a gear ratio. For a fixed parameter h, with S
    and the effects of the score test and the standard deviations of x,

    .. math:: e_1 = \min_i \frac{\sigma_i}{|\partial x_i / \partial h|}, \qquad e_\text{undetectable} = \sqrt{D / S}

    are the error that shifts a parameter by one standard deviation, and the largest error that lowers V by at most D
    (`LIMITS.min_drop`) when it is corrected.
    """
    n = len(result.parameters.of_interest)
    test, std = scores.test, result.std_of_x[:n]
    for candidate in scores.candidates:
        locations, first = candidate.indices, test.numbers[candidate.indices[0]]
        is_exact = first.is_stated and not first.is_nuisance and not math.isinf(first.upper)
        if candidate.directions.shape[1] > 1 or not is_exact:
            continue
        direction = candidate.directions[:, 0]
        # An unidentifiable parameter has an infinite std: its relative change is 0.
        changes = quotient(np.abs(test.response[:n, locations] @ direction), std)
        worst = int(np.argmax(changes))
        if changes[worst] == 0:
            continue
        error = min(first.usual, scores.detectable(locations, direction))
        yield UndetectableError(candidate.name, first, worst, 1 / float(changes[worst]), error)


def find_undetectable_errors(result: Result, scores: Scores | None) -> tuple[Note, ...]:
    """Return a note on the worst fixed parameter of up to three kinds, if the intervals assume exact values."""
    if scores is None or result.status not in ("converged", "at_bound") or not result.noise_is_known:
        return ()
    # Rounding errors must not decide the order of two equivalent parameters.
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
    """Return undetectable rotations of the base about three axes, sorted by their bias relative to the intervals."""
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
    """Return dx / dc (n,) for elastic rotations of the base, and the detectable compliance c, rad/(N m), by name."""
    test = scores.test
    return {
        f"base about {number.name[-1]}": (test.response[:n, i], scores.detectable(np.array([i]), np.ones(1)))
        for i, number in enumerate(test.numbers)
        if number.name.startswith("base_")
    }


def find_elastic_base(result: Result) -> tuple[Note, ...]:
    """Return a note on stiffnesses whose bias by an elastic base exceeds their intervals; else an empty tuple."""
    remarks = result.base_remarks
    if not remarks:
        return ()
    text = f"{'. '.join(remarks.values())}. If the base is elastic, add its measured stiffness to the robot model"
    return (Note("fit/assumed-rigid", text, severity="information"),)
