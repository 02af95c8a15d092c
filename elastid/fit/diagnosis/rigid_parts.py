r"""Parts that a model takes as rigid, and what they take from the stiffnesses where they are as stiff as is usual.

No response of the motors shows a stiff spring in series with a gear: the gear then is a little softer. A part with the
compliance c moves the estimates x as the score test says,

.. math:: \Delta x = c\, \partial x / \partial c, \qquad
          \Delta \ln k_1 = -c\, k_1, \; \Delta \ln d_1 = -2 c\, k_1 \quad \text{of a base about the first axis.}
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import percent
from elastid.base.note import Note
from elastid.base.statistics import QUANTILE_95
from elastid.fit.diagnosis.hypothesis import Scores
from elastid.fit.diagnosis.status import MISFIT
from elastid.fit.result import BASE, FitResult, RigidPart
from elastid.robot import Body, Robot

# Stiffness of a gear's main bearing against tilting over the torsional one: 5 to 9 in catalogues of cycloidal gears.
BEARING_RATIO = 7.0
# Stiffness of a pedestal or floor over that of the gear of the first axis: 50 to several hundred.
BASE_RATIO = 100.0
NEGLIGIBLE = 1e-3  # change over the half of an interval, below which a part is not named


def find_rigid_parts(result: FitResult, scores: Scores, robot: Robot) -> tuple[RigidPart, ...]:
    """The base about three axes, then bearings and links of the bodies; those first that take most."""
    wanted = result.parameters.wanted
    x = {p.name: float(x) for p, x in zip(wanted, result.x, strict=False) if p.name.startswith("k_") and p.log}
    std = np.sqrt(np.diag(result.covariance)[: len(wanted)])
    limits = QUANTILE_95 * np.where(np.isfinite(std) & (std > 0), std, np.inf)
    parts = []
    for name, c, changes in (*_base(robot, x, scores, result), *_bearings(robot, x, scores, len(wanted))):
        beyond = float(np.max(np.abs(changes) / limits))
        if beyond > NEGLIGIBLE:
            parts.append(RigidPart(name, 1 / c, changes, beyond / c))
    return tuple(sorted(parts, key=lambda part: (not part.is_base, -part.hidden_from / part.stiffness)))


def find_elastic_base(result: FitResult) -> tuple[Note, ...]:
    """A sentence on the base that takes most, where it would leave an interval."""
    base = next((part for part in result.rigid_parts if part.is_base and part.hidden_from > part.stiffness), None)
    taken = base.most_moved([parameter.name for parameter in result.parameters.wanted]) if base else {}
    if base is None or not taken:
        return ()
    text = (
        f"no response shows what the robot stands on: as stiff as is usual ({base.stiffness:.2g} N*m/rad, {base.name}) "
        f"it takes {', '.join(f'{percent(-change)} from {name}' for name, change in taken.items())}, and is within the "
        f"intervals from {base.hidden_from:.2g} N*m/rad on; measure it, and give it a spring in the robot's file"
    )
    return (Note("base-as-rigid", text, severity="information"),)


def _base(
    robot: Robot, x: dict[str, float], scores: Scores, result: FitResult
) -> Iterator[tuple[str, float, FloatArray]]:
    """Name, compliance and changes (n,) of what carries the robot, but for axes with a spring in the model."""
    for body in _roots(robot):
        first = next((joint for joint in body.joints if joint.motor is not None), None)
        if first is None or first.slides or f"k_{first.name}" not in x:
            continue
        names = [parameter.name for parameter in result.parameters.wanted]
        c = math.exp(-x[f"k_{first.name}"]) / BASE_RATIO
        series = {f"k_{first.name}": -1 / BASE_RATIO, f"d_{first.name}": -2 / BASE_RATIO}
        if not any(joint.axis == first.axis for joint in body.joints if joint is not first):
            yield f"{BASE} about axis {first.name}", c, np.array([series.get(name, 0.0) for name in names])
        for axis, changes in _torsions(scores, body, c, len(names)):
            yield f"{BASE} about {axis}", c, changes


def _bearings(robot: Robot, x: dict[str, float], scores: Scores, n: int) -> Iterator[tuple[str, float, FloatArray]]:
    """Of the bearing across a body's gear, and the link before it; without a gear of its own by the stiffest one."""
    for body in robot.bodies:
        own = [x[f"k_{joint.name}"] for joint in body.joints if f"k_{joint.name}" in x] or [*x.values()]
        if own and body not in _roots(robot):
            c = math.exp(-max(own)) / BEARING_RATIO
            for axis, changes in _torsions(scores, body, c, n):
                yield f"bearing or link before {body.name} about {axis}", c, changes


def _torsions(scores: Scores, body: Body, c: float, n: int) -> Iterator[tuple[str, FloatArray]]:
    """By axis: changes (n,) by the elastic rotation before a body, as far as it shows in no residual."""
    test, names = scores.test, {f"torsion_{body.name}_{axis}": axis for axis in "xyz"}
    for place, number in enumerate(test.numbers):
        if number.name in names:
            information = float(test.S[place, place]) / scores.lines
            is_visible = bool(test.known[place]) and information > 0
            largest = min(c, math.sqrt(MISFIT.drop / information)) if is_visible else c
            yield names[number.name], largest * test.response[:n, place]


def _roots(robot: Robot) -> tuple[Body, ...]:
    """Bodies that the ground carries by joints."""
    names = {body.name for body in robot.bodies}
    return tuple(body for body in robot.bodies if body.joints and body.parent not in names)
