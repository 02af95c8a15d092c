"""Static load tests of a study in their postures; those of a simulated rig are measured on its true robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.experiment.simulated.plant import true_robot
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.fit.load_tests import LoadsSpec, LoadTest
from elastid.fit.problem.static_loads import PlacedTest, load_of, placed_tests
from elastid.linear.loaded import LoadedRobot
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.response import FrequencyResponse
from elastid.robot import Robot
from elastid.robot.named_frames import with_frames


def tests_of(
    loads: LoadsSpec | None, robot: Robot, experiment: ExperimentSpec, responses: Sequence[FrequencyResponse], seed: int
) -> tuple[PlacedTest, ...]:
    """Of a study, in the configurations of its responses or of its experiment; none without the section.

    On a simulated rig a test without a deflection is measured, with the error that it states; the same seed gives the
    same readings.
    """
    if loads is None:
        return ()
    named = named_configurations(experiment)
    named |= {response.configuration.name: response.configuration for response in responses}
    tests = placed_tests(loads.tests, named)
    if experiment.simulated is None or all(each.test.deflection is not None for each in tests):
        return tests
    truth = true_robot(robot, experiment.simulated.truth)
    own = tuple(load_of(each, truth) for each in tests)
    model = formulate(
        with_frames(truth, (name for load in own for name in (load.frame, load.read_at))), experiment.simulated.model
    )
    exact, _ = LoadedRobot.of(model, own, [model.theta] * len(own), ()).deflections([model.theta] * len(own))
    draws = np.random.SeedSequence([seed, len(tests)]).spawn(len(tests))
    return tuple(
        each if each.test.deflection is not None else replace(each, test=_measured(each.test, y, draw))
        for each, y, draw in zip(tests, exact, draws, strict=True)
    )


def named_configurations(experiment: ExperimentSpec) -> dict[str, Configuration]:
    """The configurations of an experiment by name."""
    return {
        name: Configuration(name, np.array(angles, dtype=float), carries=name not in experiment.without_payload)
        for name, angles in experiment.configurations.items()
    }


def _measured(test: LoadTest, exact: FloatArray, draw: np.random.SeedSequence) -> LoadTest:
    z = np.random.default_rng(draw).standard_normal(test.n_readings)
    values = (exact + np.linalg.cholesky(test.error_covariance) @ z).tolist()
    return replace(test, deflection=values[0] if test.n_readings == 1 else tuple(values))
