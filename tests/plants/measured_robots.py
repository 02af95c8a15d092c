"""Responses of a robot with noise of known variance, and how far a fit ends from it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.experiment.specs.channels import ChannelSpec
from elastid.fit.result import Result
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.response import Covariance, Response
from elastid.robot import Robot
from plants.two_mass import drawn

# Torques, positions and references of two motors.
U, Y, R = (
    tuple(ChannelSpec(role, f"motor {i}", f"{role}{i}", quantity=what) for i in (1, 2))
    for role, what in (("u", "torque"), ("y", "position"), ("reference", "position"))
)


def responses_of(
    robot: Robot,
    postures: Mapping[str, Sequence[float]] | Sequence[Sequence[float]],
    rng: np.random.Generator | None,
    freq_hz: FloatArray,
    relative: float = 0.02,
    added: float = 2e-4,
    further: tuple[str, ...] = (),
    spec: ModelSpec = ModelSpec(),  # noqa: B008
    delay: float = 0.0,
    dof: float = np.inf,
) -> list[Response]:
    """Of the motors, and of further places, with noise relative to each element and to the largest one of all lines.

    rng: None of exact responses with the noise that they might have.  dof: from which its variance was estimated.
    """
    named = postures if isinstance(postures, Mapping) else {f"c{i + 1}": q for i, q in enumerate(postures)}
    model, responses = formulate(robot, spec), []
    linearisation, outputs = Linearisation.of(model), (*model.inputs, *further)
    for name, angles in named.items():
        linear = linearisation.at(Configuration(name, tuple(angles)), model.theta, outputs, "acceleration")
        exact = to_response(linear, np.append(model.theta, delay), freq_hz)
        std = relative * np.abs(exact.G) + added * np.abs(exact.G).max(axis=0)
        G, noise = (exact.G, Covariance(std**2, dof)) if rng is None else drawn(exact.G, std, rng, dof)
        responses.append(replace(exact, G=G, noise=noise))
    return responses


def deviations(result: Result, robot: Robot) -> FloatArray:
    """Distances of the free parameters from those of a robot, in claimed standard deviations."""
    table = robot.parameters(robot.geometry)
    truth = np.array([p.to_x(table[p.name][0]) for p in result.parameters.free])
    return np.abs(result.x - truth) / np.sqrt(np.diag(result.covariance))


def deviation(result: Result, name: str, truth: float) -> float:
    """Distance of a free, logarithmic parameter from its true value, in claimed standard deviations."""
    i = result.parameters.free_names.index(name)
    return float(abs(result.x[i] - np.log(truth)) / np.sqrt(result.covariance[i, i]))
