r"""Selection of the parameters of a fit: numbers of the robot under `fit.parameters` of a study, and nuisance
parameters.

Stiffness, damping, friction, inertia, mass and a rod's length are logarithmic; centres of mass, coordinates of the
geometry, products of inertia, a spring's quadratic terms, a compensator's length and the delay are linear. Numbers that
a study does not name keep the value of the robot model.

Groups of configurations (of one robot, of one temperature, single configurations) can have separate parameters:
fm_1@warm replaces fm_1 in the configurations of the group warm.

Numbers with tolerances are nuisance parameters nu with a prior, in addition to the parameters of interest x.

.. math:: V(x, \nu) = V(x; \nu) + \sum_j \Big( \frac{\nu_j - \nu_j^{file}}{\tau_j} \Big)^2

The search starts with the nominal values fixed; the fit from its best optimum has free nuisance parameters.
"""

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import starmap
from typing import TYPE_CHECKING

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.names import SEPARATOR, match_names, posture_of
from elastid.fit.spec import FitSpec, ParameterSpec, PriorSpec, RatioSpec
from elastid.parameters import DELAY, Parameter, Parameters, Prior, Tie
from elastid.robot import BASE, CHANNEL_NUMBERS, MAX_DELAY_S, Robot, Rod, Spring, Tolerances, channel_name, unit_axis
from elastid.robot.placement import Path
from elastid.robot.tolerances import RATIO, kind_of

if TYPE_CHECKING:
    from elastid.response import Response

AT_TOOL = " at the tool"  # suffix of a configuration's name for responses to forces at the tool


