"""Exact FRFs of a robot with noise of known variance. Several examples use them instead of a long measurement."""

from collections.abc import Mapping, Sequence

import numpy as np

import elastid as ei
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.response import Covariance


def measured(
    robot: ei.Robot, truth: Mapping[str, float], postures: Mapping[str, Sequence[float]], freq_hz, noise=0.01,
    of_largest=False,
):  # fmt: skip
    """Return responses of a robot with the numbers of `truth`, with relative noise, and its covariance.

    of_largest: relative to the largest element of a line, in whose noise small ones drown.
    """
    model, rng = formulate(robot, ModelSpec()), np.random.default_rng(0)
    theta = np.array([truth.get(name, value) for name, (value, _) in robot.parameters().items()])
    responses = []
    for name, angles in postures.items():
        posture = ei.Configuration(name, tuple(angles))
        linear = linearise(model, posture, theta, robot.motor_locations, "acceleration")
        G = frequency_response(linear, np.append(theta, 0.0), freq_hz)
        size = np.abs(G)
        std = noise * (np.broadcast_to(size.max(axis=(1, 2), keepdims=True), G.shape) if of_largest else size)
        G = G + std * (rng.standard_normal(G.shape) + 1j * rng.standard_normal(G.shape)) / np.sqrt(2)
        names, known = robot.motor_locations, Covariance(std**2, np.inf)
        responses.append(ei.Response(freq_hz, G, names, names, "acceleration", posture, total=known))
    return responses
