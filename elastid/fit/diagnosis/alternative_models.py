"""Alternative models of a study, each fitted from its own start: other robots, or other conventions of the same robot.

Alternatives are: angles in another unit, direction or order; motor inertias or encoders on the other side of the gear;
another mounting; no payload, or an additional payload.  The optimum of the fit is too far from these causes for small
steps, so each alternative starts at its own values, with the tolerances about these values.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, values_by_name
from elastid.base.errors import ElastidError
from elastid.fit.diagnosis.hypothesis import SCALE, Evidence, Scores, index_of, with_refit
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.refit import UNCHANGED, logarithmic, on_line_subset, refit, search
from elastid.fit.diagnosis.unmodelled_payload import MIN_MASS_FRACTION, find_load, load_steps
from elastid.fit.frf_problem import Assembly
from elastid.fit.result_rows import ModificationIndex
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.parameters import Parameter, Parameters, Prior
from elastid.robot import Payload, Robot


class AlternativeModel(NamedTuple):
    """The fit with another robot, or with other responses."""

    name: str
    family: str
    assembly: Assembly


@dataclass(frozen=True, eq=False)
class Trial:
    """Best optimum of an alternative from two starts: index, V of all lines, and V of the logarithmic criterion."""

    index: ModificationIndex
    cost: float
    logarithmic_cost: float


def find_alternatives(indices: list[ModificationIndex], evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """Add the best alternative model, and a fitted load, to the indices if no cause explains the whole excess."""
    fraction = max((index.explained_fraction for index in indices), default=0.0)
    if fraction > LIMITS.complete_fraction and not any(index.group == SCALE for index in indices):
        return indices
    # An alternative must be better than the stated robot from the same starts.
    stated = _search(AlternativeModel("", "", evidence.assembly), evidence, scores)
    limit, as_stated = LIMITS.predicted_ratio * stated.logarithmic_cost, min(stated.cost, scores.cost)
    searches = (_search(alternative, evidence, scores, limit) for alternative in _alternatives(evidence))
    first, *others = sorted(searches, key=lambda trial: trial.cost)
    alternatives = []
    if as_stated - first.cost > LIMITS.majority_fraction * (as_stated - scores.noise):
        equal = tuple(other.index.name for other in others if first.cost > LIMITS.equal_drop * other.cost)
        alternatives.append(replace(first.index, alike=equal))
    if max(fraction, *(index.explained_fraction for index in alternatives), 0.0) <= LIMITS.complete_fraction:
        alternatives += [
            index for index in _with_load(evidence, scores) if index.explained_fraction > LIMITS.majority_fraction
        ]
    fractions = {index.name: index.explained_fraction for index in indices}
    better = {i.name: i for i in alternatives if i.explained_fraction > fractions.get(i.name, 0.0)}
    return [*(index for index in indices if index.name not in better), *better.values()]


def _search(alternative: AlternativeModel, evidence: Evidence, scores: Scores, limit: float = math.inf) -> Trial:
    """Search from the alternative's start and from the optimum.

    limit: V of the logarithmic criterion after half a search, above which the alternative cannot explain the residuals.
    """
    cost, logarithmic_cost = math.inf, math.inf
    assembly, x = alternative.assembly, alternative.assembly.parameters.x
    is_of_interest = np.array([not p.is_nuisance for p in assembly.parameters.free])
    for start in (x, np.where(is_of_interest, evidence.optimum.x, x)):
        with suppress(ElastidError, np.linalg.LinAlgError):  # no equilibrium, or V has no derivative
            fit = on_line_subset(assembly.at(start), LIMITS.n_refit_residuals)
            V, near = search(UNCHANGED, logarithmic(fit), start, iterations=LIMITS.iterations // 2)
            logarithmic_cost = min(logarithmic_cost, V)
            if limit >= V:
                V, end = search(UNCHANGED, fit, near)
                V *= evidence.optimum.fit.n_residuals / max(fit.n_residuals, 1)
                cost, x = min((cost, x), (V, end), key=lambda point: point[0])
    index = ModificationIndex(alternative.name, alternative.family)
    return Trial(with_refit(index, cost, x, evidence, scores), cost, logarithmic_cost)


def _alternatives(evidence: Evidence) -> Iterator[AlternativeModel]:
    yield from _angles(evidence)
    yield from _encoders(evidence)
    base = evidence.assembly
    robot, parameters = base.robot, base.parameters
    for name, family, other_robot, numbers in (*_motor_inertias(robot), *_mounting_alternatives(robot)):
        yield AlternativeModel(name, family, _with_robot(base, other_robot, _about(parameters, numbers)))


def _with_robot(base: Assembly, robot: Robot, parameters: Parameters) -> Assembly:
    """Return the assembly of another robot, or of other parameters."""
    arguments = base.spec, parameters, base.model, (), base.weights
    return Assembly.of(base.responses, robot, *arguments, presliding=base.linearisation.presliding)


def _angles(evidence: Evidence) -> Iterator[AlternativeModel]:
    assembly = evidence.assembly
    driven = assembly.robot.driven
    turns, n, degree = np.array([not joint.slides for joint in driven]), len(driven), math.radians(1)
    changes = {
        "angles of all configurations in degrees, read as radians": np.diag(np.where(turns, degree, 1.0)),
        "angles of all configurations in radians, read as degrees": np.diag(np.where(turns, 1 / degree, 1.0)),
    }
    for i, joint in enumerate(driven):
        phrase = f"angle of axis {joint.name} counted in the other direction in all configurations"
        changes[phrase] = np.diag(1.0 - 2 * (np.arange(n) == i))
    for i, (first, second) in enumerate(pairwise(driven)):
        order = [*range(i), i + 1, i, *range(i + 2, n)]
        changes[f"angles of axes {first.name} and {second.name} exchanged in all configurations"] = np.eye(n)[order]
    angles = np.array([G.configuration.angles for G in assembly.responses])
    for name, change in changes.items():
        new_angles = angles @ change.T
        if not np.allclose(new_angles, angles):
            pairs = zip(assembly.responses, new_angles, strict=True)
            responses = (replace(G, configuration=replace(G.configuration, angles=row)) for G, row in pairs)
            yield AlternativeModel(name, "postures", replace(assembly, responses=tuple(responses)))


def _encoders(evidence: Evidence) -> Iterator[AlternativeModel]:
    """Yield studies with encoders of an axis, or of all axes, on the other side of the elastic gear."""
    assembly = evidence.assembly
    elastic = [joint.name for joint in assembly.robot.driven if joint.is_flexible]
    for side, origin, opposite in (("behind", "motor", "joint"), ("before", "joint", "motor")):
        other_sides = {f"{origin} {name}": f"{opposite} {name}" for name in elastic}
        encoders = [place for place in other_sides if any(place in G.outputs for G in assembly.responses)]
        for places in (*([place] for place in encoders), *([encoders] if len(encoders) > 1 else ())):
            whose = f"encoder of axis {places[0].partition(' ')[2]}" if len(places) == 1 else "encoders of all axes"
            outputs = {place: other_sides[place] for place in places}
            responses = tuple(
                replace(G, outputs=tuple(outputs.get(place, place) for place in G.outputs)) for G in assembly.responses
            )
            yield AlternativeModel(
                f"{whose} {side} the gear", "side of the encoder", replace(assembly, responses=responses)
            )


# Name, family, robot, and the values about which the tolerances apply.
_Alternative: TypeAlias = tuple[str, str, Robot, Mapping[str, float]]


def _motor_inertias(robot: Robot) -> Iterator[_Alternative]:
    """Yield robots with the inertia of one motor or of all motors referred to the link side of the gear."""
    inertias = {name: value for name, (value, _) in robot.parameters().items() if name.startswith("Jm_") and value > 0}
    motor_side = {name: value / robot.ratio(name.removeprefix("Jm_")) ** 2 for name, value in inertias.items()}
    groups = {f"inertia of motor {name.removeprefix('Jm_')}": {name: value} for name, value in motor_side.items()}
    for name, numbers in (groups | ({"inertias of all motors": motor_side} if len(motor_side) > 1 else {})).items():
        cause = f"{name} given on the link side, or in kg cm^2"
        yield cause, "side of the gear", robot.with_parameters(numbers), numbers


def _mounting_alternatives(robot: Robot) -> Iterator[_Alternative]:
    size = float(np.linalg.norm(robot.gravity)) or 9.81
    directions = {f"gravity along {sign}{axis} of the base": size * float(f"{sign}1") * row
                  for axis, row in zip("xyz", np.eye(3), strict=True) for sign in "+-"}  # fmt: skip
    for name, gravity in (directions | {"no gravity": np.zeros(3)}).items():
        if not np.allclose(gravity, robot.gravity, atol=0.1 * size):
            yield name, "gravity", replace(robot, gravity=tuple(gravity.tolist())), {}
    if robot.payload is not None and robot.payload.mass > 0:
        numbers = {n: v for n, (v, _) in robot.parameters().items() if n == "m_payload" or n.startswith("I_payload")}
        massless = {name: MIN_MASS_FRACTION * value for name, value in numbers.items()}
        yield "the payload of the file not mounted", "payload of the file", robot.with_parameters(massless), massless


def _about(parameters: Parameters, numbers: Mapping[str, float]) -> Parameters:
    def shifted(p: Parameter) -> Parameter:
        if p.name not in numbers or not (p.is_nuisance or p.tie is not None or not p.free):
            return p
        value = numbers[p.name]
        if p.tie is not None:
            return replace(p, tie=replace(p.tie, factor=value), value=value)
        by = value / p.value if p.log else 0.0
        lower, upper = (p.lower * by, p.upper * by) if p.log else (p.lower + value - p.value, p.upper + value - p.value)
        return replace(p, value=value, lower=lower, upper=upper, prior=p.prior and replace(p.prior, mean=value))

    return replace(parameters, parameters=tuple(map(shifted, parameters)))


def _with_load(evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """Fit mass, position and inertia of a load on the body where it explains most of the excess of V.

    The load shifts resonances by more than their width, so that its linear step is only a start value.
    """
    bodies = (c for c in scores.candidates if c.family == "payload" and c.directions.shape[1] > 1)
    loads = ((find_load(scores.test, c, scores.variance_ratio, 0.0), c) for c in bodies)
    pairs = [(load, c) for load, c in loads if load is not None]
    if evidence.assembly.robot.payload is not None or not pairs:
        return []
    load, candidate = max(pairs, key=lambda pair: pair[0].drop)
    if not load.mass > 0:
        return []
    body = candidate.name.removeprefix("payload_")
    centre = _centre(scores, body)
    loaded = _carrying(evidence, body, load.mass, centre + load.position)
    if loaded is None or not loaded[0] < scores.cost:
        return []
    cost, p, x = loaded
    p[1:] -= centre
    steps = load_steps([scores.test.numbers[i] for i in candidate.indices], p)
    return [with_refit(index_of(candidate, scores.test.numbers, steps), cost, x, evidence, scores)]


def _centre(scores: Scores, body: str) -> FloatArray:
    """Return the centre of mass (3,) of a body in the robot model, in its axes."""
    value = {number.name: number.value for number in scores.test.numbers}
    return np.array([value.get(f"c_{body}_{axis}", 0.0) for axis in "xyz"])


def _carrying(
    evidence: Evidence, body: str, mass: float, centre: FloatArray
) -> tuple[float, FloatArray, FloatArray] | None:
    """Fit the mass (kg) and the position (m) of a load on a body. Return V, the load (4,) and x (n_x,)."""
    study = evidence.assembly
    inertia, names = mass * LIMITS.load_radius**2, tuple(f"c_payload_{axis}" for axis in "xyz")
    robot = replace(study.robot, payload=Payload(mass, tuple(centre.tolist()), inertia, body))
    rows = (("m_payload", mass, "kg"), *((n, float(v), "m") for n, v in zip(names, centre, strict=True)),
            ("I_payload", inertia, "kg*m^2"))  # fmt: skip
    numbers = [Parameter(n, v, unit, log=unit != "m", prior=Prior(v, LIMITS.load_std)) for n, v, unit in rows]
    file, estimates = study.parameters, values_by_name(study.parameters.free_names, evidence.result.x)
    by_name = {p.name: p for p in (*file, *numbers)}
    in_order = tuple(by_name.pop(name) for name in robot.parameters(by_name) if name in by_name)
    parameters = Parameters((*in_order, *by_name.values()))
    x = parameters.x_with({p.name: estimates[p.name] for p in file.of_interest})
    try:
        assembly = _with_robot(study, robot, parameters)
        for _ in range(LIMITS.n_load_rounds):
            fit = assembly.at(x)
            _, near = refit(UNCHANGED, on_line_subset(fit), x)
            x = solve(fit.problem, near, ROUGH, LIMITS.iterations).x
        cost = assembly.at(x).evaluate(x).cost
    except (ElastidError, np.linalg.LinAlgError):  # no equilibrium along the search, or V has no derivative
        return None
    values = values_by_name(parameters.free_names, x)
    p = np.array([math.exp(values["m_payload"]), *(values.get(name, 0.0) for name in names)])
    return cost, p, np.array([values[name] for name in file.free_names])
