r"""Undetectable errors of held numbers: no test of the responses finds them, since free parameters take them up.

Parts that a model takes as rigid, and what they take from the stiffnesses where they are as stiff as is usual.

No response of the motors shows a stiff spring in series with a gear: the gear then is a little softer. A part with the
compliance c moves the estimates x as the score test says,

.. math:: \Delta x = c\, \partial x / \partial c, \qquad
          \Delta \ln k_1 = -c\, k_1, \; \Delta \ln d_1 = -2 c\, k_1 \quad \text{of a base about the first axis.}
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import percent
from elastid.base.errors import Note
from elastid.base.statistics import QUANTILE_95
from elastid.fit.diagnosis.hypothesis import Scores
from elastid.fit.diagnosis.sensitivities import RATE
from elastid.fit.diagnosis.status import MISFIT
from elastid.fit.result import HELD_AS_EXACT, Result, RigidPart
from elastid.parameters import Parameter
from elastid.robot import Body, Robot

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


# Assumed stiffness of a gear's main bearing against tilting, and of a pedestal, over that of the gear; a pedestal of
# steel on a floor, N m/rad, is no stiffer under a stiffer gear. What a part takes is in proportion to its compliance,
# and the stiffness from which on it is within the intervals depends on neither.
BEARING_RATIO, BASE_RATIO, STIFFEST_BASE = 7.0, 100.0, 1e7
NEGLIGIBLE = 1e-3  # change over the half of an interval, below which a part is not named


@dataclass(frozen=True)
class _Spring:
    """A spring in place of a rigid part: dx / dc (n,), the usual compliance c, and that which shows in residuals."""

    name: str
    slope: FloatArray
    usual: float
    visible: float = math.inf


def find_rigid_parts(result: Result, scores: Scores, robot: Robot) -> tuple[RigidPart, ...]:
    """The base about three axes, then bearings and links of the bodies; those first that take most."""
    asked = result.parameters.asked
    k = {p.name: math.exp(x) for p, x in zip(asked, result.x, strict=False) if p.log and p.name.startswith("k_")}
    std = np.sqrt(np.diag(result.covariance)[: len(asked)])
    limits = QUANTILE_95 * np.where(np.isfinite(std) & (std > 0), std, np.inf)
    parts = []
    for is_base, springs in ((True, _base(robot, k, scores, asked)), (False, _bearings(robot, k, scores, len(asked)))):
        for spring in springs:
            changes = min(spring.usual, spring.visible) * spring.slope
            if np.max(np.abs(changes) / limits) > NEGLIGIBLE:
                hidden_from = float(np.max(np.abs(spring.slope) / limits))
                parts.append(RigidPart(spring.name, is_base, 1 / spring.usual, changes, hidden_from))
    return tuple(sorted(parts, key=lambda part: (not part.is_base, -part.hidden_from / part.stiffness)))


def find_elastic_base(result: Result) -> tuple[Note, ...]:
    """A sentence on the base that takes most, where it would leave an interval."""
    base = next((part for part in result.rigid_parts if part.is_base and part.hidden_from > part.stiffness), None)
    taken = base.most_moved([parameter.name for parameter in result.parameters.asked]) if base else {}
    if base is None or not taken:
        return ()
    text = (
        f"no response shows what the robot stands on: as stiff as is usual ({base.stiffness:.2g} N*m/rad, {base.name}) "
        f"it takes {', '.join(f'{percent(-change)} from {name}' for name, change in taken.items())}, and is within the "
        f"intervals from {base.hidden_from:.2g} N*m/rad on; measure it, and give it a spring in the robot's file"
    )
    return (Note("fit/undetectable", text, severity="information"),)


def _base(robot: Robot, k: dict[str, float], scores: Scores, asked: Sequence[Parameter]) -> Iterator[_Spring]:
    """Of what carries the robot, but for axes with a spring in the model."""
    for body in _roots(robot):
        first = next((joint for joint in body.joints if joint.motor is not None), None)
        if first is None or first.slides or f"k_{first.name}" not in k:
            continue
        stiffness = k[f"k_{first.name}"]
        usual = max(1 / (BASE_RATIO * stiffness), 1 / STIFFEST_BASE)
        if not any(joint.axis == first.axis for joint in body.joints if joint is not first):
            series = {f"k_{first.name}": -stiffness, f"d_{first.name}": -2 * stiffness}
            slope = np.array([series.get(parameter.name, 0.0) for parameter in asked])
            yield _Spring(f"base about axis {first.name}", slope, usual)
        yield from _torsions(scores, "base", len(asked), "base", usual)


def _bearings(robot: Robot, k: dict[str, float], scores: Scores, n: int) -> Iterator[_Spring]:
    """Of the bearing across a body's gear, and the link before it; without a gear of its own by the stiffest one."""
    for body in robot.bodies:
        own = [k[f"k_{joint.name}"] for joint in body.joints if f"k_{joint.name}" in k] or [*k.values()]
        if own and body not in _roots(robot):
            name = f"bearing or link before {body.name}"
            yield from _torsions(scores, f"torsion_{body.name}", n, name, 1 / (BEARING_RATIO * max(own)))


def _torsions(scores: Scores, of: str, n: int, name: str, usual: float) -> Iterator[_Spring]:
    """Elastic rotations about the axes that the score test has; of: their names but for the axis."""
    test, axes = scores.test, {f"{of}_{axis}": axis for axis in "xyz"}
    for place, number in enumerate(test.numbers):
        if number.name in axes:
            information = float(test.S[place, place]) / scores.lines
            is_visible = bool(test.known[place]) and information > 0
            visible = math.sqrt(MISFIT.drop / information) if is_visible else math.inf
            yield _Spring(f"{name} about {axes[number.name]}", test.response[:n, place], usual, visible)


def _roots(robot: Robot) -> tuple[Body, ...]:
    """Bodies that the ground carries by joints."""
    names = {body.name for body in robot.bodies}
    return tuple(body for body in robot.bodies if body.joints and body.parent not in names)
