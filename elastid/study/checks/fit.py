"""The section `fit` against robot and experiment: groups of configurations, masks and factors, profiles, geometry."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from elastid.base.errors import StudyError
from elastid.base.names import SEPARATOR, is_match
from elastid.fit.problem.inertia_barrier import impossible_inertias, moved_inertias
from elastid.fit.setup.parameter_choice import choose, named_geometry
from elastid.fit.weight_spec import FactorSpec, MaskSpec, misnamed
from elastid.study.checks.names import (
    check_names,
    list_configurations,
    list_inputs,
    list_outputs,
    unknown,
)
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.yaml_source import KeyPath

_PARAMETERS: KeyPath = ("fit", "parameters")


def check_fit(study: Study) -> Iterator[Problem]:
    """All of the section that depends on others; the parameters themselves are checked as they get their units."""
    yield from _check_groups(study)
    yield from _check_masks(study)
    yield from _check_profile(study)
    yield from _check_geometry(study)
    yield from _check_inertias(study)


def _check_groups(study: Study) -> Iterator[Problem]:
    """Robots and other groups hold configurations that exist; where robots are named, each configuration is of one."""
    fit, configurations = study.fit, list_configurations(study)
    given: list[tuple[KeyPath, Sequence[str]]] = [
        (("fit", "robots", robot), names) for robot, names in fit.robots.items()
    ]
    for key, spec in fit.parameters.items():
        per = spec.per if isinstance(spec.per, dict) else {}
        given += [((*_PARAMETERS, key, "per", group), names) for group, names in per.items()]
        base, _, one = key.partition(SEPARATOR)
        each = any(p.per == "configuration" for k, p in fit.parameters.items() if is_match(k, base))
        if one and each and not any(is_match(name, one) for name in configurations):
            yield unknown((*_PARAMETERS, key), "configuration", one, configurations)
    for path, names in given:
        yield from check_names(path, "configuration", names, configurations)
    measured = {name for names in fit.robots.values() for name in names}
    missing = [name for name in study.experiment.configurations if name not in measured]
    if fit.robots and missing:
        message = f"configuration {', '.join(missing)} is assigned to no robot; add it to the robot it was measured on"
        yield Problem(("fit", "robots"), message, at_key=True)


def _check_masks(study: Study) -> Iterator[Problem]:
    """Masks and factors name configurations, outputs and inputs that are measured."""
    known = {"configurations": list_configurations(study), "output": list_outputs(study), "input": list_inputs(study)}
    given: list[tuple[KeyPath, MaskSpec | FactorSpec]] = [
        *((("fit", "mask", i), mask) for i, mask in enumerate(study.fit.mask)),
        *((("fit", "weights", "factors", i), factor) for i, factor in enumerate(study.fit.weights.factors)),
    ]
    for path, mask in given:
        for place, noun, name in misnamed(mask, known):
            yield unknown((*path, *place), noun, name, known[str(place[0])])


def _check_profile(study: Study) -> Iterator[Problem]:
    """Parameters whose profile is requested are identified."""
    if isinstance(study.fit.profile, str):
        return
    from elastid.fit.uncertainty.intervals import match_names  # brings CasADi, which few checks need

    try:
        parameters = choose(study.fit, study.as_robot(), list(study.experiment.configurations))
    except StudyError:
        return  # reported where the parameters are checked
    for i, pattern in enumerate(study.fit.profile):
        try:
            match_names([pattern], parameters)
        except StudyError as error:
            yield Problem(("fit", "profile", i), str(error).removeprefix("fit.profile: "))


def _check_geometry(study: Study) -> Iterator[Problem]:
    """Coordinates to be identified start where the robot can be assembled, and keep the ends of springs apart."""
    if not named_geometry(study.fit.parameters, study.as_robot()):
        return
    from elastid.fit.setup.geometry import geometry_problems  # brings CasADi, which few checks need

    configurations = study.experiment.configurations
    if any(study.as_robot().count_refusal(len(angles)) for angles in configurations.values()):
        return  # reported where the configurations are checked
    try:
        parameters = choose(study.fit, study.as_robot(), tuple(configurations))
    except StudyError:
        return  # reported where the parameters are checked
    for name, message in geometry_problems(parameters, study.as_robot(), configurations):
        keys = [key for key in study.fit.parameters if is_match(name.partition("@")[0], key)]
        yield Problem((*_PARAMETERS, *keys[-1:]), message)
        return


def _check_inertias(study: Study) -> Iterator[Problem]:
    """The start of a body's inertias is one that a body can have."""
    try:
        parameters = choose(study.fit, study.as_robot(), tuple(study.experiment.configurations))
    except StudyError:
        return  # reported where the parameters are checked
    for body in impossible_inertias(moved_inertias(parameters, study.as_robot()), parameters, parameters.x):
        entries = {parameters.names[place] for place in body.places}
        keys = [key for key in study.fit.parameters if any(is_match(e, key.partition(SEPARATOR)[0]) for e in entries)]
        yield Problem((*_PARAMETERS, *keys[-1:]), body.refusal)
