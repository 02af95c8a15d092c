"""The sections `fit` and `loads` against robot and experiment: groups, weights, geometry, frames."""

from collections.abc import Iterator, Sequence

from elastid.base.errors import StudyError, did_you_mean
from elastid.base.names import is_match, match_names
from elastid.fit.load_tests import LoadTest
from elastid.fit.parameter_selection import choose
from elastid.fit.problem.inertia_barrier import free_inertias, impossible_inertias
from elastid.fit.spec import FitSpec, find_unknown_names
from elastid.robot import TOOL
from elastid.study.checks.names import check_names, check_units, list_configurations, list_inputs, list_outputs, unknown
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath

_PARAMETERS: KeyPath = ("fit", "parameters")


def check_fit(study: Study) -> Iterator[Problem]:
    """Check the keys of the section that depend on others; parameters are checked as they get their units."""
    yield from _check_groups(study)
    names = {"configurations": list_configurations(study), "output": list_outputs(study), "input": list_inputs(study)}
    for i, factor in enumerate(study.fit.weights.factors):
        for key_path, noun, name in find_unknown_names(factor, names):
            yield unknown(("fit", "weights", "factors", i, *key_path), noun, name, names[str(key_path[0])])
    try:
        parameters = choose(study.fit, study.as_robot(), tuple(study.experiment.configurations))
    except StudyError:
        return  # reported where the parameters are checked
    free, profile = [parameter.name for parameter in parameters.free], study.fit.profile
    for section, focus in (("focus", study.fit.focus), ("profile", () if isinstance(profile, str) else profile)):
        for i, key in enumerate(focus):
            if key not in FitSpec().focus and not match_names(key, free):
                message = f"no identified parameter is called {key}; {did_you_mean(key, free)}"
                yield Problem(("fit", section, i), message)
    # The start of a body's inertias is one that a body can have.
    for body in impossible_inertias(free_inertias(parameters, study.as_robot()), parameters, parameters.x):
        entries = {parameters.names[key_path] for key_path in body.indices}
        culprits = [key for key in study.fit.parameters if any(is_match(entry, key) for entry in entries)]
        yield Problem((*_PARAMETERS, *culprits[-1:]), body.refusal)


def _check_groups(study: Study) -> Iterator[Problem]:
    fit, configurations = study.fit, list_configurations(study)
    groups: list[tuple[KeyPath, Sequence[str]]] = [(("fit", "robots", robot), row) for robot, row in fit.robots.items()]
    for key, spec in fit.parameters.items():
        per = spec.per if isinstance(spec.per, dict) else {}
        groups += [((*_PARAMETERS, key, "per", group), names) for group, names in per.items()]
    for path, names in groups:
        yield from check_names(path, "configuration", names, configurations)
    members = {name for names in fit.robots.values() for name in names}
    absent = [name for name in study.experiment.configurations if name not in members]
    if fit.robots and absent:
        message = f"configuration {', '.join(absent)} is assigned to no robot"
        yield Problem(("fit", "robots"), message + ". Assign it to the robot of its measurement", at_key=True)


def check_loads(study: Study) -> Iterator[Problem]:
    """Yield problems of tests: posture of the robot, frames that it has, and a reading unless the rig is simulated."""
    if study.loads is None:
        return
    if not study.loads.tests:
        yield Problem(("loads",), "no load test is given. List some under tests, or give a file", at_key=True)
    for i, test in enumerate(study.loads.tests):
        yield from _check_test(study, test, ("loads", "tests", i))


def _check_test(study: Study, test: LoadTest, path: KeyPath) -> Iterator[Problem]:
    robot, configurations = study.as_robot(), list_configurations(study)
    if test.configuration and test.configuration not in configurations:
        yield unknown((*path, "configuration"), "configuration", test.configuration, configurations)
    if test.angles is not None:
        if refusal := robot.count_refusal(len(test.angles)):
            yield Problem((*path, "angles"), refusal)
        yield from check_units((*path, "angles"), test.angles, robot)
    locations = [*(frame.name for frame in robot.frames), *(body.name for body in robot.bodies), TOOL]
    for key in ("frame", "measured_at"):
        name = getattr(test, key)
        if name and name not in locations:
            yield unknown((*path, key), "frame or body", name, dict.fromkeys(locations))
    if test.deflection is None and study.experiment.simulated is None:
        text = "the load test has no deflection; only a simulated rig measures it. Give deflection"
        yield Problem((*path, "deflection"), text)
