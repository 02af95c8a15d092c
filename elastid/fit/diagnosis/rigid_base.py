r"""Rigid-base error: effect of a base of typical stiffness on the estimates of a model with a rigid base.

A stiff base is a spring in series with the first gear, and is not identifiable from motor responses: the gear appears
slightly softer. By the score test, a base with compliance c changes the estimates x by

.. math:: \Delta x = c\, \partial x / \partial c, \qquad
          \Delta \ln k_1 = -c\, k_1, \; \Delta \ln d_1 = -2 c\, k_1 \quad \text{of a base about the first axis.}
"""

import math

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import Note
from elastid.base.statistics import QUANTILE_95
from elastid.fit.diagnosis.hypothesis import Scores
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.result import Result
from elastid.fit.result_rows import RigidPart
from elastid.robot import Robot

# Assumed stiffness of a pedestal over the gear stiffness, and its maximum in N m/rad, a steel pedestal on a floor. The
# bias by a base is proportional to its compliance; the stiffness from which on it is within the intervals depends on
# neither.
BASE_RATIO, STIFFEST_BASE = 100.0, 1e7

NEGLIGIBLE = 1e-3  # change over the half of an interval, below which a part is not named


def find_rigid_parts(result: Result, scores: Scores, robot: Robot) -> tuple[RigidPart, ...]:
    """Return the base about three axes, as far as no response shows it; the axis first about which it takes most."""
    of_interest, parts = result.parameters.of_interest, list[RigidPart]()
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
    test, errors = scores.test, dict[str, tuple[FloatArray, float]]()
    for place, number in enumerate(test.numbers):
        if number.name.startswith("base_"):
            information = float(test.S[place, place]) / scores.lines
            is_visible = bool(test.is_distinct[place]) and information > 0
            visible = math.sqrt(LIMITS.drop / information) if is_visible else math.inf
            errors[f"base about {number.name[-1]}"] = test.response[:n, place], visible
    return errors


def find_elastic_base(result: Result) -> tuple[Note, ...]:
    """Return a note on the base that lowers the stiffnesses most, where they would leave an interval."""
    remarks = result.base_remarks
    if not remarks:
        return ()
    text = f"{'. '.join(remarks.values())}. If the base is elastic, add its measured stiffness to the robot model"
    return (Note("fit/assumed-rigid", text, severity="information"),)
