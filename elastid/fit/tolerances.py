r"""Numbers of the robot's file within their tolerances: unknowns with a prior, next to those that a study asks for.

.. math:: V(x, \nu) = V(x; \nu) + \sum_j \Big( \frac{\nu_j - \nu_j^{file}}{\tau_j} \Big)^2

The starts are searched with the file's numbers held; the best of them is then released. A covariance of (x, nu) is that
of the estimate with the file in doubt; with nu known it would be the part of the noise,

.. math:: C_{noise} = C_{xx} - C_{x\nu} C_{\nu\nu}^{-1} C_{\nu x}, \qquad \sigma^2_{file} = \sigma^2 - \sigma^2_{noise}
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError, StudyError
from elastid.base.names import matching
from elastid.fit.assembly import Assembly
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.least_squares import LocalOptimum
from elastid.fit.problem.static_loads import PlacedTest
from elastid.fit.result import Result
from elastid.fit.solve.solvers import FINE, NEAR, solve
from elastid.fit.spec import FitSpec
from elastid.parameters import Parameter, Parameters, Prior, Tie
from elastid.response import Response
from elastid.robot import BASE, BodyTolerances, Robot, Tolerances, unit_axis
from elastid.robot.placement import Path
from elastid.robot.tolerances import RATIO, Exact, kind_of

MAX_FACTOR = 3.0  # of a positive number within its tolerance: a bound against absurd steps


def with_tolerances(parameters: Parameters, robot: Robot, spec: FitSpec) -> Parameters:
    """The same with the numbers that it holds free within robot.tolerances; unchanged where all are exact.

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
    """Of a number: the body, loop or payload that owns it, its kind, std; the common factor of an inertia's entries."""

    name: str
    owner: str
    kind: str
    std: float
    factor: str = ""


def tolerances_of(robot: Robot) -> Iterator[Tolerance]:
    """Of every number of the robot's file that is not exact."""
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
    """The same with its gears' ratios as uncertain as robot.tolerances has them, or exact."""
    within = robot.tolerances.ratio_std / RATIO if isinstance(robot.tolerances, Tolerances) else 0.0
    return replace(response, ratio_std=within * response.ratio_std)


def has_tolerances(robot: Robot) -> bool:
    """True if a number of the robot's file may be off."""
    return any(True for _ in tolerances_of(robot))


# V over its degrees of freedom, above which the released fit is solved from a further start; starts that are tried.
COST_RATIO, ATTEMPTS = 1.5, 4


def release(
    assembly: Assembly, starts: Sequence[LocalOptimum], robot: Robot, loads: Sequence[PlacedTest] = ()
) -> tuple[Assembly, ElasticFit, tuple[LocalOptimum, ...]]:
    """The fit with numbers free within their tolerances at its optimum, and the starts with theirs, the best first.

    It is solved from the end of the best start. While V stays above COST_RATIO of its degrees of freedom, the
    study's own start and the ends of the next best follow, since a file that is off may lead the search astray; the
    rest end where they did, with the file's numbers.
    """
    parameters, held = with_tolerances(assembly.parameters, robot, assembly.spec), assembly.parameters.free_names
    places = [parameters.free_names.index(name) for name in held]

    def widened(x: FloatArray) -> FloatArray:
        wide = parameters.x
        wide[places] = x
        return wide

    starts = [replace(start, x_start=widened(start.x_start), x=widened(start.x)) for start in starts]
    assembly = Assembly.of(
        assembly.responses, robot, assembly.spec, parameters, assembly.model, loads, assembly.weights
    )
    begins = [starts[0], replace(starts[0], x=parameters.x, x_start=parameters.x, iterations=0), *starts[1:]]
    best: tuple[ElasticFit, LocalOptimum] | None = None
    for begin in begins[:ATTEMPTS]:
        try:
            fit, end = _released(assembly, begin)
        except (StudyError, FitError):  # no robot stands on the way
            continue
        best = (fit, end) if best is None or end.cost < best[1].cost else best
        if best[1].cost <= COST_RATIO * fit.problem.dof:
            break
    if best is None:
        raise FitError(
            "robot/no-rest",
            f"no robot within the tolerances of its file stands at any of {ATTEMPTS} starts; check rate_hz, "
            "units, signs and order of the channels, and the angles of the configurations",
        )
    return assembly, best[0], (best[1], *starts[1:])


def _released(assembly: Assembly, begin: LocalOptimum) -> tuple[ElasticFit, LocalOptimum]:
    """The optimum near the end of a start, and the fit as linearised before the last round.

    Products such as m c^2 change little within tolerances: a round for each linearisation, not one at every x.
    """
    end = begin
    for tolerance in (NEAR, FINE):
        fit = assembly.at(end.x, assembly.spec.criterion)
        end = solve(fit.problem, end.x, tolerance, method=assembly.spec.solver)
    return fit, replace(end, x_start=begin.x_start, iterations=begin.iterations + end.iterations)


def remaining_tolerances(result: Result, robot: Robot) -> Tolerances | Exact | None:
    """Of the robot with the estimates of a fit: by body, what the data have left of its tolerances.

    The widest coordinate counts for all of a body.  As they are where the file is exact.
    """
    if not isinstance(robot.tolerances, Tolerances) or not result.has_tolerances:
        return robot.tolerances
    deviation = dict(zip(result.parameters.free_names, np.sqrt(np.diag(result.covariance)).tolist(), strict=True))
    owners = {*(body.name for body in robot.all_bodies), *(loop.name for loop in robot.loops)}
    left: dict[str, dict[str, float]] = {}
    for each in tolerances_of(robot):
        if each.owner in owners and (each.factor or each.name) in deviation:
            std = deviation[each.factor or each.name]
            if each.kind == "length" and result.parameters[each.name].log:
                std *= result.values[each.name]
            own = left.setdefault(each.owner, {})
            own[each.kind] = max(own.get(each.kind, 0.0), std)
    return replace(robot.tolerances, bodies=tuple(BodyTolerances(owner, **own) for owner, own in left.items()))
