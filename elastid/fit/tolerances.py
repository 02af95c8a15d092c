r"""Numbers of the robot's file within their tolerances: unknowns with a prior, next to those that a study asks for.

.. math:: V(x, \nu) = V(x; \nu) + \sum_j \Big( \frac{\nu_j - \nu_j^{file}}{\tau_j} \Big)^2

The starts are searched with the file's numbers held; the best of them is then released. A covariance of (x, nu) is that
of the estimate with the file in doubt; with nu known it would be the part of the noise,

.. math:: C_{noise} = C_{xx} - C_{x\nu} C_{\nu\nu}^{-1} C_{\nu x}, \qquad \sigma^2_{file} = \sigma^2 - \sigma^2_{noise}
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.names import matching
from elastid.fit.spec import FitSpec
from elastid.parameters import Parameter, Parameters, Prior, Tie
from elastid.response import Response
from elastid.robot import BASE, Robot, Tolerances, unit_axis
from elastid.robot.placement import Path
from elastid.robot.tolerances import RATIO, kind_of

MAX_FACTOR = 3.0  # of a positive number within its tolerance: a bound against absurd steps


def with_tolerances(parameters: Parameters, robot: Robot, spec: FitSpec) -> Parameters:
    """Parameters with held numbers free within robot.tolerances; unchanged where all are exact.

    What spec.parameters frees, ties or fixes stays as it is.  Coordinates that are zero stay, but for centres of mass:
    an offset of an axis acts in second order.
    """
    tolerances = {each.name: each for each in tolerances_of(robot)}
    known = {parameter.name: parameter for parameter in parameters}
    asked = {p.stands_for for p in parameters if p.is_free or p.tie is not None}
    asked |= {n for key, own in spec.parameters.items() if own.fixed for n in matching(key, parameters.names)}
    numbers: list[Parameter] = []
    factors: dict[str, Parameter] = {}
    for name, (value, unit) in robot.parameters((*parameters.names, *tolerances)).items():
        number = known.get(name, Parameter(name, value, unit, log=name.startswith(("l_", "gain_")), free=False))
        own = tolerances.get(name)
        if own is None or name in asked or (number.value == 0 and own.kind not in ("center_of_mass", "angle")):
            numbers += [number] * (name in known)
        elif own.factor:
            factors[own.factor] = replace(_within(Parameter(own.factor, 1.0, log=True), own.std), ratio=True)
            numbers.append(replace(number, tie=Tie(own.factor, number.value)))
        else:
            numbers.append(_within(number, own.std))
    written = {number.name for number in numbers}
    return Parameters((*numbers, *(p for p in parameters if p.name not in written), *factors.values()))


def _within(held: Parameter, std: float) -> Parameter:
    """A held number free within its tolerance, which is relative for a positive one."""
    if not held.log:
        return replace(held, free=True, prior=Prior(held.value, std), tolerated=True)
    lower, upper = held.value / MAX_FACTOR, held.value * MAX_FACTOR
    relative = std / held.value if held.unit == "m" else std
    return replace(held, free=True, lower=lower, upper=upper, prior=Prior(held.value, relative), tolerated=True)


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of a number: body, loop or payload that owns it, kind, std; factor of an inertia's entries."""

    name: str
    owner: str
    kind: str
    std: float
    factor: str = ""


def tolerances_of(robot: Robot) -> Iterator[Tolerance]:
    """Tolerances of every number of the robot's file that is not exact."""
    if not isinstance(robot.tolerances, Tolerances):
        return
    values = robot.parameters()
    for name, (_, path) in (robot.numbers | robot.geometry).items():
        owner = getattr(robot, str(path[0]))[path[1]].name if isinstance(path[1], int) else str(path[0])
        factor = f"I_{owner}" if path[-2] == "inertia" else ""
        is_without_mass = kind_of(path) == "center_of_mass" and values[f"m_{owner}"][0] == 0
        if (std := robot.tolerances.std(path, owner)) > 0 and not is_without_mass and not _turns_all(robot, path):
            yield Tolerance(name, owner, kind_of(path), std, factor)
    if (std := robot.tolerances.torque_constant_std) > 0:
        yield from (Tolerance(n, "", "torque_constant", std) for n in robot.gains if n.startswith("gain_u_"))


def _turns_all(robot: Robot, path: Path) -> bool:
    """True of a zero with which the whole robot turns about gravity, so that no response shows it."""
    if path[-1] != "zero" or robot.loops or robot.compensators:
        return False
    body, joint = robot.bodies[int(path[1])], robot.bodies[int(path[1])].joints[int(path[3])]
    axis = body.placement.rotation @ unit_axis(joint.axis)
    return body.parent == BASE and path[3] == 0 and float(np.linalg.norm(np.cross(axis, robot.gravity))) < 1e-9


def ratio_within(response: Response, robot: Robot) -> Response:
    """Response with its gears' ratios as uncertain as robot.tolerances has them, or exact."""
    within = robot.tolerances.ratio_std / RATIO if isinstance(robot.tolerances, Tolerances) else 0.0
    return replace(response, ratio_std=within * response.ratio_std)


def has_tolerances(robot: Robot) -> bool:
    """True if a number of the robot's file may be off."""
    return any(True for _ in tolerances_of(robot))
