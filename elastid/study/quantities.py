"""Numbers of parameters, whose unit only the parameter's name tells, into SI: the truth, and what the fit is told."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import TypeAlias

from elastid.base.errors import StudyError, did_you_mean
from elastid.base.units import Quantity, to_si
from elastid.fit.setup.groups import OF
from elastid.fit.setup.parameter_choice import choose, named_geometry
from elastid.fit.spec import ParameterSpec
from elastid.linear.linear_model import DELAY
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.yaml_source import KeyPath

_FIT: KeyPath = ("fit", "parameters")
_TRUTH: KeyPath = ("experiment", "simulated", "truth")


def in_si(study: Study) -> tuple[Study, list[Problem]]:
    """The study with every quantity a float in SI, and what stands in the way: unknown names, wrong units, bounds."""
    found: list[Problem] = []
    numbers = study.robot.parameters(study.robot.geometry)
    asked = named_geometry(study.fit.parameters, study.robot)
    table: Table = {**study.robot.parameters(asked), DELAY: (0.0, "s")}
    parameters = {name: _parameter(spec, name, table, numbers, found) for name, spec in study.fit.parameters.items()}
    study = replace(study, fit=replace(study.fit, parameters=parameters))
    simulated = study.experiment.simulated
    if simulated is not None:
        truth: dict[str, Quantity] = {
            name: _number(value, [name] if name in numbers else [], (*_TRUTH, name), numbers, found)
            for name, value in simulated.truth.items()
        }
        study = replace(study, experiment=replace(study.experiment, simulated=replace(simulated, truth=truth)))
        found += _truth_of_a_robot(study, truth) if not found else []
    return study, found or _refused_choice(study)


Table: TypeAlias = Mapping[str, tuple[float, str]]


def _parameter(spec: ParameterSpec, pattern: str, table: Table, every: Table, found: list[Problem]) -> ParameterSpec:
    """The spec in SI.  table: the parameters; every: the geometry that no key names included."""
    path = (*_FIT, pattern)
    names = [name for name in table if fnmatchcase(name, pattern.partition(OF)[0])]

    def number(value: Quantity, *keys: str | int) -> float:
        return _number(value, names, (*path, *keys), table, found)

    before = len(found)
    if not names:
        known = did_you_mean(pattern, table, every)
        found.append(Problem(path, f"no parameter of the robot is called '{pattern}'; {known}", at_key=True))
        return spec
    start = None if spec.start is None else number(spec.start, "start")
    bounds = None if spec.bounds is None else (number(spec.bounds[0], "bounds", 0), number(spec.bounds[1], "bounds", 1))
    prior = spec.prior
    if prior is not None and prior.mean is not None:
        prior = replace(prior, mean=number(prior.mean, "prior", "mean"))
    if spec.tie is not None and (spec.tie.to not in table or spec.tie.to in names):
        found.append(
            Problem((*path, "tie", "to"), f"cannot be tied to '{spec.tie.to}'; {did_you_mean(spec.tie.to, table)}")
        )
    if len(found) == before and bounds is not None and not spec.fixed and spec.tie is None:
        found += _outside(names, start, bounds, path, table)
    return replace(spec, start=start, bounds=bounds, prior=prior)


def _number(value: Quantity, names: list[str], path: KeyPath, table: Table, found: list[Problem]) -> float:
    units = {table[name][1] for name in names}
    if not units:
        name = str(path[-1])
        found.append(Problem(path, f"no parameter of the robot is called '{name}'; {did_you_mean(name, table)}", True))
        return 0.0
    if len(units) > 1:
        listed = ", ".join(sorted(units))
        found.append(Problem(path, f"stands for parameters of different units ({listed}); name them one by one"))
        return 0.0
    try:
        return to_si(value, units.pop())
    except ValueError as error:
        found.append(Problem(path, str(error)))
        return 0.0


def _outside(
    names: list[str], start: float | None, bounds: tuple[float, float], path: KeyPath, table: Table
) -> list[Problem]:
    low, high = bounds
    if not low < high:
        return [Problem((*path, "bounds"), f"the lower bound {low:g} is not below the upper bound {high:g}")]
    values = {name: table[name][0] if start is None else start for name in names}
    return [
        Problem(
            (*path, "bounds"),
            f"the start {value:g} {table[name][1]} of {name} is outside its bounds [{low:g}, {high:g}]; "
            "widen the bounds or give another start",
        )
        for name, value in values.items()
        if not low <= value <= high
    ]


def _truth_of_a_robot(study: Study, truth: Mapping[str, Quantity]) -> list[Problem]:
    for name, value in truth.items():
        try:
            study.robot.with_parameters({name: float(value)})
        except ValueError as error:
            return [Problem((*_TRUTH, name), f"no robot has this number: {error}")]
    return []


def _refused_choice(study: Study) -> list[Problem]:
    """What the fit says about its parameters taken together, at the key that it speaks of."""
    try:
        choose(study.fit, study.robot, tuple(study.experiment.configurations))
    except StudyError as error:
        message = str(error).removeprefix("fit.parameters").lstrip(".: ")
        named = re.match(r"[^\s:.]+", message)
        keys = [key for key in study.fit.parameters if named and fnmatchcase(named[0].partition(OF)[0], key)]
        keys += [key for key in study.fit.parameters if named and named[0] == key]
        for key in keys[-1:]:
            if message.startswith((f"{key}:", f"{key}.")):
                message = message.removeprefix(key).lstrip(".: ")
        return [Problem((*_FIT, *keys[-1:]), message)]
    return []
