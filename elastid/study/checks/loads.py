"""The section `loads` against robot and experiment: postures, frames, and readings that no rig can make."""

from __future__ import annotations

from collections.abc import Iterator

from elastid.fit.load_tests import LoadTest
from elastid.robot import TOOL
from elastid.study.checks.names import check_units, list_configurations, unknown
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath


def check_loads(study: Study) -> Iterator[Problem]:
    """Each test is in a posture of the robot, at frames that it has, and was measured unless the rig is simulated."""
    if study.loads is None:
        return
    if not study.loads.tests:
        yield Problem(("loads",), "no load test is given; list some under tests, or give a file", at_key=True)
    for i, test in enumerate(study.loads.tests):
        yield from _check_test(study, test, ("loads", "tests", i))


def _check_test(study: Study, test: LoadTest, path: KeyPath) -> Iterator[Problem]:
    robot, configurations = study.as_robot(), list_configurations(study)
    if test.configuration and test.configuration not in configurations:
        yield unknown((*path, "configuration"), "configuration", test.configuration, configurations)
    if test.angles is not None:
        if refused := robot.count_refusal(len(test.angles)):
            yield Problem((*path, "angles"), refused)
        yield from check_units((*path, "angles"), test.angles, robot)
    places = [*(frame.name for frame in robot.frames), *(body.name for body in robot.bodies), TOOL]
    for key in ("frame", "measured_at"):
        name = getattr(test, key)
        if name and name not in places:
            yield unknown((*path, key), "frame or body", name, dict.fromkeys(places))
    if test.deflection is None and study.experiment.simulated is None:
        yield Problem((*path, "deflection"), "a load test without its deflection; only a simulated rig measures it")