def configuration_groups(
    name: str, spec: ParameterSpec, robots: Mapping[str, Sequence[str]], configurations: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    """Return the configurations of each group that has a fitted configuration, by group.

    Groups can include configurations that are not fitted, for predictions. StudyError for `per: robot` without robots.
    """
    per = spec.per
    at_tool = [name for name in configurations if name.endswith(AT_TOOL)]
    if per == "robot":
        if not robots:
            text = "no robots are named; say which configurations are of which: fit.robots: {A: [c1, c2], B: [c3]}"
            raise StudyError("fit/parameters", text, f"fit.parameters.{name}.per")
        per = {robot: tuple(members) for robot, members in robots.items()}
    if per is None or not configurations:
        return {}
    if isinstance(per, str):
        per = {posture: (posture,) for posture in configurations if posture not in at_tool}
    return {
        group: (*members, *(posture for posture in at_tool if posture.removesuffix(AT_TOOL) in members))
        for group, members in per.items()
        if set(members) & set(configurations)
    }


def group_labels(parameters: Parameters, configurations: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the configurations of each group with the same separate parameters, by label.

    Labels join the groups of different parameters: A-warm. Configurations without a group are `others`. If no parameter
    has groups, all configurations have the label "".
    """
    groups: dict[str, list[str]] = {}
    for configuration in configurations:
        local = parameters.configuration_of_stand_in(configuration)
        labels = dict.fromkeys(p.name.partition(SEPARATOR)[2] for p in parameters if local in p.only)
        groups.setdefault("-".join(labels), []).append(configuration)
    if list(groups) == [""]:
        return {"": tuple(groups[""])}
    return {label or "others": tuple(members) for label, members in groups.items()}


MAX_PRIOR_STD = 10.0  # of the logarithm of a parameter, above which a prior has no effect
BOUND_FACTOR = 100.0  # ratio of the default bounds of a logarithmic parameter to its start


def choose(spec: FitSpec, robot: Robot, configurations: Sequence[str] = (), has_references: bool = False) -> Parameters:
    """Select all numbers of the robot and the torque delay, free, tied or fixed as spec.parameters states.

    A key of spec.parameters is a name or a pattern (`k_*`). Names have priority over patterns, later patterns over
    earlier ones. Geometry and numbers of channels are parameters only if the study names them (`named_on_demand`).
    Without keys, every stiffness, and every damping and motor friction that is not zero, is free.
    configurations: fitted ones, for separate values of groups; without any, one value for all.  has_references: the
    delay of the references is free unless the study states it.
    Raises StudyError for unknown names, a zero start of a logarithmic parameter, bounds that exclude the start,
    overlapping groups of configurations, and if no parameter is free.
    """
    try:
        parameters = _choose(spec, robot, configurations, has_references)
    except ValueError as error:
        raise StudyError("fit/parameters", str(error), "fit.parameters") from None
    if not parameters.free:
        text = "nothing is left to identify, every parameter is fixed or tied"
        raise StudyError("fit/parameters", text, "fit.parameters")
    return parameters


def _choose(spec: FitSpec, robot: Robot, configurations: Sequence[str], has_references: bool) -> Parameters:
    """Choose parameters for `choose`; raise ValueError for an impossible set."""
    configurations = tuple(dict.fromkeys(map(posture_of, configurations)))
    delay_rule = {channel_name(DELAY, "r"): ParameterSpec()} if has_references else {}
    table = robot.parameters(named_on_demand(delay_rule | spec.parameters, robot)) | {DELAY: (0.0, "s")}
    rules = _match(spec.parameters, table, robot.on_demand) if spec.parameters else _default_rules(robot)
    rules = delay_rule | rules
    grouped = {name: configuration_groups(name, rule, spec.robots, configurations) for name, rule in rules.items()}
    linear, motors = _linear_names(robot), {j.name: j.motor for j in robot.driven if j.motor is not None}
    # Start value of motor friction that is zero in the robot model: it stops the rotor within 1 s.
    coasting_friction = {f"fm_{name}": motor.inertia for name, motor in motors.items() if motor.viscous == 0}
    selection: list[Parameter] = []
    ratios = list(starmap(_ratio, spec.ratios.items()))
    for name, (value, unit) in table.items():
        log, groups = name not in linear, grouped.get(name, {})
        if name not in rules:
            selection.append(Parameter(name, value, unit, log=log, free=False))
            continue
        rule = rules[name]
        if name in coasting_friction and rule.start is None and not rule.fixed:
            rule = replace(rule, start=coasting_friction[name])
        parameter = _parameter(name, value, unit, rule, log)
        everywhere = bool(groups) and {c for only in groups.values() for c in only} >= set(configurations)
        selection.append(replace(parameter, free=False, prior=None) if everywhere else parameter)
        ratios += (replace(parameter, name=f"{name}@{group}", only=only) for group, only in groups.items())
    return Parameters((*selection, *ratios))


def named_geometry(rules: Mapping[str, ParameterSpec], robot: Robot) -> tuple[str, ...]:
    """Return the names of robot.geometry that are keys or targets of ties in fit.parameters.

    A pattern for geometry begins with a letter (pc1_*, p_arm_*); `*` and `*_1` do not select geometry.
    """
    keys = [key for key in rules if key[:1].isalpha()]
    keys += [rule.tie.to for rule in rules.values() if rule.tie is not None and rule.tie.to in robot.geometry]
    candidates = tuple(robot.numbers) + tuple(robot.geometry)
    names = {name for key in keys for name in match_names(key, candidates)}
    return tuple(name for name in robot.geometry if name in names)


def named_on_demand(rules: Mapping[str, ParameterSpec], robot: Robot) -> tuple[str, ...]:
    """Return the names of robot.on_demand in fit.parameters: geometry, and values of channels (gain_kp_*)."""
    keys = [key for key in rules if re.match(rf"({'|'.join(CHANNEL_NUMBERS)})_(kp|kd|[uyr])(_|$)", key)]
    keys += [rule.tie.to for rule in rules.values() if rule.tie is not None]
    names = {name for key in keys for name in match_names(key, robot.channel_numbers)}
    return (*named_geometry(rules, robot), *(name for name in robot.channel_numbers if name in names))


def _match(
    rules: Mapping[str, ParameterSpec], table: Mapping[str, object], on_demand: Iterable[str]
) -> dict[str, ParameterSpec]:
    rules_of: dict[str, ParameterSpec] = {}
    for key, rule in rules.items():
        names = match_names(key, table)
        if not names:
            near = did_you_mean(key, table, on_demand)
            raise StudyError("fit/parameters", f"the robot has no parameter {key}; {near}", "fit.parameters")
        rules_of |= {name: _expand_tie_pattern(key, name, rule, table) for name in names}
    return rules_of | {key: rule for key, rule in rules.items() if key in table}


def _expand_tie_pattern(key: str, name: str, rule: ParameterSpec, table: Collection[str]) -> ParameterSpec:
    """Return the rule for one name of a pattern: the * of its tie is replaced by the match of the key's *."""
    if rule.tie is None or "*" not in rule.tie.to or rule.tie.to in table:
        return rule
    if key.count("*") != 1:
        raise StudyError(
            "fit/parameters", f"a tie to {rule.tie.to} needs exactly one * in the key", f"fit.parameters.{key}"
        )
    prefix, after = key.split("*")
    return replace(rule, tie=replace(rule.tie, to=rule.tie.to.replace("*", name[len(prefix) : len(name) - len(after)])))


def _ratio(name: str, ratio: RatioSpec) -> Parameter:
    start = float(ratio.start)
    lower, upper = map(float, ratio.bounds or (start / BOUND_FACTOR, start * BOUND_FACTOR))
    return Parameter(name, start, "1", lower, upper, log=True, prior=_prior(ratio.prior, start), ratio=True)


def _default_rules(robot: Robot) -> dict[str, ParameterSpec]:
    """Select every stiffness, and every nonzero damping of a spring or rod and friction of a motor."""
    springs: list[tuple[str, str, Spring | Rod | None]] = [("", joint.name, joint.spring) for joint in robot.joints]
    springs += [("m", joint.name, joint.motor.spring) for joint in robot.joints if joint.motor is not None]
    springs += [("", loop.name, loop.rod) for loop in robot.loops if loop.rod is not None and loop.rod.is_elastic]
    names = [f"fm_{joint.name}" for joint in robot.joints if joint.motor is not None and joint.motor.viscous > 0]
    for of_motor, name, spring in springs:
        if spring is not None:
            names += [f"k{of_motor}_{name}"] + [f"d{of_motor}_{name}"] * (spring.damping > 0)
    return {name: ParameterSpec() for name in names}


def _linear_names(robot: Robot) -> set[str]:
    bodies = robot.all_bodies
    names = {DELAY, *(f"c_{body.name}_{axis}" for body in bodies for axis in "xyz")}
    products = {"_xy", "_xz", "_yz"}
    names |= {f"I_{body.name}{entry}" for body in bodies for entry in products.intersection(body.inertia_entries)}
    names |= {f"a_{loop.name}" for loop in robot.loops if loop.rod is not None}
    names |= {f"{letter}_{joint.name}" for joint in robot.joints for letter in ("k2", "k2s")}
    names |= {f"L0_{compensator.name}" for compensator in robot.compensators}
    names |= robot.geometry.keys() - {f"l_{loop.name}" for loop in robot.loops}
    return names | {name for name in robot.channel_numbers if not name.startswith("gain_")}


def _parameter(name: str, value: float, unit: str, rule: ParameterSpec, log: bool) -> Parameter:
    key = f"fit.parameters.{name}"
    if rule.tie is not None:
        return Parameter(name, value, unit, log=log, tie=rule.tie)
    if isinstance(rule.start, str):  # texts of a study are converted to numbers when it is read
        raise StudyError("fit/parameters", f"start is '{rule.start}'; give a number in {unit}", key)
    start = value if rule.start is None else rule.start
    if rule.fixed:
        return Parameter(name, start, unit, log=log, free=False)
    prior = _prior(rule.prior, value)
    if prior is not None and log and not prior.mean > 0:
        raise StudyError("fit/parameters", f"the mean {prior.mean:g} {unit} must be positive", f"{key}.prior")
    if prior is not None and log and prior.std > MAX_PRIOR_STD:
        raise StudyError(
            "fit/parameters",
            f"the std of a positive parameter is relative, so {prior.std:g} is {100 * prior.std:.4g} %. For "
            f"{prior.std:g} {unit}, write {prior.std / prior.mean:.3g}",
            f"{key}.prior.std",
        )
    return Parameter(name, start, unit, *_bounds(name, start, rule, log), log, prior=prior)


def _prior(prior: PriorSpec | None, value: float) -> Prior | None:
    return None if prior is None else Prior(value if prior.mean is None else float(prior.mean), prior.std)


def _bounds(name: str, start: float, rule: ParameterSpec, log: bool) -> tuple[float, float]:
    if rule.bounds is not None:
        return float(rule.bounds[0]), float(rule.bounds[1])
    if log:
        # Coulomb friction looks viscous to a multisine, the more the lower the velocity.
        return start / BOUND_FACTOR, start * (1e4 if name.startswith(("f_", "fm_")) else BOUND_FACTOR)
    return MAX_TIME if name.startswith((DELAY, "low_pass_")) else (-math.inf, math.inf)


MAX_TIME = (-MAX_DELAY_S, MAX_DELAY_S)  # of a delay or a low pass of a channel
MAX_FACTOR = 3.0  # ratio of the bounds of a positive nuisance parameter to its nominal value, against extreme steps


def with_tolerances(parameters: Parameters, robot: Robot, spec: FitSpec) -> Parameters:
    """Free the fixed numbers of the robot within robot.tolerances; unchanged without tolerances.

    Parameters that spec.parameters frees, ties or fixes do not change.  Coordinates that are zero stay fixed, except
    centres of mass and angles, because an offset of an axis has a second-order effect.
    """
    prefixes = ("gain_u_",) if channel_name(DELAY, "r") in parameters.names else ("gain_kp_", "gain_kd_")
    tolerances = {prior.name: prior for prior in tolerances_of(robot) if not prior.name.startswith(prefixes)}
    by_name = {parameter.name: parameter for parameter in parameters}
    of_study = {p.stands_for for p in parameters if p.is_free or p.tie is not None}
    of_study |= {n for key, rule in spec.parameters.items() if rule.fixed for n in match_names(key, parameters.names)}
    numbers: list[Parameter] = []
    factors: dict[str, Parameter] = {}
    for name, (value, unit) in robot.parameters((*parameters.names, *tolerances)).items():
        number = by_name.get(name, Parameter(name, value, unit, log=name.startswith(("l_", "gain_")), free=False))
        prior = tolerances.get(name)
        if prior is None or name in of_study or (number.value == 0 and prior.kind not in ("center_of_mass", "angle")):
            numbers += [number] * (name in by_name)
        elif prior.factor:
            factors[prior.factor] = replace(
                _free_within_tolerance(Parameter(prior.factor, 1.0, log=True), prior.std), ratio=True
            )
            numbers.append(replace(number, tie=Tie(prior.factor, number.value)))
        else:
            numbers.append(_free_within_tolerance(number, prior.std))
    of_file = {number.name for number in numbers}
    return Parameters((*numbers, *(p for p in parameters if p.name not in of_file), *factors.values()))


def _free_within_tolerance(fixed: Parameter, std: float) -> Parameter:
    """Free a fixed number within its tolerance, which is relative for a positive number."""
    if not fixed.log:
        return replace(fixed, free=True, prior=Prior(fixed.value, std), is_nuisance=True)
    lower, upper = fixed.value / MAX_FACTOR, fixed.value * MAX_FACTOR
    relative = std / fixed.value if fixed.unit == "m" else std
    return replace(fixed, free=True, lower=lower, upper=upper, prior=Prior(fixed.value, relative), is_nuisance=True)


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of a number: owner (body, loop or payload), kind, std, and common factor of an inertia's entries."""

    name: str
    owner: str
    kind: str
    std: float
    factor: str = ""


def tolerances_of(robot: Robot) -> Iterator[Tolerance]:
    """Yield the tolerance of each value of the robot model that is not exact."""
    if not isinstance(robot.tolerances, Tolerances):
        return
    values = robot.parameters()
    for name, (_, path) in (robot.numbers | robot.geometry).items():
        owner = getattr(robot, str(path[0]))[path[1]].name if isinstance(path[1], int) else str(path[0])
        factor = f"I_{owner}" if path[-2] == "inertia" else ""
        is_without_mass = kind_of(path) == "center_of_mass" and values[f"m_{owner}"][0] == 0
        if (
            (std := robot.tolerances.std(path, owner)) > 0
            and not is_without_mass
            and not _rotates_about_gravity(robot, path)
        ):
            yield Tolerance(name, owner, kind_of(path), std, factor)
    of_constants = robot.tolerances.torque_constant
    if isinstance(of_constants, float) and of_constants > 0:
        gains = [name for name in robot.channel_numbers if name.startswith(("gain_u_", "gain_kp_", "gain_kd_"))]
        for name in gains:  # a torque constant scales both gains of its joint controller
            factor = "" if name.startswith("gain_u_") else f"torque_constant_{name[8:]}"
            yield Tolerance(name, "", "torque_constant", of_constants, factor)


def _rotates_about_gravity(robot: Robot, path: Path) -> bool:
    """Return True for an angle offset that rotates the whole robot about gravity and is therefore not detectable."""
    if path[-1] != "zero" or robot.loops or robot.compensators:
        return False
    body, joint = robot.bodies[int(path[1])], robot.bodies[int(path[1])].joints[int(path[3])]
    axis = body.placement.rotation @ unit_axis(joint.axis)
    return body.parent == BASE and path[3] == 0 and float(np.linalg.norm(np.cross(axis, robot.gravity))) < 1e-9


def local_ratio_std(robot: Robot | None, travel: Mapping[str, float]) -> FloatArray:
    """Return relative std (n_u,) of each gear ratio over a fraction of a revolution, caused by transmission error.

    A transmission error of 20 arcsec once per motor revolution is a slope of 1 % at a ratio of 100; over n revolutions
    the mean slope is 1/n of it.  travel: of each motor, rad, link side.  Ratios of 1 (link-side values) have std 0.
    """
    joints = () if robot is None else robot.driven
    ratios = {f"motor {joint.name}": abs(joint.motor.ratio) for joint in joints if joint.motor is not None}
    turns = {motor: max(1.0, ratios.get(motor, 1.0) * angle / (2 * np.pi)) for motor, angle in travel.items()}
    return np.array([RATIO / turns[motor] if ratios.get(motor, 1.0) != 1 else 0.0 for motor in travel])


def with_ratio_std(response: "Response", robot: Robot) -> "Response":
    """Return the response with the std of its gear ratios from robot.tolerances; 0 for an exact robot model."""
    within = robot.tolerances.ratio_std / RATIO if isinstance(robot.tolerances, Tolerances) else 0.0
    return replace(response, ratio_std=within * response.ratio_std)
