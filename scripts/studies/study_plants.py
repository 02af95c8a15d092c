"""Plants of the studies: true robots, configurations, and responses with noise of known covariance."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import study_run  # noqa: F401, the plants of the tests
import numpy as np
from plants.data_sheet_arm import FREQ, POSTURES, arm
from plants.paths import ROBOTS, TEMPLATES

from elastid.base.arrays import FloatArray
from elastid.fit.frf_problem import Assembly
from elastid.fit.parameter_selection import choose
from elastid.fit.problem.weights import weigh
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import EXACT, formulate
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameters
from elastid.record import Configuration, Motion
from elastid.response import Covariance, Response
from elastid.robot import Body, Joint, Motor, Robot, Spring
from elastid.study import load, load_robot

# Function from a plant, and arguments of the fault, to the responses of the plant with the fault.
Fault: TypeAlias = Callable[..., list[Response]]
# Relative noise std of each FRF element, noise floor relative to the largest element, correlation of the outputs.
NOISE, FLOOR, CORRELATION = 0.02, 0.01, 0.5


@dataclass(frozen=True)
class Plant:
    """A robot, its configurations, DFT lines and relative noise std, and the fit specification of its parameters."""

    name: str
    robot: Robot
    configurations: tuple[Configuration, ...]
    freq_hz: FloatArray
    spec: FitSpec
    quantity: Motion = "acceleration"
    model: ModelSpec = EXACT
    noise: float = NOISE

    @property
    def parameters(self) -> Parameters:
        """Parameters of the fit; the start values are the true values."""
        return choose(self.spec, self.robot, [configuration.name for configuration in self.configurations])


def three_mass() -> Plant:
    """Return the axis of Wernholt & Gunnarsson (2006), motor, gear and arm: torque to motor velocity, 1 to 40 Hz."""
    J, a_m, a_g = 0.03291699877416, 0.17910964111956, 0.61206166914114
    motor = Motor(J * a_m, 1.0, 0.00986346744839)
    on_gear = Joint("g", "z", Spring(20.59269827430799, 0.0624181404729), motor)
    on_arm = Joint("a", "z", Spring(20.23072060978318, 0.00987527995798))
    gear = Body("gear", joints=(on_gear,), inertia=J * a_g)
    arm = Body("arm", "gear", joints=(on_arm,), inertia=J * (1 - a_m - a_g))
    robot = Robot("three masses", (gear, arm), gravity=(0.0, 0.0, 0.0))
    spec = FitSpec(parameters={"k_*": ParameterSpec(), "d_*": ParameterSpec()}, weights=WeightSpec(model_error=0.0))
    return Plant("three-mass", robot, (Configuration("c1", (0.0,)),), np.arange(1, 40.01, 0.2), spec, "velocity")


def of_study(path: Path, name: str, lines: int) -> Plant:
    """Return the plant of a study file at a number of lines; weights are the inverse of the noise variance alone."""
    study = load(path).study
    configurations = tuple(Configuration(key, angles) for key, angles in study.experiment.configurations.items())
    excitation = study.excitation
    low, high = excitation.band_hz if excitation is not None else (1.0, 60.0)
    spec = replace(study.fit, weights=WeightSpec(model_error=0.0), criterion="complex")
    return Plant(name, study.robot, configurations, np.linspace(low, high, lines), spec, model=study.model)


def two_axes() -> Plant:
    """Return a plant of two links in a vertical plane with elastic gears."""
    configurations = tuple(Configuration(f"c{i}", angles) for i, angles in enumerate(POSTURES))
    return Plant("two-axis", arm(), configurations, FREQ, PLANTS["demo"]().spec)


def six_axes() -> Plant:
    """Return a published six-axis robot with twelve springs and dampers in six random configurations."""
    robot = load_robot(ROBOTS / "kr300_twelve_springs.yml")
    angles = np.random.default_rng(0).uniform(-1.2, 1.2, (6, 6))
    configurations = tuple(Configuration(f"c{i + 1}", tuple(row)) for i, row in enumerate(angles.tolist()))
    parameters = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}
    spec = FitSpec(parameters=parameters, weights=WeightSpec(model_error=0.0))
    return Plant("six-axis", robot, configurations, np.linspace(3, 60, 40), spec)


# The robot of `elastid demo`, and the arm with a parallelogram.
PLANTS = {
    "two-axis": two_axes,
    "demo": partial(of_study, TEMPLATES / "serial" / "study.yml", "demo", 80),
    "six-axis": six_axes,
    "linkage": partial(of_study, TEMPLATES / "parallel-linkage" / "study.yml", "linkage", 60),
}
# Standard deviations of data-sheet values: relative, of inertias (relative), centres and lengths in m, zeros in rad.
RELATIVE = {"m": 0.03, "Jm": 0.05, "k": 0.2, "d": 0.2}
INERTIA, CENTRE_M, LENGTH_M, ZERO = 0.1, 0.01, 1e-3, math.radians(0.2)


def within_data_sheet(robot: Robot, rng: np.random.Generator) -> Robot:
    """Draw a true robot whose model has data-sheet errors; one factor applies to all inertias of a body."""
    factors, numbers = {body.name: math.exp(INERTIA * rng.standard_normal()) for body in robot.all_bodies}, {}
    for name, (value, _) in robot.parameters(tuple(robot.geometry)).items():
        z, (kind, _, owner) = rng.standard_normal(), name.partition("_")
        if value == 0 and kind not in ("c", "zero"):
            continue
        if kind == "I":
            numbers[name] = value * factors.get(owner, factors.get(owner.rpartition("_")[0], 1.0))
        elif kind in RELATIVE:
            numbers[name] = value * math.exp(RELATIVE[kind] * z)
        elif kind == "c" or name in robot.geometry:
            numbers[name] = value + {"c": CENTRE_M, "zero": ZERO}.get(kind, LENGTH_M) * z
    return robot.with_parameters(numbers)


def exact_responses(
    plant: Plant,
    robot: Robot | None = None,
    angles: Mapping[str, Sequence[float]] | None = None,
    outputs: tuple[str, ...] = (),
    linearisation: Linearisation | None = None,
) -> list[Response]:
    """Return noise-free responses of a robot, by default the plant's robot, in the plant's configurations.

    angles: true angles by name of the configuration, if they differ from the stated angles.  outputs: locations of the
    measured motion; default: motors.  linearisation: model of a robot that differs only in parameters.
    """
    robot = plant.robot if robot is None else robot
    linearisation = linearisation or Linearisation.of(formulate(robot, plant.model))
    theta, responses = np.array([value for value, _ in robot.parameters().values()]), []
    for configuration in plant.configurations:
        true = replace(configuration, angles=tuple((angles or {}).get(configuration.name, configuration.angles)))
        linear = linearisation.at(true, theta, outputs or robot.motor_locations, plant.quantity)
        response = to_response(linear, np.append(theta, 0.0), plant.freq_hz)
        responses.append(replace(response, configuration=configuration))
    return responses


@dataclass(frozen=True)
class Rig:
    """Generator of random data sets of a plant: exact responses with their noise covariance, linearised once."""

    plant: Plant
    linearisation: Linearisation
    exact: tuple[Response, ...]
    correlation: FloatArray

    @classmethod
    def of(cls, plant: Plant) -> "Rig":
        """Build the rig of a plant."""
        linearisation = Linearisation.of(formulate(plant.robot, plant.model))
        exact = tuple(exact_responses(plant, linearisation=linearisation))
        rng = np.random.default_rng(0)
        n_y = exact[0].G.shape[1]
        mixing = CORRELATION * rng.standard_normal((n_y, n_y)) + np.eye(n_y)
        covariance = mixing @ mixing.T
        return cls(plant, linearisation, exact, covariance / np.sqrt(np.outer(*2 * [np.diag(covariance)])))

    def draw(self, rng: np.random.Generator, truth: tuple[Response, ...] = ()) -> list[Response]:
        """Draw a data set from exact responses (truth, default: the plant's) with their noise covariance."""
        return [self._draw(response, rng) for response in truth or self.exact]

    def _draw(self, response: Response, rng: np.random.Generator) -> Response:
        F, n_y, n_u = response.G.shape
        std = self.plant.noise * (np.abs(response.G) + FLOOR * np.abs(response.G).max())
        level = np.sqrt(np.mean(std**2, axis=2))
        right = level[:, :, None] * self.correlation * level[:, None, :]
        e = np.linalg.cholesky(right) @ (rng.standard_normal((F, n_y, n_u)) + 1j * rng.standard_normal((F, n_y, n_u)))
        variance = np.einsum("faa->fa", right)[:, :, None] * np.ones(n_u)
        left = np.broadcast_to(np.eye(n_u), (F, n_u, n_u))
        covariance = Covariance(variance, np.inf, left.astype(complex), right.astype(complex))
        return replace(response, G=response.G + e / np.sqrt(2), total=covariance)

    def assembly(self, data: list[Response], spec: FitSpec) -> Assembly:
        """Prepare the fit of a data set with the existing linearisation."""
        weights = tuple(weigh(response, spec) for response in data)
        return Assembly(tuple(data), weights, self.linearisation, self.plant.parameters, spec)
