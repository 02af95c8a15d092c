"""Numbers of parameters, whose unit follows from the parameter's name, in SI: the truth, starts, bounds and priors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

from elastid.base.errors import StudyError, did_you_mean
from elastid.base.names import SEPARATOR, is_match, matching
from elastid.base.units import Quantity, to_si
from elastid.fit.parameter_choice import choose, named_on_demand, nearest_parameter
from elastid.fit.spec import ParameterSpec
from elastid.linear.linear_model import DELAY
from elastid.robot.friction_numbers import friction_numbers, with_numbers
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath

# Value in SI and unit of each parameter.
Table: TypeAlias = Mapping[str, tuple[float, str]]

_FIT: KeyPath = ("fit", "parameters")
_TRUTH: KeyPath = ("experiment", "simulated", "truth")


def convert_to_si(study: Study) -> tuple[Study, list[Problem]]:
    """The study with every quantity a float in SI; and unknown names, wrong units, and what `choose` refuses."""
    if study.robot is None:
        return study, []
    problems: list[Problem] = []
    numbers = {**study.robot.parameters(study.robot.on_demand), **friction_numbers(study.robot)}
    named = named_on_demand(study.fit.parameters, study.robot)
    table: Table = {**study.robot.parameters(named), DELAY: (0.0, "s")}
    parameters = {
        name: _convert_parameter(spec, name, table, numbers, problems) for name, spec in study.fit.parameters.items()
    }
    study = replace(study, fit=replace(study.fit, parameters=parameters))
    simulated = study.experiment.simulated
    if simulated is not None:
        truth: dict[str, Quantity] = {
            name: _convert(value, [name] if name in numbers else [], (*_TRUTH, name), numbers, problems)
            for name, value in simulated.truth.items()
        }
        study = replace(study, experiment=study.experiment.with_truth(truth))
        problems += _check_truth(study, truth) if not problems else []
    return study, problems or ([] if study.friction is not None else _check_choice(study))


def _convert_parameter(
    spec: ParameterSpec, pattern: str, table: Table, every: Table, problems: list[Problem]
) -> ParameterSpec:
    """The spec in SI.  table: the parameters; every: with geometry and gains that no key names."""
    path = (*_FIT, pattern)
    names = list(matching(pattern.partition(SEPARATOR)[0], table))

    def number(value: Quantity, *keys: str | int) -> float:
        return _convert(value, names, (*path, *keys), table, problems)

    if not names:
        known = nearest_parameter(pattern, table, every)
        problems.append(Problem(path, f"no parameter of the robot is called '{pattern}'; {known}", at_key=True))
        return spec
    start = None if spec.start is None else number(spec.start, "start")
    bounds = None if spec.bounds is None else (number(spec.bounds[0], "bounds", 0), number(spec.bounds[1], "bounds", 1))
    prior = spec.prior
    if prior is not None and prior.mean is not None:
        prior = replace(prior, mean=number(prior.mean, "prior", "mean"))
    if spec.tie is not None and (spec.tie.to not in table or spec.tie.to in names):
        message = f"cannot be tied to '{spec.tie.to}'; {did_you_mean(spec.tie.to, table)}"
        problems.append(Problem((*path, "tie", "to"), message))
    return replace(spec, start=start, bounds=bounds, prior=prior)


def _convert(value: Quantity, names: list[str], path: KeyPath, table: Table, problems: list[Problem]) -> float:
    """A number of parameters of one unit in SI; 0 where there is a problem."""
    units = sorted({table[name][1] for name in names})
    if not units:
        name = str(path[-1])
        problems.append(
            Problem(path, f"no parameter of the robot is called '{name}'; {did_you_mean(name, table)}", True)
        )
    elif len(units) > 1:
        problems.append(
            Problem(path, f"matches parameters of different units ({', '.join(units)}); name them one by one")
        )
    else:
        try:
            return to_si(value, units[0])
        except ValueError as error:
            problems.append(Problem(path, str(error)))
    return 0.0


def _check_truth(study: Study, truth: Mapping[str, Quantity]) -> list[Problem]:
    """The numbers of the truth are possible for a robot, each by itself, and those of friction laws together."""
    robot = study.as_robot()
    friction = {name: float(value) for name, value in truth.items() if name in friction_numbers(robot)}
    tried = [{name: float(value)} for name, value in truth.items() if name not in friction]
    for values in [*tried, *([friction] if friction else [])]:
        try:
            with_numbers(robot, values)
        except ValueError as error:
            return [Problem((*_TRUTH, next(iter(values))), f"no robot has this number: {error}")]
    return []


def _check_choice(study: Study) -> list[Problem]:
    """The refusal by `choose` of all parameters together, at the key that its message names."""
    try:
        choose(study.fit, study.as_robot(), tuple(study.experiment.configurations))
    except StudyError as error:
        message = str(error).removeprefix("fit.parameters").lstrip(".: ")
        named = re.match(r"[^\s:.]+", message)
        given = study.fit.parameters
        keys = [key for key in given if named and is_match(named[0].partition(SEPARATOR)[0], key)]
        keys += [key for key in given if named and named[0] == key]
        for key in keys[-1:]:
            if message.startswith((f"{key}:", f"{key}.")):
                message = message.removeprefix(key).lstrip(".: ")
            inner = ("bounds",) if "bound" in message and given[key].bounds is not None else ()
            return [Problem((*_FIT, key, *inner), message)]
        return [Problem(_FIT, message)]
    return []
