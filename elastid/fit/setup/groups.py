"""Groups of configurations with parameters of their own: each robot of a type, a temperature, each configuration.

fm_1@warm stands in for fm_1 in the configurations of the group warm.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from elastid.base.errors import StudyError, did_you_mean
from elastid.base.names import SEPARATOR, is_match
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.parameters import ParameterSet


def is_group_key(key: str) -> bool:
    """True if a key of fit.parameters is about the parameter of one group."""
    return SEPARATOR in key


def groups_of(
    name: str, spec: ParameterSpec, robots: Mapping[str, Sequence[str]], configurations: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    """Group to its configurations, of the groups of which any is fitted.

    Those of a group that are not fitted are in it, too: what was found for the group predicts them.
    StudyError where a configuration is in two groups, and for `per: robot` without robots.
    """
    per, where = spec.per, f"fit.parameters.{name}.per"
    if per == "robot":
        if not robots:
            raise StudyError(
                f"{where}: no robots are named; say which configurations are of which, for example fit.robots: {{A: "
                "[c1, c2], B: [c3]}"
            )
        per = {robot: tuple(members) for robot, members in robots.items()}
    if per is None or not configurations:
        return {}
    if isinstance(per, str):
        return {configuration: (configuration,) for configuration in configurations}
    taken = [name for group in per.values() for name in group]
    for name in taken:
        if taken.count(name) > 1:
            raise StudyError(f"{where}: configuration {name} is in two groups")
    return {group: tuple(members) for group, members in per.items() if set(members) & set(configurations)}


def spec_of_group(key: str, shared: ParameterSpec, given: Mapping[str, ParameterSpec]) -> ParameterSpec:
    """The settings of the parameter of one group: of its own keys, else those of all groups."""
    matching = [each for each in given if is_group_key(each) and is_match(key, each)]
    if not matching:
        return shared
    own = given[key if key in matching else matching[-1]]
    bounds = shared.bounds if own.bounds is None else own.bounds
    start = shared.start if own.start is None else own.start
    return replace(own, start=start, bounds=bounds, prior=own.prior or shared.prior)


def check_keys(spec: FitSpec, wanted: Mapping[str, ParameterSpec]) -> None:
    """StudyError for a key of one group that matches no parameter, or sets what is common to all groups.

    wanted: the settings of each name.  A fit of some configurations does not have all groups.
    """
    for key in filter(is_group_key, spec.parameters):
        where, (name, _, group) = f"fit.parameters.{key}", key.partition(SEPARATOR)
        if spec.parameters[key].per is not None or spec.parameters[key].tie is not None:
            raise StudyError(f"{where}: per and tie are for all groups together; give them at {name}")
        pers = [spec.per for each, spec in wanted.items() if is_match(each, name) and spec.per is not None]
        if not pers:
            raise StudyError(
                f"{where}: {name} has no groups; say which there are, for example {name}: {{per: robot}} with "
                "fit.robots"
            )
        known = [each for per in pers for each in (spec.robots if per == "robot" else per)]
        if "configuration" not in pers and not any(is_match(each, group) for each in known):
            raise StudyError(f"{where}: there is no group {group}; {did_you_mean(group, dict.fromkeys(known))}")


def group_labels(parameters: ParameterSet, configurations: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """The groups that have parameters of their own, each with those of these configurations that are in it.

    Where parameters are grouped in several ways, by the names of the groups side by side: A-warm. Configurations that
    no group names are `others`; one group of all, called "", where no parameter has groups.
    """
    groups: dict[str, list[str]] = {}
    for configuration in configurations:
        mine = dict.fromkeys(p.name.partition(SEPARATOR)[2] for p in parameters if configuration in p.only)
        groups.setdefault("-".join(mine), []).append(configuration)
    if list(groups) == [""]:
        return {"": tuple(groups[""])}
    return {label or "others": tuple(members) for label, members in groups.items()}
