r"""Deflections under static loads as residuals of unit variance, fitted together with the responses.

.. math:: r_i = (y_i - \hat y_i(\theta(x))) / \sigma_i, \qquad V = \dots + r^T r

sigma: standard deviation of a reading (`LoadTest`). `linear.static_deflection` computes y at the equilibrium of x,
with nonlinear springs. To first order y = J K^-1 J^T F.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError, did_you_mean
from elastid.fit.load_tests import LoadTest
from elastid.linear.static_deflection import Load, LoadedRobot
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameters
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.robot.robot import with_frames


@dataclass(frozen=True, eq=False)
class PlacedTest:
    """A load test with its configuration."""

    test: LoadTest
    configuration: Configuration


def placed_tests(tests: Sequence[LoadTest], configurations: Mapping[str, Configuration]) -> tuple[PlacedTest, ...]:
    """Return the tests with their configurations; StudyError for an unknown configuration."""
    places = []
    for test in tests:
        if test.angles is not None:
            where = Configuration("load test", np.asarray(test.angles, dtype=float))
        elif test.configuration in configurations:
            where = configurations[test.configuration]
        else:
            advice = did_you_mean(test.configuration, configurations)
            raise StudyError("study/invalid", f"no configuration is called {test.configuration}; {advice}", "loads")
        places.append(PlacedTest(test, where))
    return tuple(places)


@dataclass(frozen=True, eq=False)
class StaticLoads:
    """Load tests of a robot.  robot: equations of the loaded robot.  measured, std (n,): readings of all tests, m."""

    tests: tuple[LoadTest, ...]
    robot: LoadedRobot
    measured: FloatArray
    std: FloatArray

    @classmethod
    def of(cls, tests: Sequence[PlacedTest], robot: Robot, model: ModelSpec, parameters: Parameters) -> "StaticLoads":
        """Build the loaded robot at the start parameters; StudyError for unknown frames, or without equilibrium."""
        loads = tuple(load_of(load, robot) for load in tests)
        framed_robot = with_frames(robot, (name for load in loads for name in (load.frame, load.read_at)))
        equations = formulate(framed_robot, model, tuple(name for name in robot.on_demand if name in parameters.names))
        names = [load.configuration.name for load in loads]
        dependent = {name for configuration in names for name in parameters.dependent_names(configuration)}
        theta = [parameters.expand(parameters.x, configuration)[:-1] for configuration in names]
        loaded = LoadedRobot.of(equations, loads, theta, tuple(dependent))
        load_tests = tuple(load.test for load in tests)
        deflections = ([test.measured for test in load_tests], [test.deviations for test in load_tests])
        return cls(load_tests, loaded, *map(np.concatenate, deflections))

    @property
    def n_residuals(self) -> int:
        """Number of readings."""
        return len(self.measured)

    @cached_property
    def owners(self) -> list[int]:
        """Index of the test of each reading (n,)."""
        return [i for i, test in enumerate(self.tests) for _ in range(test.n_readings)]

    def predicted(self, parameters: Parameters, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return deflections (n,) in m and their derivatives (n, n_x) to x; LinAlgError without an equilibrium."""
        names = [load.configuration.name for load in self.robot.loads]
        deflections, slopes = self.robot.deflections([parameters.expand(x, name)[:-1] for name in names])
        rows = [slope @ parameters.jacobian(x, n)[self.robot.dependent] for slope, n in zip(slopes, names, strict=True)]
        return np.concatenate(deflections), np.vstack(rows)

    def residual(self, parameters: Parameters, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return r (n,) and dr/dx (n, n_x)."""
        y, slopes = self.predicted(parameters, x)
        return (self.measured - y) / self.std, -slopes / self.std[:, None]

    def drawn(self, deflections: FloatArray, rng: np.random.Generator) -> "StaticLoads":
        """Return the loads with readings drawn about modelled deflections (n,) in m."""
        return replace(self, measured=deflections + self.std * rng.standard_normal(len(deflections)))


def load_of(placed_test: PlacedTest, robot: Robot) -> Load:
    """Return the force and torque of a test, a hanging mass as its weight; StudyError for a wrong number of angles."""
    test, configuration = placed_test.test, placed_test.configuration
    if refusal := robot.count_refusal(configuration.angles.size):
        raise StudyError("study/invalid", f"{configuration.name}: {refusal}", "loads")
    force = np.asarray(test.force, dtype=float) + test.mass * np.asarray(robot.gravity, dtype=float)
    return Load(configuration, test.frame, force, np.asarray(test.torque, dtype=float), test.read_at, test.directions)
