"""Release of the file's numbers within their tolerances, and what the data leave of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError, StudyError
from elastid.fit.assembly import Assembly
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.least_squares import LocalOptimum
from elastid.fit.problem.static_loads import PlacedTest
from elastid.fit.result import Result
from elastid.fit.solve.solvers import FINE, NEAR, solve
from elastid.fit.tolerances import tolerances_of, with_tolerances
from elastid.robot import BodyTolerances, Robot, Tolerances
from elastid.robot.tolerances import Exact

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
    """Tolerances of the robot with the estimates of a fit: by body, what the data have left of them.

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
